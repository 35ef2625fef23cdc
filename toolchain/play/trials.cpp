// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/trials.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "toolchain/play/hand.hpp"
#include "toolchain/play/paper.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::tool {
namespace {

using scene::Relief;
using scene::ReliefKind;
using scene::Scene;
using scene::Shape;
using scene::ShapeKind;
using scene::Span;
using scene::Vec2;
using std::numbers::pi;

class Dice {
 public:
  Dice(TrialKind kind, std::uint64_t seed, int number)
      : random_(seed, 0x747269616cU + static_cast<std::uint64_t>(kind), static_cast<std::uint64_t>(number)) {}
  double in(Span span) { return span.least + (span.most - span.least) * random_.uniform(); }
  // Each factor as likely as another.
  double log_in(Span span) {
    return span.least * scene::portable::exp(random_.uniform() * scene::portable::log(span.most / span.least));
  }
  bool chance(double share) { return random_.uniform() < share; }
  int among(int count) { return random_.below(count); }
  std::uint64_t seed() { return random_.next(); }

 private:
  scene::Random random_;
};

// The last is what is missed most: it changes by no more than the threshold, however far it slides (imprint.hpp).
constexpr std::array<Relief, 5> kReliefs{{{ReliefKind::kBumps, 40, 0.8},
                                          {ReliefKind::kRidges, 25, 0.6},
                                          {ReliefKind::kGrain, 60, 0.7},
                                          {ReliefKind::kGrain, 40, 1.0},
                                          {ReliefKind::kGrain, 15, 0.5}}};
constexpr double kEmpty_s = 0.6;  // the firmware learns its rest in ten frames
constexpr double kDegree = pi / 180.0;

void finish(Scene& scene, Dice& dice, TrialKind kind, std::string_view what, int number) {
  scene.seed = dice.seed();
  scene.name = fmt::format("{}_{}_{}", kTrialNames[static_cast<std::size_t>(kind)], what, number);
  scene.level.inject = scene::Inject::kGrey;
  scene.level.contact =
      scene::as_round(scene.object.shape) ? scene::ContactLevel::kSprings : scene::ContactLevel::kGrid;
}

// Measured on 2026-11-24 on 60 closings and on 78 recorded ones, between the dots, after a blur of 0.12 mm: change of
// luma within 120 ms of the touch, rms 3.2 levels here and 3.4 there (median; 90th percentile 7.4 and 7.5), its 99th
// percentile 17 and 12 (39 and 26); slope of what the touch adds, 99th percentile, 37 and 39 levels a millimetre (86
// and 119, of which a part is dots that moved).
void light(Scene& scene, Dice& dice) {
  const double strength = dice.chance(0.15) ? dice.in({0.0, 0.3}) : dice.in({0.3, 1.0});
  scene.picture.imprint_gain = 30.0 + 270.0 * strength;
  scene.picture.wall_gain = strength * dice.in({0.0, 400.0});
  scene.picture.specular = strength * dice.in({0.0, 150.0});
  scene.picture.shadow = strength * dice.in({0.0, 80.0});
  scene.effects.pixel_noise = dice.in({0.5, 3.0});
  scene.effects.exposure_ms = dice.in({2.0, 12.0});
  scene.effects.dot_shading_levels = dice.in({0.0, 10.0});
  scene.effects.fabrication_um = dice.in({20.0, 60.0});
}

struct Body {
  std::string_view name;
  Shape shape;
};

Shape drawn(std::string_view name, Dice& dice) {
  Shape shape;
  shape.yaw_rad = dice.in({0.0, pi});
  if (name == "sphere") {
    shape.kind = ShapeKind::kSphere;
    shape.radius_mm = dice.log_in({5.0, 35.0});
    shape.yaw_rad = 0.0;
  } else if (name == "cylinder") {
    shape.kind = ShapeKind::kCylinder;
    shape.radius_mm = dice.log_in({4.0, 25.0});
  } else if (name == "ellipsoid") {
    shape.kind = ShapeKind::kEllipsoid;
    shape.radius_mm = dice.log_in({6.0, 25.0});
    shape.radius_y_mm = dice.log_in({6.0, 25.0});
  } else if (name == "edge") {
    shape.kind = ShapeKind::kEdge;
    shape.radius_mm = dice.in({0.5, 4.0});
    shape.flank_deg = dice.in({15.0, 35.0});
  } else if (name == "flat") {
    const bool disc = dice.chance(0.3);
    shape.kind = disc ? ShapeKind::kDisc : ShapeKind::kBox;
    const double radius_mm = dice.in({3.0, 7.0});
    const double half_x_mm = dice.in({3.0, 7.0});
    const double half_y_mm = dice.in({3.0, 6.0});
    if (disc) {
      shape.radius_mm = radius_mm;
    } else {
      shape.half_x_mm = half_x_mm;
      shape.half_y_mm = half_y_mm;
    }
    shape.rim_mm = dice.in({0.4, 2.0});
    shape.tilt_rad = dice.in({-0.02, 0.02});
  } else {  // fruit: a smooth body with low bumps of several mm
    shape.kind = ShapeKind::kEllipsoid;
    shape.radius_mm = dice.in({12.0, 30.0});
    shape.radius_y_mm = dice.in({12.0, 30.0});
    shape.texture = scene::TextureKind::kBumps;
    shape.texture_pitch_mm = dice.in({2.5, 6.0});
    shape.texture_height_mm = dice.in({0.05, 0.3});
  }
  return shape;
}

Relief drawn_relief(Dice& dice) {
  return {static_cast<ReliefKind>(1 + dice.among(3)), dice.log_in({8.0, 80.0}), dice.log_in({0.35, 1.5})};
}

scene::Waypoint at(double t_s, Vec2 mm) {
  return {.t_s = t_s, .x_mm = mm.x, .y_mm = mm.y};
}

Vec2 along(double angle_rad, double way_mm) {
  return {way_mm * scene::portable::cos(angle_rad), way_mm * scene::portable::sin(angle_rad)};
}

struct Grip {
  scene::FrictionLimit limit;
  double way_mm = 0.0;  // of the fingers since they touched
  Vec2 at_mm;           // of the object when they have closed
  double from_s = 0.0;
  double closed_s = 0.0;
};

// Empty gel, then the object comes straight down on a drawn place.
Grip close_on(Scene& scene, Dice& dice, Span speed_mm_s) {
  scene.gel.shear_modulus_mpa = dice.in({0.035, 0.110});
  scene.object.friction = dice.in({0.4, 1.0});
  scene.object.touch_mm = {dice.in({-6.0, 6.0}), dice.in({-4.5, 4.5})};
  const double press_n = dice.log_in({0.6, 8.0});
  Grip grip;
  grip.limit = scene::friction_limit(scene.object.shape, scene.gel, scene.object.friction, press_n);
  // Hard bodies are closed on within a frame or two, soft ones within a second.
  scene.object.compliance_mm_per_n = dice.chance(0.4) ? dice.log_in({0.02, 0.2}) : dice.log_in({0.2, 3.0});
  grip.way_mm = grip.limit.depth_mm + scene.object.compliance_mm_per_n * press_n;
  grip.from_s = kEmpty_s + 0.04 * dice.in({0.0, 1.0});  // at any time of a frame
  const double speed = dice.log_in(speed_mm_s);
  grip.closed_s = grip.from_s + grip.way_mm / speed;
  // Fingers do not meet quite straight: what is held goes sideways with them, within what the grip holds.
  grip.at_mm = along(dice.in({0.0, 2.0 * pi}), grip.limit.slide_mm * dice.in({0.0, 0.22}));
  scene.trajectory = {{.t_s = grip.from_s, .closing_mm = 0.0, .x_mm = 0.0, .y_mm = 0.0}};
  // The other finger comes later: half of the grips close in two strokes.
  const double first = dice.in({0.3, 0.7});
  const double wait_s = dice.in({0.08, 0.4});
  if (dice.chance(0.5)) {
    const Vec2 there = first * grip.at_mm;
    const double stop_s = grip.from_s + first * grip.way_mm / speed;
    for (const double t_s : {stop_s, stop_s + wait_s})
      scene.trajectory.push_back({.t_s = t_s, .closing_mm = first * grip.way_mm, .x_mm = there.x, .y_mm = there.y});
    grip.closed_s += wait_s;
  }
  scene.trajectory.push_back(
      {.t_s = grip.closed_s, .closing_mm = grip.way_mm, .x_mm = grip.at_mm.x, .y_mm = grip.at_mm.y});
  return grip;
}

// One of closing, closing_slip and easing.
Trial closing(std::uint64_t seed, int number, TrialKind kind) {
  constexpr std::array<std::string_view, 6> kBodies{"sphere", "cylinder", "ellipsoid", "edge", "flat", "fruit"};
  // The same dice: the grasp is the same in all three.
  Dice dice(TrialKind::kClosing, seed, number);
  const std::string_view body = kBodies[static_cast<std::size_t>(number) % kBodies.size()];
  Trial trial;
  Scene& scene = trial.scene;
  scene.object.shape = drawn(body, dice);
  const bool rough = dice.chance(0.4);
  const Relief relief = drawn_relief(dice);
  if (rough) scene.object.relief = relief;
  light(scene, dice);
  Grip grip = close_on(scene, dice, {5.0, 100.0});
  trial.group = fmt::format("{}{}", body, rough ? ", relief" : "");
  trial.closed_s = grip.closed_s;
  const bool shaken = dice.chance(0.5);
  const double angle = dice.in({0.0, 2.0 * pi});
  double end_s = grip.closed_s + 0.6;
  if (kind == TrialKind::kClosingSlip) {
    const double speed_mm_s = dice.log_in({10.0, 60.0});
    const double way_mm = std::min(2.0 * grip.limit.slide_mm + 0.35 * speed_mm_s, 8.0);
    trial.slips = true;
    trial.moved_s = grip.closed_s + 0.1;
    end_s = trial.moved_s + way_mm / speed_mm_s;
    scene.trajectory.push_back(at(trial.moved_s, grip.at_mm));
    scene.trajectory.push_back(at(end_s, grip.at_mm + along(angle, way_mm)));
  } else if (kind == TrialKind::kEasing) {
    scene.object.bonded = true;
    trial.moved_s = end_s;
    scene.trajectory.push_back({.t_s = end_s, .closing_mm = grip.way_mm});
    end_s += dice.log_in({0.2, 2.0});
    grip.way_mm *= dice.in({0.3, 0.8});
    for (const double t_s : {end_s, end_s + 0.6}) scene.trajectory.push_back({.t_s = t_s, .closing_mm = grip.way_mm});
    end_s += 0.6;
  } else if (shaken) {
    // To and fro; with the way aside, less than half of the one at which all of the contact would slide.
    trial.moved_s = end_s;
    scene.trajectory.push_back(at(end_s, grip.at_mm));
    double way_mm = grip.limit.slide_mm * dice.in({0.06, 0.15});
    const double half_s = 0.5 / dice.in({1.0, 5.0});
    for (int k = 0; k < 4; ++k) {
      end_s += k == 0 ? 0.5 * half_s : half_s;
      scene.trajectory.push_back(at(end_s, grip.at_mm + along(angle, way_mm)));
      way_mm = -way_mm;
    }
    scene.profile = scene::Profile::kMinimumJerk;
  }
  if (trial.moved_s == 0.0) scene.trajectory.push_back({.t_s = end_s});
  scene.trajectory.back().closing_mm = grip.way_mm;
  scene.duration_s = end_s + 0.2;
  finish(scene, dice, kind, body, number);
  return trial;
}

// Reliefs on a ball, a face with raised letters or dots, and three bodies that show none. Held: the same grasps, turned
// there and back within what the grip holds.
Trial turn(std::uint64_t seed, int number, bool slips) {
  constexpr std::array<std::string_view, 6> kBodies{"grain", "ridges", "logo", "sphere", "flat", "cylinder"};
  constexpr std::array<int, 3> kRates_deg_s{15, 40, 90};
  constexpr std::array<int, 3> kWithin{6, 4, 3};
  Dice dice(TrialKind::kTurn, seed, number);
  const std::string_view body = kBodies[static_cast<std::size_t>(number) % kBodies.size()];
  const std::size_t rate = static_cast<std::size_t>(number) / kBodies.size() % kRates_deg_s.size();
  Trial trial;
  Scene& scene = trial.scene;
  const bool rough = body == "grain" || body == "ridges";
  scene.object.shape = drawn(rough ? "sphere" : body == "logo" ? "flat" : body, dice);
  if (rough) {
    scene.object.shape.radius_mm = dice.in({10.0, 25.0});
    scene.object.relief = {body == "grain" ? ReliefKind::kGrain : ReliefKind::kRidges, dice.log_in({15.0, 60.0}),
                           dice.in({0.5, 1.2})};
  }
  if (body == "logo") {
    scene.object.shape.texture = scene::TextureKind::kBumps;
    scene.object.shape.texture_pitch_mm = dice.in({2.0, 3.5});
    scene.object.shape.texture_height_mm = dice.in({0.08, 0.2});
  }
  light(scene, dice);
  const Grip grip = close_on(scene, dice, {5.0, 100.0});
  const double rate_deg_s = kRates_deg_s[rate];
  trial.group = fmt::format("{} deg/s, {}", kRates_deg_s[rate], rough || body == "logo" ? "relief" : "smooth");
  trial.slips = slips;
  trial.closed_s = grip.closed_s;
  trial.moved_s = grip.closed_s + dice.in({0.3, 0.6});
  trial.within_frames = kWithin[rate];
  scene.trajectory.push_back({.t_s = trial.moved_s, .twist_deg = 0.0});
  const double sense = dice.chance(0.5) ? 1.0 : -1.0;
  double end_s = trial.moved_s;
  if (slips) {
    const double turn_deg = 1.5 * grip.limit.turn_rad / kDegree + 0.6 * rate_deg_s;
    end_s += turn_deg / rate_deg_s;
    scene.trajectory.push_back({.t_s = end_s, .closing_mm = grip.way_mm, .twist_deg = sense * turn_deg});
  } else {
    // Half-slip of a ball is at 0.46 of the limit (Lubkin: c = 0.71 a). The ends of a strip let go sooner than the rim
    // of the disc of its area.
    const double turn_deg = grip.limit.turn_rad / kDegree * dice.in({0.05, body == "cylinder" ? 0.12 : 0.3});
    const double way_s = turn_deg / rate_deg_s;
    for (const double after_s : {way_s, way_s + 0.6})
      scene.trajectory.push_back({.t_s = trial.moved_s + after_s, .twist_deg = sense * turn_deg});
    scene.trajectory.push_back({.t_s = trial.moved_s + 2.0 * way_s + 0.6, .twist_deg = 0.0});
    end_s += 2.0 * way_s + 1.0;
    scene.trajectory.push_back({.t_s = end_s, .closing_mm = grip.way_mm, .twist_deg = 0.0});
  }
  scene.duration_s = end_s;
  finish(scene, dice, slips ? TrialKind::kTurn : TrialKind::kTurnHeld, body, number);
  return trial;
}

// From 4 mm before a drawn place to 4 mm beyond it, or for 1.2 s.
Trial slide(std::uint64_t seed, int number) {
  constexpr std::array<int, 6> kSpeeds_mm_s{2, 5, 10, 20, 50, 100};
  Dice dice(TrialKind::kSlide, seed, number);
  const std::size_t speed = static_cast<std::size_t>(number) / kReliefs.size() % kSpeeds_mm_s.size();
  Trial trial;
  Scene& scene = trial.scene;
  scene.object.relief = kReliefs[static_cast<std::size_t>(number) % kReliefs.size()];
  scene.object.shape.yaw_rad = dice.in({0.0, pi});
  const double angle = dice.in({0.0, 2.0 * pi});
  const Vec2 middle{dice.in({-2.0, 2.0}), dice.in({-1.5, 1.5})};
  const Vec2 back = along(angle, -4.0);
  scene.object.touch_mm = {middle.x + back.x, middle.y + back.y};
  const double press_n = dice.in({1.0, 2.5});
  trial.group = fmt::format("{} mm/s", kSpeeds_mm_s[speed]);
  trial.slips = true;
  trial.closed_s = 1.0;
  trial.moved_s = dice.in({1.2, 1.24});
  const double way_mm = std::min(8.0, 1.2 * kSpeeds_mm_s[speed]);
  const double end_s = trial.moved_s + way_mm / kSpeeds_mm_s[speed];
  scene.trajectory = {{.t_s = kEmpty_s, .force_n = 0.0},
                      {.t_s = trial.closed_s, .force_n = press_n},
                      at(trial.moved_s, {}),
                      {.t_s = end_s, .force_n = press_n}};
  const Vec2 end = along(angle, way_mm);
  scene.trajectory.back().x_mm = end.x;
  scene.trajectory.back().y_mm = end.y;
  scene.effects = {.pixel_noise = 2.0, .exposure_ms = 5.0};
  scene.duration_s = end_s + 0.3;
  finish(scene, dice, TrialKind::kSlide, fmt::format("{}_mm_s", kSpeeds_mm_s[speed]), number);
  return trial;
}

// Pressed on by 0.8 to 3 N and shaken to and fro, by 0.1 to 0.8 mm.
Trial shaken(std::uint64_t seed, int number) {
  constexpr double kLong_s = 15.0;
  Dice dice(TrialKind::kShaken, seed, number);
  Trial trial;
  Scene& scene = trial.scene;
  const std::size_t relief = static_cast<std::size_t>(number) % kReliefs.size();
  scene.object.relief = kReliefs[relief];
  scene.object.bonded = true;
  trial.group = scene::kReliefNames[static_cast<std::size_t>(kReliefs[relief].kind)];
  trial.closed_s = 1.0;
  trial.moved_s = 1.5;
  const double press_n = dice.in({0.8, 3.0});
  scene.trajectory = {{.t_s = kEmpty_s, .force_n = 0.0}, {.t_s = trial.closed_s, .force_n = press_n}, at(1.5, {})};
  double way_mm = dice.in({0.1, 0.8});
  const double angle = dice.in({0.0, pi});
  double t_s = trial.moved_s;
  while (t_s < kLong_s) {
    t_s += 0.5 / dice.in({1.0, 6.0});
    scene.trajectory.push_back(at(t_s, along(angle, way_mm)));
    way_mm = -way_mm;
  }
  scene.profile = scene::Profile::kMinimumJerk;
  scene.effects.pixel_noise = 2.0;
  scene.duration_s = t_s + 0.2;
  finish(scene, dice, TrialKind::kShaken, trial.group, number);
  return trial;
}

// When the grip begins to open for the last time; 0: it never does.
double opens_s(const std::vector<scene::Waypoint>& trajectory) {
  double from_s = 0.0;
  double later = 0.0;
  for (std::size_t i = trajectory.size(); i-- > 0;) {
    const scene::Waypoint& at = trajectory[i];
    const std::optional<double>& grip = at.closing_mm ? at.closing_mm : at.force_n;
    if (!grip) continue;
    if (later > 0.0 && *grip <= later) break;
    later = *grip;
    from_s = at.t_s;
  }
  return later > 0.0 ? from_s : 0.0;
}

// Each 600 of them are all objects, motions and outcomes of one seed; a few are a little of each.
Trial paper_trial(std::uint64_t seed, int number, bool smooth) {
  constexpr int kObjects = 10;  // those that the paper trains with come first
  constexpr auto kKinds = static_cast<int>(scene::kGraspKinds.size());
  constexpr int kAll = kObjects * static_cast<int>(scene::kPrimitives.size()) * kKinds;
  constexpr int kStep = 37;  // no factor of theirs
  const int index = number % kAll * kStep % kAll;
  const auto kind = static_cast<scene::GraspKind>(index % kKinds);
  const scene::PaperObject& object = scene::kPaperObjects[static_cast<std::size_t>(index / kKinds % kObjects)];
  const scene::Primitive& primitive = scene::kPrimitives[static_cast<std::size_t>(index / kKinds / kObjects)];
  scene::Level level{.inject = scene::Inject::kGrey};
  level.contact = scene::as_round(object.shape) ? scene::ContactLevel::kSprings : scene::ContactLevel::kGrid;
  Trial trial;
  trial.scene = scene::grasp_trial(object, primitive, kind, seed + static_cast<std::uint64_t>(number / kAll), level);
  Scene& scene = trial.scene;
  if (smooth) scene.object.relief = {};
  scene.effects.marker_noise_um = 0.0;  // of tracked markers; a picture has its own
  scene.effects.pixel_noise = 2.0;
  trial.group = scene::info(kind).name;
  trial.slips = scene::info(kind).slips;
  trial.within_frames = 8;
  trial.opens_s = opens_s(scene.trajectory);
  return trial;
}

// What the opposite finger feels of the same object: left and right are exchanged, and its turns run the other way.
Scene mirrored(Scene scene) {
  for (scene::Waypoint& at : scene.trajectory) {
    for (std::optional<double>* const value : {&at.x_mm, &at.twist_deg, &at.pull_x_n}) {
      if (*value) *value = -**value;
    }
  }
  scene.object.touch_mm.x = -scene.object.touch_mm.x;
  scene.object.shape.yaw_rad = pi - scene.object.shape.yaw_rad;
  return scene;
}

Trial hand(std::uint64_t seed, int number) {
  const bool slips = number % 2 == 0;
  const bool both = number / 2 % 2 == 1;
  Trial trial = slips ? slide(seed, number / 2) : closing(seed, number / 2, TrialKind::kClosing);
  Dice dice(TrialKind::kHand, seed, number);
  trial.group = fmt::format("{}, {}", slips ? "slide" : "closing", both ? "both rough" : "left rough");
  trial.scene.name = fmt::format("{}_{}", kTrialNames[static_cast<std::size_t>(TrialKind::kHand)], number);
  if (!slips && trial.scene.object.relief.kind == ReliefKind::kNone) trial.scene.object.relief = drawn_relief(dice);
  Scene& right = trial.right.emplace(mirrored(trial.scene));
  if (!both) right.object.relief = {};
  right.seed = dice.seed();
  trial.right_later = Micros(static_cast<std::int64_t>(dice.in({0.0, 1.0}) * 1e6 / trial.scene.fps));
  return trial;
}

}  // namespace

Trial make_trial(TrialKind kind, std::uint64_t seed, int number) {
  switch (kind) {
    case TrialKind::kClosing:
    case TrialKind::kClosingSlip:
    case TrialKind::kEasing:
      return closing(seed, number, kind);
    case TrialKind::kTurn:
      return turn(seed, number, true);
    case TrialKind::kTurnHeld:
      return turn(seed, number, false);
    case TrialKind::kSlide:
      return slide(seed, number);
    case TrialKind::kShaken:
      return shaken(seed, number);
    case TrialKind::kSmooth:
      return paper_trial(seed, number, true);
    case TrialKind::kHand:
      return hand(seed, number);
    case TrialKind::kGrasp:
      break;
  }
  return paper_trial(seed, number, false);
}

namespace {

// Counts what was raised in a trial, frame by frame.
class Judge {
 public:
  explicit Judge(const Trial& trial) : trial_(trial) {}

  // false: the rest of the trial is not judged.
  [[nodiscard]] bool add(const PlayedFrame& now, bool touching) {
    result_.referenced = result_.referenced || now.referenced;
    if (!onset_ && now.level >= scene::SlipLevel::kHalf) {
      onset_ = now.frame;
      result_.onset_s = now.t_s;
      up_at_onset_ = now.slip;
    }
    if (onset_ && !trial_.slips) return false;
    if (!onset_ && touching) ++in_contact_;
    if (now.slip && !up_) rises_.push_back({now.frame, now.t_s, now.level != scene::SlipLevel::kNone});
    up_ = now.slip;
    return true;
  }

  [[nodiscard]] TrialResult result() const {
    constexpr double kStillCloses_s = 0.12;
    // Half of the contact is a threshold like any other: a rise so shortly before it is early, not false.
    constexpr int kEarlyFrames = 2;
    TrialResult result = result_;
    result.contact_s = in_contact_ / trial_.scene.fps;
    if (trial_.slips && up_at_onset_) {
      for (const Rise& rise : rises_) {
        if (rise.frame <= *onset_) result.delay_frames = rise.frame - *onset_;
      }
    }
    for (const Rise& rise : rises_) {
      if (trial_.slips && onset_ && rise.frame >= *onset_ - kEarlyFrames) {
        if (!result.delay_frames) result.delay_frames = rise.frame - *onset_;
        break;
      }
      const bool moved = trial_.moved_s > 0.0 && rise.t_s >= trial_.moved_s;
      ++result.alarms[rise.t_s < trial_.closed_s + kStillCloses_s ? 0U : moved ? 2U : 1U];
      result.partial_alarms += rise.partial ? 1 : 0;
    }
    return result;
  }

 private:
  struct Rise {
    int frame;
    double t_s;
    bool partial;  // a part of the contact slips
  };
  const Trial& trial_;
  TrialResult result_;
  std::vector<Rise> rises_;
  std::optional<int> onset_;
  bool up_ = false;
  bool up_at_onset_ = false;
  int in_contact_ = 0;
};

// Every frame of a scene through the firmware, until `see` has seen enough.
void show(const Scene& scene, const Trial& trial, const Params& params, const model::Tree* tree,
          const std::function<bool(const Player&, const App&)>& see) {
  Rig rig(params);
  Player player(scene, rig.clock());
  App& app = rig.connect(player.camera(), tree);
  if (!app.start(params).ok()) return;
  while (player.step(app, params, false)) {
    if (trial.opens_s > 0.0 && player.snapshot().t_s + 1.0 / scene.fps > trial.opens_s) app.opening(true);
    if (!see(player, app)) break;
  }
}

bool touching(const Player& player) {
  return player.snapshot().contact.contact_radius_mm > 0.0;
}

}  // namespace

TrialResult run_trial(const Trial& trial, const Params& params, const model::Tree* tree) {
  Judge judge(trial);
  show(trial.scene, trial, params, tree,
       [&](const Player& player, const App& app) { return judge.add(played(player, app), touching(player)); });
  return judge.result();
}

HandResult run_hand(const Trial& trial, const Params& params, const model::Tree* tree) {
  std::vector<pipeline::Result> right;
  show(*trial.right, trial, params, tree, [&](const Player&, const App& app) {
    right.push_back(app.result());
    return true;
  });
  HandPlayer hand(fingers::config_of(2, pipeline_config(params, false, tree), supervisor_config(params)), right, 0,
                  trial.right_later);
  Judge of_hand(trial);
  Judge of_left(trial);
  show(trial.scene, trial, params, tree, [&](const Player& player, const App& app) {
    PlayedFrame now = played(player, app);
    const bool goes_on = of_left.add(now, touching(player));
    now.slip = hand.step(app.result()).result.hand.slip;
    return of_hand.add(now, touching(player)) && goes_on;
  });
  return {of_hand.result(), of_left.result()};
}

void TrialTally::add(const Trial& trial, const TrialResult& result) {
  ++trials;
  unreferenced += result.referenced ? 0 : 1;
  contact_s += result.contact_s;
  bool any = false;
  for (std::size_t phase = 0; phase < alarms.size(); ++phase) {
    alarms[phase] += result.alarms[phase];
    any = any || result.alarms[phase] > 0;
  }
  partial_alarms += result.partial_alarms;
  alarmed += any ? 1 : 0;
  if (!result.onset_s || !trial.slips) return;
  ++onsets;
  if (!result.delay_frames) return;
  detected += *result.delay_frames <= trial.within_frames ? 1 : 0;
  delays.insert(std::ranges::upper_bound(delays, *result.delay_frames), *result.delay_frames);
}

std::optional<double> TrialTally::median_delay() const {
  if (delays.empty()) return {};
  const std::size_t half = delays.size() / 2;
  return delays.size() % 2 == 1 ? delays[half] : 0.5 * (delays[half - 1] + delays[half]);
}

void TrialTable::add(const Trial& trial, const TrialResult& result) {
  auto group = std::ranges::find(groups_, trial.group, &TrialTally::group);
  if (group == groups_.end()) {
    group = groups_.insert(std::ranges::upper_bound(groups_, trial.group, {}, &TrialTally::group), TrialTally{});
    group->group = trial.group;
  }
  group->add(trial, result);
  all_.add(trial, result);
}

std::string table_text(const TrialTable& table) {
  std::string out = fmt::format("{:<20} {:>6} {:>6} {:>9} {:>7} {:>7} | {:>7} {:>5} {:>5} {:>7} {:>8} {:>9} {:>7}\n",
                                "group", "trials", "onsets", "in time", "ever", "median", "closing", "held", "moved",
                                "partial", "trials", "contact", "an hour");
  const auto line = [&](const TrialTally& t) {
    const auto median = t.median_delay();
    out += fmt::format("{:<20} {:>6} {:>6} {:>9} {:>7} {:>7} | {:>7} {:>5} {:>5} {:>7} {:>8} {:>7.0f} s {:>7.0f}\n",
                       t.group, t.trials, t.onsets,
                       t.onsets > 0 ? fmt::format("{:.0f} %", 100.0 * t.detected / t.onsets) : "-", t.delays.size(),
                       median ? fmt::format("{:.1f}", *median) : "-", t.alarms[0], t.alarms[1], t.alarms[2],
                       t.partial_alarms, t.alarmed, t.contact_s, t.alarms_per_hour());
  };
  for (const TrialTally& tally : table.groups()) line(tally);
  line(table.all());
  out +=
      "Detections in time and ever, median delay in frames; alarms before the onset while the grip closes, holds and\n"
      "is moved, those of them in partial slip, trials that alarm, contact before the onset, alarms an hour of it.\n";
  if (table.all().unreferenced > 0)
    out += fmt::format("{} trials without a rest position: their firmware judged nothing\n", table.all().unreferenced);
  return out;
}

}  // namespace holdfast::tool
