// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_grasp.hpp"

#include <cmath>

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

TEST_GROUP(GraspCamera) {
  sim::Clock clock;
  hal::Frame frame;

  // Small pictures: the tests are about the camera, not its picture.
  static sim::GraspCamera::Config small(hal::PixelFormat format) {
    sim::GraspCamera::Config config;
    config.picture = scene::scaled(scene::camera_3280x2464(), 328);
    config.format = format;
    return config;
  }
};

TEST(GraspCamera, PlaysTheWholeGraspInVirtualTimeAndIsGone) {
  const auto config = small(hal::PixelFormat::kLuma8);
  sim::GraspCamera camera(config, clock);
  clock.advance(7ms);
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
  CHECK(camera.start());
  const int frames = scene::frame_count(config.grasp);
  for (int k = 0; k < frames; ++k) {
    CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
    LONGS_EQUAL(k, frame.sequence);
    CHECK(frame.timestamp == 7ms + k * 40ms);
    CHECK(clock.now() == frame.timestamp);
    LONGS_EQUAL(328 * 246, frame.bytes.size());
    LONGS_EQUAL(328, frame.stride);
    const scene::GraspTruth truth = scene::at(config.grasp, k / config.grasp.fps);
    CHECK(truth.phase == camera.truth().phase);
    DOUBLES_EQUAL(truth.travel_mm, camera.truth().travel_mm, 0.0);
    LONGS_EQUAL(63, camera.dot_centers().size());
    // The middle of each dot is dark, so truth and picture belong together.
    for (const scene::PointPx& dot : camera.dot_centers()) {
      const auto at = static_cast<std::size_t>(std::lround(dot.y) * 328 + std::lround(dot.x));
      CHECK(frame.bytes[at] < 45 + 20);
    }
    camera.release(frame);
  }
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
  camera.stop();
  CHECK(camera.start());
  CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  LONGS_EQUAL(0, frame.sequence);
  CHECK(frame.timestamp == clock.now());
}

TEST(GraspCamera, WaitsNoLongerThanAsked) {
  sim::GraspCamera camera(small(hal::PixelFormat::kLuma8), clock);
  CHECK(camera.start());
  CHECK(camera.next(frame, 0us) == hal::Capture::kFrame);
  CHECK(camera.next(frame, 39ms) == hal::Capture::kTimeout);
  CHECK(clock.now() == 39ms);
  CHECK(camera.next(frame, 1ms) == hal::Capture::kFrame);
  CHECK(clock.now() == 40ms);
}

TEST(GraspCamera, OddRatesKeepTheirTime) {
  auto config = small(hal::PixelFormat::kLuma8);
  config.grasp.fps = 18.75;  // seen on Linux
  sim::GraspCamera camera(config, clock);
  CHECK(camera.start());
  for (int k = 0; k <= 30; ++k) CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  CHECK(frame.timestamp == 1600ms);
}

TEST(GraspCamera, SendsJpegOfTheSizeAnnounced) {
  sim::GraspCamera camera(small(hal::PixelFormat::kMjpeg), clock);
  CHECK(camera.start());
  CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  CHECK(frame.format == hal::PixelFormat::kMjpeg);
  LONGS_EQUAL(328, frame.width);
  LONGS_EQUAL(246, frame.height);
  LONGS_EQUAL(0xff, frame.bytes[0]);
  LONGS_EQUAL(0xd8, frame.bytes[1]);
  LONGS_EQUAL(0xd9, frame.bytes.back());
}
