// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/paper.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Quotients, so that a frame's time is the same double as its waypoint's.
constexpr double kStepsPerSecond = 50.0;
constexpr Gel kGel{.shear_modulus_mpa = 0.07, .poisson = 0.49, .thickness_mm = 4.25};
constexpr double kHalfPad_mm = 12.6;  // along x: where a cylinder's contact ends
constexpr double kGravity_n_per_g = 9.81e-3;
constexpr double kArc_rad = pi / 3.0;
constexpr double kPressSwing = 0.25;  // of the grip's force, at the full load
constexpr Span kLoosened{0.20, 0.40};
// Of a minimum-jerk move: largest speed over mean speed.
constexpr double kPeak = 1.875;
constexpr double kLeastSlide_s = 0.32;
constexpr double kMostSlide_s = 4.0;
// A pivot farther away than the contact reaches leaves no point of it at rest.
constexpr Span kPivot{1.8, 3.0};

double square(double x) {
  return x * x;
}

// (2/3)rd power.
double two_thirds(double x) {
  return square(portable::cbrt(x));
}

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}
  double in(Span span) { return span.least + (span.most - span.least) * random_.uniform(); }
  // Each factor as likely as another.
  double log_in(Span span) {
    return span.least * portable::exp(random_.uniform() * portable::log(span.most / span.least));
  }
  bool coin() { return random_.below(2) == 0; }
  double sign() { return coin() ? 1.0 : -1.0; }
  int among(int count) { return random_.below(count); }

 private:
  Random random_;
};

// A number over time, moved from one value to the next.
class Track {
 public:
  // To `value`, `after_s` after the last move.
  void move(double after_s, double value, bool steady = false) { knots_.push_back({end_s() + after_s, value, steady}); }
  void rest(double for_s) { move(for_s, knots_.back().value); }
  void rest_until(double t_s) { rest(std::max(t_s - end_s(), 0.0)); }
  [[nodiscard]] double end_s() const { return knots_.back().t_s; }

  [[nodiscard]] double at(double t_s) const {
    const auto after = std::ranges::upper_bound(knots_, t_s, {}, [](const Knot& knot) { return knot.t_s; });
    if (after == knots_.begin()) return knots_.front().value;
    const Knot& from = *std::prev(after);
    if (after == knots_.end()) return from.value;
    double share = (t_s - from.t_s) / (after->t_s - from.t_s);
    if (!after->steady) share = share * share * share * (10.0 + share * (-15.0 + share * 6.0));
    return from.value + share * (after->value - from.value);
  }

 private:
  struct Knot {
    double t_s = 0.0;
    double value = 0.0;
    bool steady = false;  // on the way here
  };
  std::vector<Knot> knots_{Knot{}};
};

bool is_flat(const Shape& shape) {
  return shape.kind == ShapeKind::kDisc || shape.kind == ShapeKind::kBox;
}

// Motion over the motion that slides, at this share of the friction limit. Cattaneo and Mindlin; a flat sticks whole.
double motion_share(const Shape& shape, double load) {
  return is_flat(shape) ? load : 1.0 - two_thirds(1.0 - load);
}

// Radius of the disc as large as a flat's face: its outline less half of the rim.
double flat_radius_mm(const Shape& shape) {
  const double off = 0.5 * shape.rim_mm;
  if (shape.kind == ShapeKind::kDisc) return shape.radius_mm - off;
  return std::sqrt(4.0 * (shape.half_x_mm - off) * (shape.half_y_mm - off) / pi);
}

bool is_line(const Shape& shape) {
  return shape.kind == ShapeKind::kCylinder || shape.kind == ShapeKind::kEdge;
}

// From the middle of a contact to its farthest point; a flat's corner is 1.45 of its radius away.
double reach_mm(const Shape& shape, double radius_mm) {
  if (is_line(shape)) return kHalfPad_mm;
  return is_flat(shape) ? 1.45 * radius_mm : radius_mm;
}

// Size of the contact on a half-space: half the width of a line contact, or the radius.
double half_space_size_mm(const Shape& shape, const Gel& gel, double press_n) {
  const double modulus = effective_modulus_mpa(gel);
  if (is_flat(shape)) return flat_radius_mm(shape);
  if (is_line(shape)) return std::sqrt(2.0 * press_n * shape.radius_mm / (kHalfPad_mm * pi * modulus));
  const double radius =
      shape.kind == ShapeKind::kEllipsoid ? std::sqrt(shape.radius_mm * shape.radius_y_mm) : shape.radius_mm;
  return portable::cbrt(0.75 * press_n * radius / modulus);
}

// Stiffness of the bonded layer over the half-space's, chi = contact size over thickness.
double dimitriadis(double chi) {
  return 1.0 + chi * (1.133 + chi * (1.283 + chi * (0.769 + chi * 0.0975)));
}

// Flats, lines and the share of a texture are fitted to GridContact at 1 .. 3 N and 45 .. 110 kPa: 20 %.
double depth_mm(const Shape& shape, const Gel& gel, double size_mm, double press_n) {
  const double modulus = effective_modulus_mpa(gel);
  const double chi = size_mm / gel.thickness_mm;
  double depth = 0.0;
  if (is_flat(shape)) {
    // The rim yields: 1.9 times what a punch's square edge would.
    depth = 1.9 * press_n / (2.0 * size_mm * modulus * dimitriadis(chi));
  } else if (is_line(shape)) {
    depth = 1.6 / (1.0 + 1.6 * chi * chi) * size_mm * size_mm / (2.0 * shape.radius_mm);
  } else {
    // The sphere that makes this contact.
    const double radius = size_mm * size_mm * size_mm * modulus / (0.75 * press_n);
    double low = 0.0;
    double high = size_mm * size_mm / radius;
    for (int i = 0; i < 40; ++i) {
      depth = 0.5 * (low + high);
      const double wide = std::sqrt(radius * depth);
      const double force = 4.0 / 3.0 * modulus * wide * depth * dimitriadis(wide / gel.thickness_mm);
      (force < press_n ? low : high) = depth;
    }
  }
  const double uneven = shape.texture == TextureKind::kNone ? 0.0 : shape.texture_height_mm;
  const double lean = is_flat(shape) ? std::abs(shape.tilt_rad) * shape.half_y_mm : 0.0;
  return depth + std::min(is_flat(shape) ? 0.5 * uneven + 0.75 * lean : 0.25 * uneven, 2.0 * depth);
}

std::uint64_t fnv(std::string_view text, std::uint64_t hash) {
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return hash;
}

bool twists(const Primitive& primitive) {
  return primitive.cosine.twist != 0.0 || primitive.sine.twist != 0.0;
}

bool presses(const Primitive& primitive) {
  return primitive.cosine.press != 0.0 || primitive.sine.press != 0.0;
}

Swing load_at(const Primitive& primitive, double angle) {
  const double c = portable::cos(angle);
  const double s = portable::sin(angle);
  const auto mix = [&](double Swing::*part) { return c * primitive.cosine.*part + s * primitive.sine.*part; };
  return {mix(&Swing::x), mix(&Swing::y), mix(&Swing::twist), mix(&Swing::press)};
}

Vec2 turned(Vec2 v, double angle) {
  const double c = portable::cos(angle);
  const double s = portable::sin(angle);
  return {c * v.x - s * v.y, s * v.x + c * v.y};
}

// Where a way of length s leads that starts along +x and bends by `curvature`.
Vec2 along_arc(double s, double curvature) {
  if (curvature == 0.0) return {s, 0.0};
  const double half = portable::sin(0.5 * curvature * s);
  return {portable::sin(curvature * s) / curvature, 2.0 * half * half / curvature};
}

// How a person lays on the load that the grip holds.
enum class Hand { kSteps, kShakes, kJerks };

class Trial {
 public:
  Trial(const PaperObject& object, const Primitive& primitive, GraspKind kind, std::uint64_t seed)
      : object_(object),
        primitive_(primitive),
        kind_(kind),
        dragged_(info(kind).slips || kind == GraspKind::kMatched),
        dice_(seed),
        more_dice_(~seed) {
    prepare();
    grasp();
    dragged_ ? load_and_drag() : load_and_unload();
    release();
  }

  void write(Scene& scene) const;

 private:
  void prepare();
  void grasp();
  void load_and_unload();
  void load_and_drag();
  void drag();
  void release();
  [[nodiscard]] double angle_at(double t_s) const;
  [[nodiscard]] Waypoint at(double t_s) const;

  const PaperObject& object_;
  const Primitive& primitive_;
  GraspKind kind_;
  bool dragged_;  // until it slides, or would
  Dice dice_;
  Dice more_dice_;  // for what the paper's two kinds do not have: their numbers stay as they are

  Shape shape_;
  Gel gel_ = kGel;
  Vec2 touch_mm_;
  double friction_ = 0.0;
  double press_n_ = 0.0;
  bool by_closing_ = false;
  FrictionLimit limit_;
  double marker_noise_um_ = 0.0;
  double fabrication_um_ = 0.0;
  double fabrication_turn_deg_ = 0.0;

  double weight_share_ = 0.0;  // shares are of the motion that slides
  double load_share_ = 0.0;
  double tremor_share_ = 0.0;
  double tremor_hz_ = 0.0;
  double tremor_rad_ = 0.0;
  double jitter_rad_ = 0.0;
  double side_ = 1.0;
  double start_rad_ = 0.0;
  double turn_hz_ = 0.0;
  double held_way_ = 1.0;  // of a matched or shaken trial
  double load_from_s_ = 0.0;
  double slide_from_s_ = 0.0;
  Vec2 slide_along_;  // 1 mm
  double curvature_per_mm_ = 0.0;
  bool pivots_ = false;

  Track grip_, weight_, load_, loose_, slide_mm_;
};

void Trial::prepare() {
  shape_ = object_.shape;
  const double yaw = dice_.in({-0.3, 0.3});
  if (!as_round(shape_) && shape_.kind != ShapeKind::kDisc) shape_.yaw_rad = yaw;
  gel_.shear_modulus_mpa = dice_.in({0.045, 0.110});
  touch_mm_.x = dice_.in({-2.0, 2.0});
  touch_mm_.y = dice_.in({-2.0, 2.0});
  friction_ = dice_.in(object_.friction);
  press_n_ = dice_.in(object_.press_n);
  by_closing_ = dice_.coin();
  limit_ = friction_limit(shape_, gel_, friction_, press_n_);
  marker_noise_um_ = dice_.in({1.0, 2.0});
  fabrication_um_ = dice_.in({20.0, 60.0});
  fabrication_turn_deg_ = dice_.in({-1.5, 1.5});

  const double load = dragged_ ? dice_.in({0.60, 0.90}) : dice_.in({0.25, 0.65});
  const double hanging = 0.5 * object_.mass_g * kGravity_n_per_g / (friction_ * press_n_);
  weight_share_ = motion_share(shape_, std::min({hanging, 0.2, 0.5 * load}));
  tremor_share_ = dice_.in({0.005, 0.02});
  tremor_hz_ = dice_.in({8.0, 12.0});
  tremor_rad_ = dice_.in({0.0, 2.0 * pi});
  // Where the grip's force swings, its least must hold, too.
  const double held =
      motion_share(shape_, load) * (presses(primitive_) && !dragged_ ? two_thirds(1.0 - kPressSwing) : 1.0);
  load_share_ = std::max(held - weight_share_ - tremor_share_, 0.0);
  jitter_rad_ = dice_.in({-0.26, 0.26});
  // The motion stays that of the limit above; the surface gets the friction to hold it. Where the grip's force swings
  // and loosens, its least must hold, too.
  if (kind_ == GraspKind::kMatched || kind_ == GraspKind::kShaken) {
    const bool matched = kind_ == GraspKind::kMatched;
    held_way_ = more_dice_.in(matched ? Span{1.0, 1.5} : Span{0.5, 1.5});
    if (!matched) load_share_ = held_way_;
    double least_press = presses(primitive_) ? 1.0 - kPressSwing : 1.0;
    if (matched && presses(primitive_)) least_press *= 1.0 - kLoosened.most;
    friction_ *=
        (held_way_ + weight_share_ + tremor_share_) / (least_press * motion_share(shape_, more_dice_.in({0.35, 0.60})));
  }
  start_rad_ = primitive_.sweep == Sweep::kCircle ? dice_.in({0.0, 2.0 * pi}) : 0.0;
  side_ = dice_.sign();
}

void Trial::grasp() {
  grip_.rest(dice_.in({0.54, 0.74}));
  grip_.move(dice_.in({0.30, 0.70}), 1.0);
  grip_.rest(dice_.in({0.30, 0.60}));
  weight_.rest_until(grip_.end_s());
  weight_.move(dice_.in({0.20, 0.40}), 1.0);
  load_from_s_ = weight_.end_s();
  load_.rest_until(load_from_s_);
}

void Trial::load_and_unload() {
  Hand hand = std::array{Hand::kSteps, Hand::kShakes, Hand::kJerks}[static_cast<std::size_t>(dice_.among(3))];
  if (kind_ == GraspKind::kShaken) hand = Hand::kShakes;
  const bool line = primitive_.sweep == Sweep::kLine;
  if (hand == Hand::kJerks) {
    turn_hz_ = line ? 0.0 : dice_.in({0.5, 1.5});
    for (int jerks = 2 + dice_.among(3); jerks > 0; --jerks) {
      const double size = dice_.in({0.7, 1.0});
      load_.move(dice_.in({0.08, 0.16}), size);
      load_.rest(dice_.in({0.10, 0.30}));
      load_.move(dice_.in({0.08, 0.16}), 0.0);
      load_.rest(dice_.in({0.10, 0.40}));
    }
    return;
  }
  const bool shakes = hand == Hand::kShakes;
  if (shakes) {
    turn_hz_ = line ? dice_.in({0.8, 4.0}) : dice_.in({0.8, 2.0});
    if (kind_ == GraspKind::kShaken) turn_hz_ = more_dice_.in(line ? Span{1.0, 6.0} : Span{1.0, 3.0});
  } else {
    turn_hz_ = line ? 0.0 : dice_.in({0.25, 0.60});
  }
  const int steps = 1 + dice_.among(3);
  for (int step = 1; step <= steps; ++step) {
    load_.move(dice_.in({0.25, 0.70}), static_cast<double>(step) / steps);
    load_.rest(dice_.in({0.10, 0.40}));
  }
  load_.rest(shakes ? dice_.in({0.8, 1.6}) : dice_.in({0.2, 0.6}));
  if (kind_ == GraspKind::kShaken) load_.rest(more_dice_.in({1.2, 2.4}));
  load_.move(dice_.in({0.30, 0.50}), 0.0);
}

void Trial::load_and_drag() {
  turn_hz_ = primitive_.sweep == Sweep::kLine ? 0.0 : dice_.in({0.25, 0.60});
  const int steps = 1 + dice_.among(3);
  for (int step = 1; step <= steps; ++step) {
    load_.move(dice_.in({0.25, 0.70}), static_cast<double>(step) / steps);
    load_.rest(dice_.in({0.10, 0.40}));
  }
  slide_from_s_ = load_.end_s();
  loose_.rest_until(slide_from_s_ - 0.1);
  if (presses(primitive_)) {
    const double by = dice_.in(kLoosened);
    loose_.move(dice_.in({0.20, 0.50}), by);
  }
  drag();
}

void Trial::drag() {
  const Swing load = load_at(primitive_, angle_at(slide_from_s_));
  Vec2 along{load.x, load.y};
  const double across = portable::hypot(along.x, along.y);
  pivots_ = twists(primitive_);
  along = across > 0.1 ? turned({along.x / across, along.y / across}, jitter_rad_)
                       : turned({1.0, 0.0}, dice_.in({0.0, 2.0 * pi}));
  // Over the gel's middle rather than off its edge.
  side_ = along.x * touch_mm_.x + along.y * touch_mm_.y > 0.0 ? -1.0 : 1.0;
  slide_along_ = {side_ * along.x, side_ * along.y};
  // One draw a statement: the order of operands is the compiler's.
  const double bend = dice_.sign();
  if (pivots_) {
    curvature_per_mm_ = bend / (reach_mm(shape_, limit_.radius_mm) * dice_.in(kPivot));
  } else if (primitive_.sweep == Sweep::kCircle) {
    curvature_per_mm_ = bend / dice_.in({3.0, 6.0});
  }

  const bool slow = kind_ == GraspKind::kSlow;
  const double speed = slow ? dice_.log_in({0.5, 2.0}) : dice_.log_in({0.5, 30.0});
  double own_mm = std::clamp(speed * dice_.in({0.6, 1.6}), 0.6, 5.0);
  if (slow) own_mm = speed * more_dice_.in({1.0, 2.0});
  // What is left to the limit first; beside a pivot the near end of the contact goes less than half as far.
  const double left_mm = std::max(1.0 - load_share_, 0.0) * limit_.slide_mm;
  double way_mm = (pivots_ ? 2.4 : 1.2) * left_mm + own_mm;
  if (kind_ == GraspKind::kMatched) way_mm = std::max(held_way_ - load_share_, 0.0) * limit_.slide_mm;
  const bool steady = slow || dice_.among(3) == 0;
  const int nudges = steady || speed < 4.0 ? 1 : 1 + dice_.among(3);
  const double slide_s = std::clamp((steady ? 1.0 : kPeak) * way_mm / speed, kLeastSlide_s, kMostSlide_s);
  slide_mm_.rest_until(slide_from_s_);
  for (int nudge = 1; nudge <= nudges; ++nudge) {
    slide_mm_.move(slide_s / nudges, way_mm * nudge / nudges, steady);
    slide_mm_.rest(dice_.in({0.10, 0.35}));
  }
  if (kind_ == GraspKind::kMatched) slide_mm_.rest(more_dice_.in({1.0, 3.0}));
}

void Trial::release() {
  const double done_s = std::max({load_.end_s(), slide_mm_.end_s(), loose_.end_s()});
  grip_.rest_until(done_s);
  // What still holds is put down before the gripper opens.
  if (!info(kind_).slips) {
    for (Track* track : {&weight_, &load_, &slide_mm_}) {
      track->rest_until(done_s);
      track->move(0.3, 0.0);
    }
    grip_.rest_until(weight_.end_s());
  }
  grip_.rest(dice_.in({0.10, 0.30}));
  grip_.move(dice_.in({0.06, 0.16}), 0.0, true);
}

double Trial::angle_at(double t_s) const {
  if (dragged_) t_s = std::min(t_s, slide_from_s_);
  const double angle = 2.0 * pi * turn_hz_ * std::max(t_s - load_from_s_, 0.0);
  return primitive_.sweep == Sweep::kArc ? kArc_rad * portable::sin(angle) : start_rad_ + angle;
}

Waypoint Trial::at(double t_s) const {
  const Swing load = load_at(primitive_, angle_at(t_s));
  const double size = side_ * load_share_ * load_.at(t_s);
  const Vec2 drag = turned({size * load.x, size * load.y}, jitter_rad_);
  const double hanging = weight_.at(t_s);
  const double tremble = hanging * tremor_share_ * portable::sin(2.0 * pi * tremor_hz_ * t_s + tremor_rad_);
  const Vec2 shaken = turned({tremble, 0.0}, tremor_rad_);
  const double way = slide_mm_.at(t_s);
  const Vec2 slid = along_arc(way, curvature_per_mm_);

  Waypoint point;
  point.t_s = t_s;
  point.x_mm = limit_.slide_mm * (drag.x + shaken.x) + slide_along_.x * slid.x - slide_along_.y * slid.y;
  point.y_mm = limit_.slide_mm * (drag.y + shaken.y + weight_share_ * hanging) + slide_along_.y * slid.x +
               slide_along_.x * slid.y;
  if (twists(primitive_)) {
    point.twist_deg = (limit_.turn_rad * size * load.twist + (pivots_ ? curvature_per_mm_ * way : 0.0)) * 180.0 / pi;
  }
  const double press =
      press_n_ * grip_.at(t_s) * (1.0 + kPressSwing * load_.at(t_s) * load.press) * (1.0 - loose_.at(t_s));
  if (!by_closing_) {
    point.force_n = press;
  } else {
    const double depth = press > 0.0 ? friction_limit(shape_, gel_, friction_, press).depth_mm : 0.0;
    point.closing_mm = depth + object_.compliance_mm_per_n * press;
  }
  return point;
}

void Trial::write(Scene& scene) const {
  scene.gel = gel_;
  scene.object.name = object_.name;
  scene.object.shape = shape_;
  scene.object.friction = friction_;
  scene.object.kinetic_friction = friction_ * object_.kinetic_share;
  scene.object.compliance_mm_per_n = by_closing_ ? object_.compliance_mm_per_n : 0.0;
  scene.object.touch_mm = touch_mm_;
  if (scene.level.inject == Inject::kGrey || scene.level.inject == Inject::kJpeg) scene.object.relief = object_.relief;
  scene.effects.marker_noise_um = marker_noise_um_;
  scene.effects.fabrication_um = fabrication_um_;
  scene.effects.fabrication_turn_deg = fabrication_turn_deg_;
  const int last = static_cast<int>(std::ceil(grip_.end_s() * kStepsPerSecond));
  for (int step = 0; step <= last; ++step) scene.trajectory.push_back(at(step / kStepsPerSecond));
  scene.duration_s = (last + 20) / kStepsPerSecond;
}

}  // namespace

FrictionLimit friction_limit(const Shape& shape, const Gel& gel, double friction, double press_n) {
  if (!(press_n > 0.0)) return {};
  const double g = gel.shear_modulus_mpa;
  const double half_space = half_space_size_mm(shape, gel, press_n);
  const double chi = half_space / gel.thickness_mm;
  const bool flat = is_flat(shape);
  FrictionLimit limit;
  limit.depth_mm = depth_mm(shape, gel, half_space, press_n);
  // Fitted to Layer::press_by_force: 2 % for 0 < chi < 2.
  const double size = flat ? half_space : half_space / (1.0 + 0.085 * chi * std::sqrt(chi));
  limit.radius_mm = is_line(shape) ? std::sqrt(4.0 * kHalfPad_mm * size / pi) : size;
  const double stiffer = 1.0 + 0.35 * limit.radius_mm / gel.thickness_mm;
  const double hold = friction * press_n / (g * limit.radius_mm);
  limit.slide_mm = (flat ? 2.0 : 3.0) * (2.0 - gel.poisson) / 16.0 * hold / stiffer;
  // A strip is stiffer than the disc of its area; with 0.7 GridContact still slid whole in 1 of 48 static trials.
  if (is_line(shape)) limit.slide_mm *= 0.6;
  // Lubkin at c = 0.43 a: 0.26 mu P / (G a^2), 0.95 of the moment.
  limit.turn_rad = 0.26 * hold / (limit.radius_mm * stiffer);
  return limit;
}

Scene grasp_trial(const PaperObject& object, const Primitive& primitive, GraspKind kind, std::uint64_t seed,
                  const std::optional<Level>& level) {
  Scene scene;
  // A matched trial is the twin of a slip trial.
  const GraspKind drawn_as = kind == GraspKind::kMatched ? GraspKind::kSlip : kind;
  scene.seed =
      Random(seed, fnv(object.name, fnv(primitive.name, 0xcbf29ce484222325u)), static_cast<std::uint64_t>(drawn_as))
          .next();
  scene.name = std::string(object.name) + "_" + std::string(primitive.name) + "_" + std::string(info(kind).name);
  scene.help = std::string(info(kind).slips ? "slips: " : "holds: ") + std::string(primitive.felt);
  scene.level.contact = as_round(object.shape) ? ContactLevel::kSprings : ContactLevel::kGrid;
  if (level) scene.level = *level;
  Trial(object, primitive, kind, scene.seed).write(scene);
  return scene;
}

}  // namespace holdfast::scene
