// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/film.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "toolchain/learn/study.hpp"
#include "toolchain/play/play.hpp"

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
constexpr std::uint64_t kLessonSeed = 911;
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

std::vector<learn::PlannedGrasp> planned_grasps(std::uint64_t seed, int every) {
  learn::Plan plan;
  learn::PlanOptions options;
  options.seed = seed;
  (void)learn::make_plan(options, plan);  // all objects and kinds: nothing to be refused
  return learn::thinned(plan, every);
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
  film.trial = grasp.trial;
  film.width = camera.picture().width;
  film.height = camera.picture().height;
  std::vector<learn::Truth> truths;
  hal::Frame frame;
  if (!camera.start()) return film;
  while ((!go_on || go_on()) && camera.next(frame, std::chrono::seconds{1}) == hal::Capture::kFrame) {
    const scene::Snapshot& truth = camera.snapshot();
    const auto centers = camera.marker_centers();
    film.shots.push_back({frame.timestamp,
                          {frame.bytes.begin(), frame.bytes.end()},
                          {centers.begin(), centers.end()},
                          moved(truth, grasp.scene)});
    truths.push_back({truth.contact.normal_n, truth.level});
    camera.release(frame);
  }
  film.labels = learn::labels_of(truths);
  film.trial.count = static_cast<int>(film.shots.size());
  return film;
}

Grasp play(const learn::PlannedGrasp& grasp) {
  const learn::Planned planned = grasp.make();
  Grasp out;
  out.trial = planned.trial;
  scene::Simulation simulation(planned.scene);
  const scene::PictureConfig picture = scene::scaled(scene::camera_3280x2464(), 410);
  std::vector<learn::Truth> truths;
  std::vector<scene::SeenMarker> seen;
  Saturations ignored;
  for (int k = 0; k < scene::frame_count(planned.scene); ++k) {
    const scene::Snapshot& truth = simulation.next();
    scene::see_markers(simulation, truth, seen);
    Sight& sight = out.sights.emplace_back();
    sight.time = Micros(std::llround(truth.t_s * 1e6) + 1);
    sight.moved = moved(truth, planned.scene);
    sight.markers = tool::field_of(planned.scene, picture, seen, ignored);
    truths.push_back({truth.contact.normal_n, truth.level});
  }
  out.labels = learn::labels_of(truths);
  out.trial.count = static_cast<int>(out.sights.size());
  return out;
}

std::vector<learn::PlannedGrasp> planned_grasps(int every) {
  return planned_grasps(kSeed, every);
}

std::vector<learn::PlannedGrasp> grasps_to_learn_from(int every) {
  return planned_grasps(kLessonSeed, every);
}

}  // namespace holdfast::trade
