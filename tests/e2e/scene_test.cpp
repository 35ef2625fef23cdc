// SPDX-License-Identifier: Apache-2.0
// Scenes through the whole firmware: what a receiver on the two lines and on the link sees.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>

#include "app/app.hpp"
#include "base/math.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "drivers/sim/serial.hpp"
#include "tests/support/folders.hpp"
#include "vision/jpeg_decoder.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

struct Desk {
  explicit Desk(const scene::Scene& scene) : camera(scene, clock) {}

  sim::Clock clock;
  sim::SceneCamera camera;
  sim::Gpio gpio{clock};
  sim::Serial link;
  drivers::TurboJpegDecoder other_scales;
  jpeg_fast::Worker worker;
  hal::Alone crew;
  EighthDecoder jpeg{{}, other_scales, {&worker, 1}, crew};
  std::unique_ptr<App> app = std::make_unique<App>(Devices{camera, gpio, link, clock, jpeg});
};

scene::Scene grey(scene::Scene scene) {
  scene.level.inject = scene::Inject::kGrey;
  return scene;
}

struct SceneRun {
  long frames = 0;
  std::optional<long> first_slip;
  std::optional<long> onset;  // truth: more than half of the contact slips
  bool grip_ok_low_in_that_frame = false;
  int least_markers = 1000;
  double worst_px = 0;        // of 320: distance of a valid marker from its true centre
  double square_sum_px2 = 0;  // of 320
  long markers = 0;
};

// `scale`: from pixels of the working image to those of the camera's.
SceneRun play(Desk& desk, double scale) {
  SceneRun run;
  const double px320_per_input_px = 320.0 / desk.camera.picture().width;
  CHECK(desk.app->start(Params{}).ok());
  while (desk.app->step()) {
    if (desk.app->result().quality.reason == Reason::kNoFrame) continue;
    if (desk.camera.snapshot().level >= scene::SlipLevel::kHalf && !run.onset) run.onset = run.frames;
    if (desk.app->outputs().slip && !run.first_slip) {
      run.first_slip = run.frames;
      run.grip_ok_low_in_that_frame = desk.gpio.level(hal::Line::kGripOk) == hal::Level::kLow;
    }
    run.least_markers = std::min(run.least_markers, desk.app->result().markers);
    const MarkerField& field = desk.app->state().tracker.field;
    for (int i = 0; i < field.grid.count(); ++i) {
      const Marker& marker = field.markers[idx(i)];
      if (!marker.valid) continue;
      const scene::PointPx truth = desk.camera.marker_centers()[idx(i)];
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

TEST_GROUP(Scene){};

// The path of the real sensor: 8-megapixel JPEG in, lines out.
TEST(Scene, SlipIsRaisedAfterTheOnsetAndLowersGripOkInTheSameFrame) {
  const scene::Scene scene = scene::sphere_slip();
  Desk desk(scene);
  const SceneRun run = play(desk, 8.0);

  CHECK(run.first_slip.has_value());
  CHECK(run.onset.has_value());
  // As the scene promises.
  CHECK(scene.expect.max_delay_ms.has_value());
  const double delay_ms = 1e3 * static_cast<double>(*run.first_slip - *run.onset) / scene.fps;
  std::printf("\nslip %.0f ms after the onset; promised %.0f\n", delay_ms, *scene.expect.max_delay_ms);
  CHECK(delay_ms >= 0.0 && delay_ms <= *scene.expect.max_delay_ms + 1e-3);
  CHECK(run.grip_ok_low_in_that_frame);
  LONGS_EQUAL(63, run.least_markers);
  LONGS_EQUAL(scene::frame_count(scene), run.frames);
  // ALIVE toggles once for every accepted frame.
  LONGS_EQUAL(run.frames, desk.gpio.edges(hal::Line::kAlive));
  // One status frame per step: the frames and the end of the stream.
  LONGS_EQUAL(run.frames + 1, desk.link.writes_taken());
  CHECK(desk.gpio.level(hal::Line::kGripOk) == hal::Level::kLow);
}

// DESIGN.md, budgets: 0.012 px of 320 at 3280x2464 decoded at 1/8, sigma 8, quality 85.
TEST(Scene, CentresFromTheCamerasJpegAreGoodToTwelveThousandths) {
  scene::Scene scene = scene::sphere_slip();
  scene.effects.pixel_noise = 8.0;
  Desk desk(scene);
  const SceneRun run = play(desk, 8.0);
  LONGS_EQUAL(63, run.least_markers);
  const double rms = std::sqrt(run.square_sum_px2 / static_cast<double>(run.markers));
  std::printf("\n3280x2464 at 1/8, sigma 8, quality 85: rms %.4f px of 320, worst %.3f\n", rms, run.worst_px);
  CHECK(rms <= 0.012);
}

TEST(Scene, NothingIsRaisedWithoutContactOrInAFirmShake) {
  scene::Scene still = scene::sphere_slip();
  for (scene::Waypoint& point : still.trajectory) {
    if (point.force_n) point.force_n = *point.force_n / 300.0;  // 0.01 N
    if (point.x_mm) point.x_mm = *point.x_mm / 800.0;           // 0.01 mm/s
    if (point.y_mm) point.y_mm = *point.y_mm / 800.0;
  }
  const auto shaken = scene::read_scene_file(holdfast::test::source("tests/scenes/sphere_shake.json"));
  for (const scene::Scene& scene : {still, shaken.scene.value()}) {
    Desk desk(grey(scene));
    const SceneRun run = play(desk, 1.0);
    CHECK_FALSE(run.first_slip.has_value());
    LONGS_EQUAL(63, run.least_markers);
  }
}

TEST(Scene, TheReferenceIsLearnedBeforeAnythingIsVouchedFor) {
  Desk desk(grey(scene::sphere_slip()));
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
