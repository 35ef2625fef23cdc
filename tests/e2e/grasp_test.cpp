// SPDX-License-Identifier: Apache-2.0
// The simulated grasp through the whole firmware: what a receiver on the two lines and on the link sees.
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>
#include <vector>

#include "app/app.hpp"
#include "base/math.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_grasp.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "drivers/sim/serial.hpp"
#include "vision/jpeg_decoder.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

struct Desk {
  explicit Desk(const sim::GraspCamera::Config& config) : camera(config, clock) {}

  sim::Clock clock;
  sim::GraspCamera camera;
  sim::Gpio gpio{clock};
  sim::Serial link;
  drivers::TurboJpegDecoder other_scales;
  jpeg_fast::Worker worker;
  hal::Alone crew;
  EighthDecoder jpeg{{}, other_scales, {&worker, 1}, crew};
  std::unique_ptr<App> app = std::make_unique<App>(Devices{camera, gpio, link, clock, jpeg});
};

sim::GraspCamera::Config filmed(const scene::GraspConfig& grasp, bool jpeg) {
  sim::GraspCamera::Config config{};
  config.grasp = grasp;
  if (!jpeg) {
    config.picture = scene::cropped_320x240();
    config.format = hal::PixelFormat::kLuma8;
  }
  return config;
}

struct Run {
  long frames = 0;
  std::optional<long> first_slip;
  bool grip_ok_low_in_that_frame = false;
  int least_markers = 1000;
  double worst_px = 0;        // of 320: distance of a valid marker from its true centre
  double square_sum_px2 = 0;  // of 320
  long markers = 0;
};

Run play(Desk& desk, double scale, double px320_per_input_px) {
  Run run;
  CHECK(desk.app->start(Params{}).ok());
  while (desk.app->step()) {
    if (desk.app->result().quality.reason == Reason::kNoFrame) continue;
    if (desk.app->outputs().slip && !run.first_slip) {
      run.first_slip = run.frames;
      run.grip_ok_low_in_that_frame = desk.gpio.level(hal::Line::kGripOk) == hal::Level::kLow;
    }
    run.least_markers = std::min(run.least_markers, desk.app->result().markers);
    const MarkerField& field = desk.app->state().tracker.field;
    for (int i = 0; i < field.grid.count(); ++i) {
      const Marker& marker = field.markers[idx(i)];
      if (!marker.valid) continue;
      const scene::PointPx truth = desk.camera.dot_centers()[idx(i)];
      const double dx = ((marker.x.raw() / 256.0 + 0.5) * scale - 0.5 - truth.x) * px320_per_input_px;
      const double dy = ((marker.y.raw() / 256.0 + 0.5) * scale - 0.5 - truth.y) * px320_per_input_px;
      run.worst_px = std::max(run.worst_px, std::hypot(dx, dy));
      run.square_sum_px2 += dx * dx + dy * dy;
      ++run.markers;
    }
    ++run.frames;
  }
  desk.app->stop();
  return run;
}

}  // namespace

TEST_GROUP(Grasp){};

// The path of the real sensor: 8-megapixel JPEG in, lines out.
TEST(Grasp, SlipIsRaisedWithinTwoFramesOfTheOnsetAndLowersGripOkInTheSameFrame) {
  const scene::GraspConfig grasp = scene::sphere_slip();
  Desk desk(filmed(grasp, true));
  const Run run = play(desk, 8.0, 320.0 / 3280.0);

  const double onset_s = scene::onset_s(grasp, scene::SlipLevel::kHalf).value();
  const long onset_frame = std::lround(std::ceil(onset_s * grasp.fps - 1e-9));
  CHECK(run.first_slip.has_value());
  CHECK(std::labs(*run.first_slip - onset_frame) <= 2);
  CHECK(run.grip_ok_low_in_that_frame);
  LONGS_EQUAL(63, run.least_markers);
  LONGS_EQUAL(scene::frame_count(grasp), run.frames);
  // ALIVE toggles once for every accepted frame.
  LONGS_EQUAL(run.frames, desk.gpio.edges(hal::Line::kAlive));
  // One status frame per step: the frames and the end of the stream.
  LONGS_EQUAL(run.frames + 1, desk.link.writes_taken());
  CHECK(desk.gpio.level(hal::Line::kGripOk) == hal::Level::kLow);
}

// DESIGN.md, budgets: 0.012 px of 320 at 3280x2464 decoded at 1/8, sigma 8, quality 85.
TEST(Grasp, CentresFromTheCamerasJpegAreGoodToTwelveThousandths) {
  sim::GraspCamera::Config config = filmed(scene::sphere_slip(), true);
  config.picture.noise_sigma = 8.0;
  Desk desk(config);
  const Run run = play(desk, 8.0, 320.0 / 3280.0);
  LONGS_EQUAL(63, run.least_markers);
  const double rms = std::sqrt(run.square_sum_px2 / static_cast<double>(run.markers));
  std::printf("\n3280x2464 at 1/8, sigma 8, quality 85: rms %.4f px of 320, worst %.3f\n", rms, run.worst_px);
  CHECK(rms <= 0.012);
}

TEST(Grasp, NothingIsRaisedWithoutContactOrInAFirmShake) {
  scene::GraspConfig still = scene::sphere_slip();
  still.press_n = 0.01;
  still.speed_mm_s = 0.01;
  for (const scene::GraspConfig& grasp : {still, scene::shaken(scene::sphere_slip())}) {
    Desk desk(filmed(grasp, false));
    const Run run = play(desk, 1.0, 1.0);
    CHECK_FALSE(run.first_slip.has_value());
    LONGS_EQUAL(63, run.least_markers);
  }
}

TEST(Grasp, TheReferenceIsLearnedBeforeAnythingIsVouchedFor) {
  Desk desk(filmed(scene::sphere_slip(), false));
  CHECK(desk.app->start(Params{}).ok());
  for (int frame = 0; frame < Params{}.reference_frames - 1; ++frame) {
    CHECK(desk.app->step());
    CHECK(desk.app->outputs().state == DeviceState::kReference);
    CHECK(desk.gpio.level(hal::Line::kGripOk) == hal::Level::kLow);
  }
  CHECK(desk.app->step());
  CHECK(desk.app->outputs().state == DeviceState::kOk);
  CHECK(desk.gpio.level(hal::Line::kGripOk) == hal::Level::kHigh);
}
