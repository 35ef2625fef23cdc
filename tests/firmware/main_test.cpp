// SPDX-License-Identifier: Apache-2.0
// The firmware as a process, on a board of the test's own: what is said when.
#include <optional>
#include <span>

#include "board/board.hpp"
#include "drivers/sim/clock.hpp"
#include "tests/support/frames.hpp"

// As the linker sees it, it is a function like others.
#define main holdfast_main
#include "firmware/main.cpp"  // NOLINT(bugprone-suspicious-include): there is no other way to call it
#undef main

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

class Lines final : public hal::Gpio {
 public:
  bool refuses = false;
  int driven = 0;

 private:
  [[nodiscard]] bool do_set(hal::Line, hal::Level) override {
    ++driven;
    return !refuses;
  }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input) override { return std::nullopt; }
};

class NoPort final : public hal::Serial {
 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t>) override { return true; }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t>) override { return 0; }
};

struct Board {
  sim::Clock clock;
  Lines lines;
  test::NoCamera camera;
  NoPort port;
  hal::NoKeep keep;
  test::NoJpeg jpeg;
  Devices devices{camera, lines, port, clock, jpeg};
  Periphery periphery{port, keep};
  int watched = 0, told_started = 0, rounds = 0;
  int driven_at_start = 0;  // lines, when it was said that it started
};

// The process has static parts of its own, which go on pointing here.
Board& here() {
  static Board board;
  return board;
}

}  // namespace

namespace holdfast::board {

std::optional<int> make(int argc, char** /*argv*/) {
  return argc > 1 ? std::optional<int>(2) : std::nullopt;
}
Devices& devices() {
  return here().devices;
}
Periphery& periphery() {
  return here().periphery;
}
hal::Serial& host() {
  return here().port;
}
console::Place place() {
  return {};
}
Params params() {
  return {};
}
const model::Tree* model() {
  return nullptr;
}
bool watch(OutputWatchdog& /*watchdog*/) {
  ++here().watched;
  return true;
}
void started() {
  ++here().told_started;
  here().driven_at_start = here().lines.driven;
}
void tell(const App& /*app*/) {
  ++here().rounds;
}
bool over() {
  return here().rounds == 3;
}

}  // namespace holdfast::board

TEST_GROUP(Main){};

// A service manager that was told otherwise would start what comes after it, and count a failed start as a fall.
TEST(Main, SaysThatItStartedOnlyWhenItDid) {
  LONGS_EQUAL(2, holdfast_main(2, nullptr));
  LONGS_EQUAL(0, here().watched);

  here().lines.refuses = true;
  LONGS_EQUAL(1, holdfast_main(1, nullptr));
  LONGS_EQUAL(1, here().watched);
  LONGS_EQUAL(0, here().told_started);
  LONGS_EQUAL(0, here().rounds);

  here().lines.refuses = false;
  here().lines.driven = 0;
  LONGS_EQUAL(0, holdfast_main(1, nullptr));  // a camera that is not there is waited for
  LONGS_EQUAL(1, here().told_started);
  CHECK_TRUE(here().driven_at_start >= 2);  // GRIP_OK and ALIVE are LOW by then
  LONGS_EQUAL(3, here().rounds);
}
