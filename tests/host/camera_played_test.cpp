// SPDX-License-Identifier: Apache-2.0
// A recording and a scene as a camera in real time, on a clock that the test moves: what comes when, round after round.
#include <array>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "drivers/sim/camera_played.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

using namespace std::chrono_literals;
using Opened = sim::Result<std::unique_ptr<sim::PlayedCamera>>;

constexpr int kWidth = 64, kHeight = 48;

}  // namespace

TEST_GROUP(PlayedCamera) {
  test::TempDir dir;
  sim::Clock clock;
  hal::Frame frame;

  // Three grey pictures behind each other, at 20 frames a second by the caller's word.
  std::string stream() const {
    std::string bytes;
    for (const std::uint8_t level : std::array<std::uint8_t, 3>{10, 100, 200}) {
      const std::vector<std::uint8_t> pixels(std::size_t{kWidth} * kHeight, level);
      const auto jpeg = scene::encode_jpeg(pixels, kWidth, kHeight, scene::JpegInput::kGrey, 90);
      bytes.append(jpeg.begin(), jpeg.end());
    }
    const auto path = dir / "three.mjpg";
    test::write_file(path, bytes);
    return path.string();
  }
  std::unique_ptr<sim::PlayedCamera> open(const std::string& path) {
    Opened opened = sim::PlayedCamera::open(path, clock, {.fps = 20});
    const auto* error = std::get_if<sim::Error>(&opened);
    CHECK_TEXT(error == nullptr, error == nullptr ? "" : error->line.c_str());
    return std::move(std::get<0>(opened));
  }
};

TEST(PlayedCamera, FramesComeAtTheirTimesAndAgainFromTheStart) {
  clock.advance(5s);
  const auto camera = open(stream());
  CHECK(!camera->live());
  CHECK(camera->start());
  std::vector<std::uint8_t> first;
  for (int k = 0; k < 7; ++k) {
    CHECK(camera->next(frame, 50ms) == hal::Capture::kFrame);
    CHECK(clock.now() == 5s + k * 50ms);
    CHECK(frame.timestamp == clock.now());
    LONGS_EQUAL(k, frame.sequence);
    LONGS_EQUAL(k / 3, camera->rounds());
    if (k == 0) first.assign(frame.bytes.begin(), frame.bytes.end());
    CHECK((k % 3 == 0) == (std::vector(frame.bytes.begin(), frame.bytes.end()) == first));
    camera->release(frame);
  }
  CHECK(camera->next(frame, 20ms) == hal::Capture::kTimeout);
  CHECK(clock.now() == 5s + 6 * 50ms + 20ms);
}

TEST(PlayedCamera, WaitsForWhoeverWasLate) {
  const auto camera = open(stream());
  CHECK(camera->start());
  CHECK(camera->next(frame, 0us) == hal::Capture::kFrame);
  clock.advance(10s);
  // No burst of old pictures: the next one is at most a period old, and then it goes on at its rate.
  CHECK(camera->next(frame, 0us) == hal::Capture::kFrame);
  CHECK(frame.timestamp == 10s - 50ms);
  LONGS_EQUAL(1, frame.sequence);
  CHECK(camera->next(frame, 0us) == hal::Capture::kFrame);
  CHECK(frame.timestamp == 10s);
  CHECK(camera->next(frame, 0us) == hal::Capture::kTimeout);
}

TEST(PlayedCamera, FilmsASceneInGrey) {
  Opened opened = sim::PlayedCamera::open(holdfast::test::source("tests/scenes/sphere_slip.json"), clock, {});
  CHECK(std::get_if<sim::Error>(&opened) == nullptr);
  sim::PlayedCamera& camera = *std::get<0>(opened);
  LONGS_EQUAL(83, camera.info().frames);
  CHECK(camera.start());
  for (int k = 0; k < 84; ++k) CHECK(camera.next(frame, 40ms) == hal::Capture::kFrame);
  CHECK(frame.format == hal::PixelFormat::kLuma8);
  LONGS_EQUAL(410, frame.width);
  LONGS_EQUAL(1, camera.rounds());
  CHECK(frame.timestamp == 83 * 40ms);
}

TEST(PlayedCamera, RefusesWhatIsNoRecording) {
  test::write_file(dir / "bad.json", "{");
  test::write_file(dir / "bad.avi", "no film");
  for (const char* const name : {"bad.json", "bad.avi", "absent.avi"}) {
    const Opened opened = sim::PlayedCamera::open((dir / name).string(), clock, {});
    const auto* error = std::get_if<sim::Error>(&opened);
    CHECK(error != nullptr);
    STRCMP_CONTAINS(name, error->line.c_str());
  }
  // The scene can be given up while it is filmed.
  const Opened stopped = sim::PlayedCamera::open(holdfast::test::source("tests/scenes/sphere_slip.json"), clock,
                                                 {.filmed = [](long done, long) { return done < 3; }});
  CHECK(std::get_if<sim::Error>(&stopped) != nullptr);
}
