// SPDX-License-Identifier: Apache-2.0
// The camera of scenes: its time, its faults' plan, and that its pictures show what the simulation says.
#include "drivers/sim/camera_scene.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/folders.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

// Small pictures: most tests are about the camera, not its picture.
scene::Scene small(scene::Inject inject) {
  scene::Scene scene = scene::sphere_slip();
  scene.level.inject = inject;
  scene.picture.width = 328;
  return scene;
}

// Grey at working size, every dot as dark as the next, and nothing but what a test adds.
scene::Scene clean() {
  scene::Scene scene = small(scene::Inject::kGrey);
  scene.picture.width = 0;
  scene.picture.shading = 0.0;
  scene.picture.imprint_gain = 0.0;
  scene.effects = {};
  return scene;
}

struct Blob {
  double x = 0.0, y = 0.0;
  int area = 0;
};

// Connected places darker than halfway between gel and dot: plain flood fill.
std::vector<Blob> blobs_of(const hal::Frame& frame) {
  std::vector<bool> dark(frame.bytes.size());
  for (std::size_t i = 0; i < dark.size(); ++i) dark[i] = frame.bytes[i] < (120 + 45) / 2;
  std::vector<Blob> out;
  std::vector<int> todo;
  for (int start = 0; start < static_cast<int>(dark.size()); ++start) {
    if (!dark[static_cast<std::size_t>(start)]) continue;
    Blob blob;
    todo.assign(1, start);
    dark[static_cast<std::size_t>(start)] = false;
    while (!todo.empty()) {
      const int at = todo.back();
      todo.pop_back();
      const int x = at % frame.width;
      const int y = at / frame.width;
      blob.x += x;
      blob.y += y;
      ++blob.area;
      const auto visit = [&](int to_x, int to_y) {
        if (to_x < 0 || to_y < 0 || to_x >= frame.width || to_y >= frame.height) return;
        const int to = to_y * frame.width + to_x;
        if (!dark[static_cast<std::size_t>(to)]) return;
        dark[static_cast<std::size_t>(to)] = false;
        todo.push_back(to);
      };
      visit(x - 1, y);
      visit(x + 1, y);
      visit(x, y - 1);
      visit(x, y + 1);
    }
    blob.x /= blob.area;
    blob.y /= blob.area;
    out.push_back(blob);
  }
  return out;
}

bool any_at(const std::vector<Blob>& blobs, scene::PointPx place, double within_px) {
  return std::any_of(blobs.begin(), blobs.end(),
                     [&](const Blob& blob) { return std::hypot(blob.x - place.x, blob.y - place.y) < within_px; });
}

int level_at(const hal::Frame& frame, scene::PointPx place) {
  return frame.bytes[static_cast<std::size_t>(std::lround(place.y) * frame.width + std::lround(place.x))];
}

double mean_level(const hal::Frame& frame) {
  double sum = 0.0;
  for (const std::uint8_t level : frame.bytes) sum += level;
  return sum / static_cast<double>(frame.bytes.size());
}

}  // namespace

TEST_GROUP(SceneCamera) {
  sim::Clock clock;
  hal::Frame frame;
};

// --- Time ---

TEST(SceneCamera, PlaysTheWholeSceneInVirtualTimeAndIsGone) {
  const scene::Scene scene = small(scene::Inject::kGrey);
  sim::SceneCamera camera(scene, clock);
  scene::Simulation truth(scene);
  clock.advance(7ms);
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
  CHECK(camera.start());
  const int frames = scene::frame_count(scene);
  for (int k = 0; k < frames; ++k) {
    CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
    LONGS_EQUAL(k, frame.sequence);
    CHECK(frame.timestamp == 7ms + k * 40ms);
    CHECK(clock.now() == frame.timestamp);
    LONGS_EQUAL(328 * 246, frame.bytes.size());
    LONGS_EQUAL(328, frame.stride);
    CHECK(camera.lent().bytes.data() == frame.bytes.data());
    const scene::Snapshot& now = truth.next();
    LONGS_EQUAL(now.frame, camera.snapshot().frame);
    CHECK(now.contact.slid_mm == camera.snapshot().contact.slid_mm);
    CHECK(now.motion_mm == camera.snapshot().motion_mm);
    LONGS_EQUAL(63, camera.marker_centers().size());
    // The middle of each dot is dark, so truth and picture belong together.
    for (const scene::PointPx& dot : camera.marker_centers()) CHECK(level_at(frame, dot) < 45 + 20);
    camera.release(frame);
  }
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
}

TEST(SceneCamera, RestartGoesOnWithTheScene) {
  sim::SceneCamera camera(small(scene::Inject::kGrey), clock);
  clock.advance(3ms);
  CHECK(camera.start());
  for (int k = 0; k < 5; ++k) CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  camera.stop();
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
  // Plugged in again 0.5 s after the last frame, number 4: frames 5 to 16 were due before, at 200 to 640 ms.
  clock.advance(500ms);
  CHECK(camera.start());
  CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  LONGS_EQUAL(17, frame.sequence);
  CHECK(frame.timestamp == 3ms + 17 * 40ms);
  LONGS_EQUAL(17, camera.snapshot().frame);
  CHECK(camera.snapshot().contact.normal_n > 0.0);  // 0.68 s: pressed on meanwhile
  // After the end nothing comes back.
  clock.advance(10s);
  camera.stop();
  CHECK(camera.start());
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
}

TEST(SceneCamera, WaitsNoLongerThanAsked) {
  sim::SceneCamera camera(small(scene::Inject::kGrey), clock);
  CHECK(camera.start());
  CHECK(camera.next(frame, 0us) == hal::Capture::kFrame);
  CHECK(camera.next(frame, 39ms) == hal::Capture::kTimeout);
  CHECK(clock.now() == 39ms);
  CHECK(camera.next(frame, 1ms) == hal::Capture::kFrame);
  CHECK(clock.now() == 40ms);
}

TEST(SceneCamera, OddRatesKeepTheirTime) {
  scene::Scene scene = small(scene::Inject::kGrey);
  scene.fps = 18.75;  // seen on Linux
  sim::SceneCamera camera(scene, clock);
  CHECK(camera.start());
  for (int k = 0; k <= 30; ++k) CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  CHECK(frame.timestamp == 1600ms);
}

TEST(SceneCamera, PassedFramesHappenWithoutAPicture) {
  sim::SceneCamera camera(small(scene::Inject::kGrey), clock);
  CHECK(camera.start());
  for (int k = 0; k < 30; ++k) camera.pass();
  CHECK(clock.now() == 0us);
  LONGS_EQUAL(29, camera.snapshot().frame);
  CHECK(camera.next(frame, 2s) == hal::Capture::kFrame);
  LONGS_EQUAL(30, frame.sequence);
  CHECK(frame.timestamp == 1200ms);
}

TEST(SceneCamera, ADriveFromOutsideTakesTheScriptsPlace) {
  std::vector<double> asked_s;
  sim::SceneCamera camera(small(scene::Inject::kGrey), clock, [&](double t_s) {
    asked_s.push_back(t_s);
    return scene::Drive{.force_n = 1.5, .at_mm = {0.1 * t_s, 0.0}};
  });
  CHECK(camera.start());
  for (int k = 0; k < 4; ++k) CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  CHECK((asked_s == std::vector<double>{0.0, 1 / 25.0, 2 / 25.0, 3 / 25.0}));
  DOUBLES_EQUAL(1.5, camera.snapshot().contact.normal_n, 1e-12);
  DOUBLES_EQUAL(0.012, camera.snapshot().object_mm.x, 1e-12);
}

// --- The file ---

TEST(SceneCamera, TheSceneInCodeIsTheSceneInItsFile) {
  const auto read = scene::read_scene_file(holdfast::test::source("tests/scenes/sphere_slip.json"));
  CHECK(read.scene.has_value());
  STRCMP_EQUAL(scene::write_scene(*read.scene).c_str(), scene::write_scene(scene::sphere_slip()).c_str());
}

TEST(SceneCamera, FaultsOfTheSceneAreThePlanInFrames) {
  using sim::CameraFault;
  scene::Scene scene = small(scene::Inject::kGrey);
  scene.fps = 20.0;
  scene.faults = {{.t_s = 1.5, .frames = 2, .fault = scene::Fault::kTorn},
                  {.t_s = 0.25, .frames = 3, .fault = scene::Fault::kLate, .by_ms = 12.5},
                  {.t_s = 1.024, .fault = scene::Fault::kUnplugged}};
  const std::vector<sim::FaultSpan> spans = sim::faults_of(scene);
  LONGS_EQUAL(3, spans.size());
  LONGS_EQUAL(5, spans[0].first);
  LONGS_EQUAL(3, spans[0].count);
  CHECK(spans[0].fault == CameraFault::kLate);
  CHECK(spans[0].by == 12500us);
  LONGS_EQUAL(20, spans[1].first);  // the nearest frame
  LONGS_EQUAL(1, spans[1].count);
  CHECK(spans[1].fault == CameraFault::kGone);
  LONGS_EQUAL(30, spans[2].first);
  CHECK(spans[2].fault == CameraFault::kTorn);

  struct Pair {
    scene::Fault asked;
    CameraFault planned;
  };
  for (const Pair& pair :
       {Pair{scene::Fault::kOff, CameraFault::kOff}, Pair{scene::Fault::kBad, CameraFault::kBad},
        Pair{scene::Fault::kDropped, CameraFault::kDropped}, Pair{scene::Fault::kFrozen, CameraFault::kStuck},
        Pair{scene::Fault::kTorn, CameraFault::kTorn}, Pair{scene::Fault::kGarbage, CameraFault::kGarbage},
        Pair{scene::Fault::kLate, CameraFault::kLate}, Pair{scene::Fault::kBackwards, CameraFault::kBackwards},
        Pair{scene::Fault::kUnplugged, CameraFault::kGone}}) {
    scene.faults = {{.fault = pair.asked}};
    CHECK(sim::faults_of(scene)[0].fault == pair.planned);
  }
  scene.faults.clear();
  CHECK(sim::faults_of(scene).empty());
}

// --- The picture ---

TEST(SceneCamera, SendsJpegOfTheSizeAnnounced) {
  const scene::Scene scene = small(scene::Inject::kJpeg);
  sim::SceneCamera camera(scene, clock);
  CHECK(camera.start());
  CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  CHECK(frame.format == hal::PixelFormat::kMjpeg);
  LONGS_EQUAL(328, frame.width);
  LONGS_EQUAL(246, frame.height);
  LONGS_EQUAL(0xff, frame.bytes[0]);
  LONGS_EQUAL(0xd8, frame.bytes[1]);
  LONGS_EQUAL(0xd9, frame.bytes.back());
  CHECK(frame.bytes.size() <= sim::most_bytes(scene));
}

TEST(SceneCamera, PictureIsAsTheSceneSays) {
  scene::Scene scene = scene::sphere_slip();
  LONGS_EQUAL(3280, sim::picture_of(scene).width);
  LONGS_EQUAL(2464, sim::picture_of(scene).height);
  for (const scene::Inject inject : {scene::Inject::kGrey, scene::Inject::kMarkers}) {
    scene.level.inject = inject;
    LONGS_EQUAL(410, sim::picture_of(scene).width);
    LONGS_EQUAL(308, sim::picture_of(scene).height);
  }
  scene.picture = {.width = 820,
                   .background = 100.0,
                   .dot_level = 30.0,
                   .shading = 5.0,
                   .imprint_gain = 7.0,
                   .wall_gain = 8.0,
                   .specular = 9.0,
                   .shadow = 10.0};
  scene.seed = 9;
  scene.effects.pixel_noise = 1.5;
  scene.effects.exposure_ms = 4.0;
  scene.effects.rolling_shutter_ms = 6.0;
  scene.effects.dirt_specks = 3;
  scene.effects.worn_gel = 0.5;
  const scene::PictureConfig picture = sim::picture_of(scene);
  LONGS_EQUAL(820, picture.width);
  DOUBLES_EQUAL(100.0, picture.background, 0.0);
  DOUBLES_EQUAL(30.0, picture.dot_level, 0.0);
  DOUBLES_EQUAL(5.0, picture.shading, 0.0);
  DOUBLES_EQUAL(7.0, picture.imprint_gain, 0.0);
  CHECK((picture.walls == scene::Walls{.gain = 8.0, .specular = 9.0, .shadow = 10.0}));
  DOUBLES_EQUAL(1.5, picture.noise_sigma, 0.0);
  LONGS_EQUAL(9, picture.seed);
  DOUBLES_EQUAL(4.0, picture.effects.exposure_ms, 0.0);
  DOUBLES_EQUAL(6.0, picture.effects.rolling_shutter_ms, 0.0);
  LONGS_EQUAL(3, picture.effects.dirt_specks);
  DOUBLES_EQUAL(0.5, picture.effects.worn_gel, 0.0);
}

TEST(SceneCamera, BlobsAreTheDots) {
  sim::SceneCamera camera(clean(), clock);
  CHECK(camera.start());
  for (int k = 0; k < 45; ++k) CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
  CHECK(camera.snapshot().contact.gross);
  const std::vector<Blob> blobs = blobs_of(frame);
  LONGS_EQUAL(63, blobs.size());
  // The middle of some 145 whole pixels.
  for (const scene::PointPx& dot : camera.marker_centers()) CHECK(any_at(blobs, dot, 0.2));
}

TEST(SceneCamera, MissingDotsAreNotInThePictureAndDoublesAre) {
  scene::Scene scene = clean();
  scene.effects.marker_missing = 4;
  scene.effects.marker_duplicates = 3;
  scene.effects.fabrication_um = 30.0;
  sim::SceneCamera camera(scene, clock);
  CHECK(camera.start());
  for (int k = 0; k < 45; k += 44) {
    while (camera.snapshot().frame < k) camera.pass();
    CHECK(camera.next(frame, 10s) == hal::Capture::kFrame);
    const std::vector<Blob> blobs = blobs_of(frame);
    LONGS_EQUAL(63, camera.marker_centers().size());
    int printed = 0;
    int doubles = 0;
    for (const scene::Dot& dot : camera.simulation().dots()) {
      const scene::Vec2 u = camera.snapshot().motion_mm[static_cast<std::size_t>(dot.marker)];
      const scene::PointPx place = scene::to_px(camera.picture(), {dot.rest_mm.x + u.x, dot.rest_mm.y + u.y});
      if (!dot.printed) {
        // A double may lie half a pitch away, its rim nearer by its radius.
        CHECK_FALSE(any_at(blobs, place, 3.0));
        continue;
      }
      CHECK(level_at(frame, place) < 60);
      printed += dot.extra ? 0 : 1;
      doubles += dot.extra ? 1 : 0;
    }
    LONGS_EQUAL(59, printed);
    LONGS_EQUAL(3, doubles);
    // A double may touch its dot: then the two are one blob of twice the size.
    CHECK(blobs.size() >= 59 && blobs.size() <= 62);
  }
}

TEST(SceneCamera, LostMarkersAreNotInThePictureOfThatFrame) {
  scene::Scene scene = clean();
  scene.effects.marker_loss = 0.1;
  sim::SceneCamera camera(scene, clock);
  CHECK(camera.start());
  std::vector<scene::SeenMarker> seen;
  int lost = 0;
  for (int k = 0; k < 10; ++k) {
    CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
    scene::see_markers(camera.simulation(), camera.snapshot(), seen);
    const std::vector<Blob> blobs = blobs_of(frame);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      CHECK_EQUAL(seen[i].valid, any_at(blobs, camera.marker_centers()[i], 0.2));
      lost += seen[i].valid ? 0 : 1;
    }
  }
  CHECK(lost > 30 && lost < 100);  // 63 expected, sigma 8
}

TEST(SceneCamera, LightDriftsAndFlickers) {
  scene::Scene scene = clean();
  sim::SceneCamera steady(scene, clock);
  CHECK(steady.start());
  CHECK(steady.next(frame, 1s) == hal::Capture::kFrame);
  const double dark = mean_level(frame);
  scene.effects.light_drift_levels_per_s = -4.0;
  scene.effects.light_flicker_levels = 6.0;
  sim::Clock own;
  sim::SceneCamera camera(scene, own);
  CHECK(camera.start());
  for (int k = 0; k < 80; ++k) {
    if (k > 11 && k % 8 != 0) {  // the empty gel in every frame, then now and then
      camera.pass();
      continue;
    }
    CHECK(camera.next(frame, 10s) == hal::Capture::kFrame);
    // Twice a mains of 50.15 Hz.
    const double t_s = k / 25.0;
    const double light = -4.0 * t_s + 6.0 * std::sin(2.0 * std::numbers::pi * 100.3 * t_s);
    // Whole levels; dots that touch carry the gel's motion, not its area.
    DOUBLES_EQUAL(light, mean_level(frame) - dark, 0.6);
  }
}

// The camera's own picture of a moving frame against the renderer's, told by hand where dots and imprint were.
TEST(SceneCamera, ExposureBlursFromWhereDotsAndImprintWere) {
  scene::Scene scene = clean();
  scene.picture.imprint_gain = 1000.0;  // a place off by a frame is then off by some levels
  scene.effects.exposure_ms = 6.0;
  scene.effects.rolling_shutter_ms = 4.0;  // with the exposure a quarter of the frame
  sim::SceneCamera camera(scene, clock);
  CHECK(camera.start());
  while (camera.snapshot().frame < 43) camera.pass();
  const scene::ContactState last = camera.snapshot().contact;
  CHECK(camera.next(frame, 10s) == hal::Capture::kFrame);
  const scene::Snapshot& now = camera.snapshot();
  const auto dots = scene::dot_centers_px(camera.picture(), camera.simulation().markers(), now.before_mm);
  const auto dots_end = scene::dot_centers_px(camera.picture(), camera.simulation().markers(), now.motion_mm);
  scene::ContactState start = now.contact;
  start.center_mm = {0.25 * last.center_mm.x + 0.75 * now.contact.center_mm.x,
                     0.25 * last.center_mm.y + 0.75 * now.contact.center_mm.y};
  CHECK(start.center_mm.x - last.center_mm.x > 0.2);  // 8 mm/s for 30 ms
  const scene::Imprint opened = scene::imprint_px(camera.picture(), start);
  const scene::Imprint closed = scene::imprint_px(camera.picture(), now.contact);
  std::vector<std::uint8_t> expected;
  scene::render_luma(camera.picture(),
                     {.dots = dots, .dots_end = dots_end, .contact = &opened, .contact_end = &closed, .seed = 44},
                     expected);
  int worst = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) worst = std::max(worst, std::abs(expected[i] - frame.bytes[i]));
  CHECK(worst <= 1);  // the same sums in another order
}
