// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/film.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "toolchain/learn/plan.hpp"

namespace holdfast::trade {
namespace {

struct Choice {
  std::string_view object;
  std::string_view primitive;
  scene::GraspKind kind;
};
// Relief and none; slide, twist and circle.
constexpr std::array<Choice, kFilms> kChoices{{
    {"box", "translate_x", scene::GraspKind::kSlip},
    {"box", "translate_x", scene::GraspKind::kMatched},
    {"ball", "rotate_z", scene::GraspKind::kSlip},
    {"ball", "rotate_z", scene::GraspKind::kMatched},
    {"sponge", "planar_xy", scene::GraspKind::kShaken},
    {"duck", "translate_y", scene::GraspKind::kSlow},
}};
// The committed trees learned from seeds up to 11 (toolchain/model/train.sh).
constexpr std::uint64_t kSeed = 907;
// Sigma of the sensor's picture, grey levels, at the quality that it sends.
constexpr double kNoise = 3.0;

learn::PlannedGrasp planned(const Choice& choice) {
  learn::PlannedGrasp out;
  out.object = std::ranges::find(scene::kPaperObjects, choice.object, &scene::PaperObject::name);
  out.primitive = std::ranges::find(scene::kPrimitives, choice.primitive, &scene::Primitive::name);
  out.kind = choice.kind;
  out.seed = kSeed;
  return out;
}

DisplacementField moved(const scene::Snapshot& truth, const scene::Scene& scene) {
  DisplacementField out;
  Saturations ignored;
  out.grid = {static_cast<std::uint8_t>(scene.markers.rows), static_cast<std::uint8_t>(scene.markers.cols)};
  const auto micrometres = [&](double mm) { return Micrometres::saturate(std::llround(mm * 1e3), ignored); };
  for (std::size_t i = 0; i < truth.motion_mm.size(); ++i) {
    out.markers[i] = {micrometres(truth.motion_mm[i].x), micrometres(truth.motion_mm[i].y), true};
  }
  return out;
}

}  // namespace

int picture_height(int width) {
  return scene::scaled(scene::camera_3280x2464(), width).height;
}

Film shoot(int which, int picture_width, const std::function<bool()>& go_on) {
  const Choice& choice = kChoices[static_cast<std::size_t>(which)];
  learn::Planned grasp = planned(choice).make();
  grasp.scene.level.inject = scene::Inject::kJpeg;
  grasp.scene.picture.width = picture_width;
  grasp.scene.effects.pixel_noise = kNoise;
  sim::Clock clock;
  sim::SceneCamera camera(grasp.scene, clock);
  Film film;
  film.width = camera.picture().width;
  film.height = camera.picture().height;
  hal::Frame frame;
  if (!camera.start()) return film;
  while ((!go_on || go_on()) && camera.next(frame, std::chrono::seconds{1}) == hal::Capture::kFrame) {
    const scene::Snapshot& truth = camera.snapshot();
    const auto centers = camera.marker_centers();
    film.shots.push_back({frame.timestamp,
                          {frame.bytes.begin(), frame.bytes.end()},
                          {centers.begin(), centers.end()},
                          moved(truth, grasp.scene)});
    camera.release(frame);
  }
  return film;
}

}  // namespace holdfast::trade
