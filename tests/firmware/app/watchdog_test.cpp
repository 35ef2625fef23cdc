// SPDX-License-Identifier: Apache-2.0
#include "app/watchdog.hpp"

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
#include <thread>

#include "drivers/common/watchdog_thread.hpp"
#include "hal/clock.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

// Lines that two threads may set.
class Lines final : public hal::Gpio {
 public:
  std::atomic<int> lowered{0};
  std::atomic<bool> refuses{false};

 private:
  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override {
    if (line == hal::Line::kGripOk && level == hal::Level::kLow) lowered.fetch_add(1);
    return !refuses.load();
  }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input) override { return std::nullopt; }
};

// The time that the other thread sets.
class SetClock final : public hal::Clock {
 public:
  std::atomic<std::int64_t> now_us{0};
  std::atomic<std::int64_t> waited_us{0};

 private:
  [[nodiscard]] Micros do_now() const override { return Micros{now_us.load()}; }
  void do_wait(Micros time) override {
    waited_us = time.count();
    std::this_thread::yield();
  }
};

}  // namespace

TEST_GROUP(Watchdog) {
  OutputWatchdog watchdog;
  Lines lines;
};

TEST(Watchdog, WatchesNothingBeforeTheFirstFrameAndAfterAnEnd) {
  CHECK_FALSE(watchdog.watch(lines, 10s));
  watchdog.confirm(10s);
  watchdog.rest();
  CHECK_FALSE(watchdog.watch(lines, 20s));
  LONGS_EQUAL(0, lines.lowered.load());
}

// Silent from 200 ms on, as long as it lasts, and counted once each time. A refusal is tried again.
TEST(Watchdog, LowersGripOkWhileNoFrameIsVouchedFor) {
  for (std::uint32_t time = 1; time <= 3; ++time) {
    const Micros start = time * 10s;
    watchdog.confirm(start);
    CHECK_FALSE(watchdog.watch(lines, start));
    CHECK_FALSE(watchdog.watch(lines, start + 200ms));
    lines.lowered = 0;
    lines.refuses = time == 2;
    for (int k = 1; k <= 5; ++k) CHECK_TRUE(watchdog.watch(lines, start + 200ms + k * 1us));
    LONGS_EQUAL(5, lines.lowered.load());
    LONGS_EQUAL(time, watchdog.trips());
  }
  CHECK_TRUE(watchdog.watch(lines, 0s));  // a clock that stepped back is no youth
}

// Looks every 10 ms from a thread of its own, until its end.
TEST(Watchdog, IsLookedAfterByAThread) {
  SetClock clock;
  const auto seen = [](auto condition) {
    const auto deadline = std::chrono::steady_clock::now() + 60s;
    while (!condition() && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
    return condition();
  };
  watchdog.confirm(Micros{0});
  {
    const drivers::WatchdogThread thread(watchdog, lines, clock);
    CHECK_TRUE(thread.running());
    CHECK_TRUE(seen([&] { return clock.waited_us == 10'000; }));
    LONGS_EQUAL(0, lines.lowered.load());
    clock.now_us = 200'001;
    CHECK_TRUE(seen([&] { return lines.lowered > 0; }));
  }
  LONGS_EQUAL(1, watchdog.trips());
}

// Two threads, no lock: for ThreadSanitizer (tests/run.sh --only tsan).
TEST(Watchdog, IsSharedByTwoThreads) {
  std::atomic<bool> stop{false};
  std::thread watching([&] {
    for (Micros now{}; !stop.load(); now += 10ms) (void)watchdog.watch(lines, now);
  });
  for (int k = 0; k < 20'000; ++k) {
    watchdog.confirm(Micros{k});
    if (k % 7 == 0) watchdog.rest();
    (void)watchdog.trips();
  }
  stop = true;
  watching.join();
  CHECK_TRUE(watchdog.trips() <= 20'000);
}
