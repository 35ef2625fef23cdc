// SPDX-License-Identifier: Apache-2.0
// The camera of a simulated process, on a clock that the test moves: what comes when, and what a reader meets that was
// away for long.
#include <cstdint>
#include <vector>

#include "drivers/sim/camera_paced.hpp"
#include "drivers/sim/clock.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

using namespace std::chrono_literals;

sim::Film two_and_one() {
  sim::Film film;
  film.width = 2;
  film.height = 1;
  film.empty = {{1, 1}, {2, 2}};
  film.held = {{9, 9}};
  return film;
}

}  // namespace

TEST_GROUP(PacedCamera) {
  sim::Clock clock;
  sim::Film film = two_and_one();
  hal::Frame frame;

  // Everything that is there now, by number.
  std::vector<std::uint32_t> waiting(hal::Camera & camera) {
    std::vector<std::uint32_t> numbers;
    while (camera.next(frame, 0us) == hal::Capture::kFrame) {
      numbers.push_back(frame.sequence);
      camera.release(frame);
    }
    return numbers;
  }
};

TEST(PacedCamera, FramesComeAtTheirRateAndTellTheirExposure) {
  clock.advance(7s);
  sim::PacedCamera camera(film, clock, {.period = 40ms, .latency = 30ms, .touch = 100ms});
  CHECK(camera.start());
  for (int k = 0; k < 5; ++k) {
    CHECK(camera.next(frame, 40ms) == hal::Capture::kFrame);
    CHECK(clock.now() == 7s + k * 40ms + 30ms);
    CHECK(frame.timestamp == 7s + k * 40ms);
    LONGS_EQUAL(k, frame.sequence);
    LONGS_EQUAL(k < 3 ? 1 + k % 2 : 9, frame.bytes[0]);
    LONGS_EQUAL(2, frame.stride);
  }
  CHECK(camera.next(frame, 5ms) == hal::Capture::kTimeout);
  CHECK(clock.now() == 7s + 190ms + 5ms);
  CHECK(camera.live());
  CHECK(!camera.identity().empty());
}

TEST(PacedCamera, FullBuffersKeepTheOldAndLoseTheNew) {
  sim::PacedCamera camera(film, clock, {.period = 40ms, .latency = 40ms, .buffers = 3});
  CHECK(camera.start());
  clock.advance_to(40ms);
  CHECK((waiting(camera) == std::vector<std::uint32_t>{0}));
  clock.advance_to(165ms);  // 1, 2 and 3 have come: just room enough
  CHECK((waiting(camera) == std::vector<std::uint32_t>{1, 2, 3}));
  clock.advance_to(1s);  // 4 to 24 have come
  CHECK((waiting(camera) == std::vector<std::uint32_t>{4, 5, 6}));
  CHECK(frame.timestamp == 240ms);
  CHECK(camera.next(frame, 40ms) == hal::Capture::kFrame);
  LONGS_EQUAL(25, frame.sequence);
  CHECK(frame.timestamp == 1s && clock.now() == 1040ms);
  clock.advance(1s);
  CHECK((waiting(camera) == std::vector<std::uint32_t>{26, 27, 28}));
}

TEST(PacedCamera, ARestartHasNothingFromBefore) {
  sim::PacedCamera camera(film, clock, {.period = 40ms, .latency = 40ms});
  CHECK(camera.start());
  clock.advance_to(1s);
  camera.stop();
  CHECK(camera.start());
  CHECK(waiting(camera).empty());
  CHECK(camera.next(frame, 40ms) == hal::Capture::kFrame);
  CHECK(frame.timestamp == 1s);
}
