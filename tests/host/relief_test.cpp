// SPDX-License-Identifier: Apache-2.0
// Reliefs of scenes in the pictures of their camera: that they lie and move where the truth has the object, and that
// the dots are the gel's.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"
#include "tests/support/scene_named.hpp"
#include "toolchain/play/paper.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::scene;

namespace {

// One scene filmed frame by frame.
struct FilmedScene {
  explicit FilmedScene(const Scene& scene) : camera(scene, clock) { CHECK(camera.start()); }

  // The picture at a time; what came before happens unseen.
  std::vector<std::uint8_t> at(double t_s) {
    const auto frame_index = std::lround(t_s * camera.simulation().scene().fps);
    while (camera.snapshot().frame + 1 < frame_index) camera.pass();
    hal::Frame frame;
    CHECK(camera.next(frame, std::chrono::seconds(100)) == hal::Capture::kFrame);
    LONGS_EQUAL(frame_index, camera.snapshot().frame);
    return {frame.bytes.begin(), frame.bytes.end()};
  }

  sim::Clock clock;
  sim::SceneCamera camera;
};

// Whole pixels by which the picture moved, least squares over a square of 91 px around a place: to 0.75 px, since one
// halfway between two pixels may go to either.
struct Shift {
  int x = 0;
  int y = 0;
};

Shift shift(const std::vector<std::uint8_t>& from, const std::vector<std::uint8_t>& to, PointPx near) {
  constexpr int kHalf = 45;
  constexpr int kMost = 16;
  const auto level = [](const std::vector<std::uint8_t>& picture, int x, int y) {
    return static_cast<int>(picture[static_cast<std::size_t>(y * 410 + x)]);
  };
  const int cx = static_cast<int>(near.x);
  const int cy = static_cast<int>(near.y);
  Shift best;
  long least = -1;
  for (int dy = -kMost; dy <= kMost; ++dy) {
    for (int dx = -kMost; dx <= kMost; ++dx) {
      long sum = 0;
      for (int y = cy - kHalf; y <= cy + kHalf; ++y) {
        for (int x = cx - kHalf; x <= cx + kHalf; ++x) {
          const int off = level(to, x + dx, y + dy) - level(from, x, y);
          sum += off * off;
        }
      }
      if (least >= 0 && sum >= least) continue;
      least = sum;
      best = {dx, dy};
    }
  }
  return best;
}

// The object without the dots, which would tell their own motion.
Scene bare(Scene scene) {
  scene.effects = {.marker_loss = 1.0};
  scene.picture.shading = 0.0;
  scene.picture.imprint_gain = 240.0;  // rounding to levels is small beside the relief
  return scene;
}

// Marker motion nearest to the contact.
Vec2 gel_motion(const sim::SceneCamera& camera) {
  std::size_t nearest = 0;
  const auto markers = camera.simulation().markers();
  const Vec2 middle = camera.snapshot().contact.center_mm;
  for (std::size_t i = 0; i < markers.size(); ++i) {
    const Vec2 here = markers[i] + camera.snapshot().motion_mm[i];
    const Vec2 there = markers[nearest] + camera.snapshot().motion_mm[nearest];
    if (length(here - middle) < length(there - middle)) nearest = i;
  }
  return camera.snapshot().motion_mm[nearest];
}

}  // namespace

TEST_GROUP(Relief){};

// The camera's own picture against the renderer's, told by hand where the object was and is.
TEST(Relief, TheCameraShowsItWhereTheObjectIs) {
  Scene scene = test::scene_named("relief_slip_20_mm_s");
  scene.effects = {.exposure_ms = 6.0, .rolling_shutter_ms = 4.0};  // a quarter of a frame in all
  for (Waypoint& point : scene.trajectory) {
    if (point.x_mm) point.twist_deg = 5.0 * *point.x_mm;
  }
  FilmedScene film(scene);
  film.at(1.36);
  const ContactState last = film.camera.snapshot().contact;
  const std::vector<std::uint8_t> picture = film.at(1.40);
  const Snapshot& now = film.camera.snapshot();
  const PictureConfig& config = film.camera.picture();
  const auto dots = dot_centers_px(config, film.camera.simulation().markers(), now.before_mm);
  const auto dots_end = dot_centers_px(config, film.camera.simulation().markers(), now.motion_mm);
  // 20 mm/s and 100 degrees/s, 0.2 s after it started at (-4, -0.3) mm.
  ContactState opening = now.contact;
  opening.center_mm = {0.25 * last.center_mm.x + 0.75 * now.contact.center_mm.x, now.contact.center_mm.y};
  const double degree = std::acos(-1.0) / 180.0;
  const Imprint open = imprint_px(config, opening, {-4.0 + 20.0 * 0.19, -0.3}, 19.0 * degree);
  const Imprint closed = imprint_px(config, now.contact, {-4.0 + 20.0 * 0.2, -0.3}, 20.0 * degree);
  const Underside underside(scene.object.shape, scene.object.relief, scene.seed, lens_sigma_mm(config));
  std::vector<std::uint8_t> expected;
  PictureFrame frame{.dots = dots, .dots_end = dots_end, .contact = &open, .contact_end = &closed, .seed = 35};
  render_luma(config, frame, expected);
  long without = 0;
  for (std::size_t i = 0; i < picture.size(); ++i) without += std::abs(picture[i] - expected[i]);
  frame.underside = &underside;
  render_luma(config, frame, expected);
  long differing = 0;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    CHECK(std::abs(picture[i] - expected[i]) <= 1);
    differing += picture[i] != expected[i] ? 1 : 0;
  }
  CHECK(without > 5000);
  CHECK(differing < 100);  // places computed in another order
}

TEST(Relief, OfAGluedObjectMovesWithTheGel) {
  FilmedScene film(bare(test::scene_named("relief_shaken")));
  const auto from = film.at(1.32);
  const Vec2 object = film.camera.snapshot().object_mm;
  const Vec2 gel = gel_motion(film.camera);
  const PointPx middle = to_px(film.camera.picture(), film.camera.snapshot().contact.center_mm);
  const auto to = film.at(1.48);
  const Vec2 way = film.camera.snapshot().object_mm - object;
  const double scale = film.camera.picture().px_per_mm;
  CHECK(length(way) * scale > 10.0);
  const Shift seen = shift(from, to, middle);
  DOUBLES_EQUAL(way.x * scale, seen.x, 0.75);
  DOUBLES_EQUAL(way.y * scale, seen.y, 0.75);
  const Vec2 gel_way = gel_motion(film.camera) - gel;
  DOUBLES_EQUAL(way.x * scale, gel_way.x * scale, 0.3);
  DOUBLES_EQUAL(way.y * scale, gel_way.y * scale, 0.3);
}

TEST(Relief, OfASlidingObjectRunsOverTheGel) {
  FilmedScene film(bare(test::scene_named("relief_slide_1_mm_s")));
  const auto from = film.at(3.0);
  const Vec2 gel = gel_motion(film.camera);
  const PointPx middle = to_px(film.camera.picture(), film.camera.snapshot().contact.center_mm);
  const auto to = film.at(3.6);
  CHECK(film.camera.snapshot().contact.gross);
  const Shift seen = shift(from, to, middle);
  const double scale = film.camera.picture().px_per_mm;
  DOUBLES_EQUAL(0.6 * 0.8 * scale, seen.x, 0.75);  // 6.9 px of 0.6 mm along (4, 3) / 5
  DOUBLES_EQUAL(0.6 * 0.6 * scale, seen.y, 0.75);
  CHECK(length(gel_motion(film.camera) - gel) * scale < 1.0);  // its contact travels on: the field with it
}

TEST(Relief, ATwistTurnsIt) {
  Scene scene = bare(test::scene_named("relief_twist"));
  FilmedScene film(scene);
  const auto from = film.at(2.0);
  const Vec2 middle = film.camera.snapshot().contact.center_mm;
  // 30 degrees/s: a place 2 mm beside the middle moves by 0.84 mm in 0.8 s.
  const auto to = film.at(2.8);
  const double degree = std::acos(-1.0) / 180.0;
  DOUBLES_EQUAL(48.0 * degree, film.camera.snapshot().object_rad, 1e-9);
  const PictureConfig& config = film.camera.picture();
  const auto level = [&](const std::vector<std::uint8_t>& picture, Vec2 mm) {
    const PointPx place = to_px(config, mm);
    return picture[static_cast<std::size_t>(std::lround(place.y) * config.width + std::lround(place.x))] - 120.0;
  };
  // Slopes turn with the object and the lamps do not: half a turn of the object would invert them, so they are compared
  // with what the underside says.
  const Underside underside(scene.object.shape, scene.object.relief, scene.seed, lens_sigma_mm(config));
  const ContactState& contact = film.camera.snapshot().contact;
  double with = 0.0;
  double against = 0.0;
  double squares = 0.0;
  double levels = 0.0;
  for (double y = -2.0; y < 2.0; y += 0.11) {
    for (double x = -2.0; x < 2.0; x += 0.11) {
      const Vec2 at = middle + Vec2{x, y};
      const auto green = [&](double turn_rad) {
        const auto slope = underside.surface({middle, turn_rad, contact.depth_mm, contact.contact_radius_mm}, at).slope;
        return -0.38 * slope.x + 0.16 * slope.y;  // luma's lamp
      };
      const double a = contact.depth_mm / contact.contact_radius_mm / contact.contact_radius_mm;
      const double relief = level(to, at) - 240.0 * a * (-0.38 * x + 0.16 * y);
      with += relief * green(48.0 * degree);
      against += relief * green(24.0 * degree);
      squares += green(48.0 * degree) * green(48.0 * degree);
      levels += relief * relief;
    }
  }
  CHECK(with > 0.95 * std::sqrt(squares * levels));
  CHECK(std::abs(against) < 0.3 * std::sqrt(squares * levels));
  CHECK(from != to);
}

TEST(Relief, OfThePapersObjectsIsInPicturesAlone) {
  int rough = 0;
  for (const PaperObject& object : kPaperObjects) {
    const Scene markers = grasp_trial(object, kPrimitives[0], GraspKind::kSlip, 5);
    Level level = markers.level;
    level.inject = Inject::kGrey;
    const Scene grey = grasp_trial(object, kPrimitives[0], GraspKind::kSlip, 5, level);
    CHECK(markers.object.relief == holdfast::scene::Relief{});
    CHECK(grey.object.relief == object.relief);
    CHECK(markers.object.shape == grey.object.shape);
    CHECK(markers.trajectory == grey.trajectory);
    rough += object.relief.kind != ReliefKind::kNone ? 1 : 0;
    // Both are scenes that the reader takes without a warning.
    for (const Scene& scene : {markers, grey}) {
      const SceneResult read = read_scene(write_scene(scene), "trial");
      CHECK(read.scene.has_value());
    }
  }
  CHECK(rough >= 6 && rough <= 12);
}
