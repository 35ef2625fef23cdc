// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Purposes of random streams.
constexpr std::uint64_t kFabrication = 1;
constexpr std::uint64_t kMissing = 2;
constexpr std::uint64_t kDoubles = 3;
constexpr std::uint64_t kMarkerNoise = 4;
constexpr std::uint64_t kMarkerLoss = 5;

// Steps of an object with mass: a share of the time in which it would swing by one radian. Semi-implicit Euler is
// stable up to 2.
constexpr double kSwingShare = 0.2;
constexpr int kMostSteps = 4000;

// A double lies beside its dot, clear of it and of its neighbours.
constexpr double kLeastAside = 0.35;  // of the pitch
constexpr double kMostAside = 0.5;

struct Curve {
  std::vector<std::pair<double, double>> knots;  // time, value

  [[nodiscard]] bool given() const { return !knots.empty(); }

  [[nodiscard]] double at(double t, Profile profile) const {
    if (knots.empty()) return 0.0;
    const auto after = std::upper_bound(knots.begin(), knots.end(), t,
                                        [](double time, const auto& knot) { return time < knot.first; });
    if (after == knots.begin()) return knots.front().second;
    const auto& from = *std::prev(after);
    if (after == knots.end()) return from.second;
    double share = (t - from.first) / (after->first - from.first);
    if (profile == Profile::kMinimumJerk) share = share * share * share * (10.0 + share * (-15.0 + share * 6.0));
    return from.second + share * (after->second - from.second);
  }
};

struct Script {
  explicit Script(const Scene& scene) : profile(scene.profile) {
    for (const Waypoint& point : scene.trajectory) {
      const auto take = [&](Curve& curve, const std::optional<double>& value) {
        if (value) curve.knots.emplace_back(point.t_s, *value);
      };
      take(depth, point.depth_mm);
      take(force, point.force_n);
      take(closing, point.closing_mm);
      take(x, point.x_mm);
      take(y, point.y_mm);
      take(twist, point.twist_deg);
      take(pull_x, point.pull_x_n);
      take(pull_y, point.pull_y_n);
    }
  }

  [[nodiscard]] Drive at(double t) const {
    Drive drive;
    const auto value = [&](const Curve& curve) { return curve.at(t, profile); };
    if (depth.given()) drive.depth_mm = value(depth);
    if (force.given()) drive.force_n = value(force);
    if (closing.given()) drive.closing_mm = value(closing);
    drive.at_mm = {value(x), value(y)};
    drive.twist_rad = value(twist) * pi / 180.0;
    drive.pull_n = {value(pull_x), value(pull_y)};
    return drive;
  }

  Profile profile;
  Curve depth, force, closing, x, y, twist, pull_x, pull_y;
};

std::optional<double> between(const std::optional<double>& from, const std::optional<double>& to, double share) {
  if (!from || !to) return to;
  return *from + share * (*to - *from);
}

Vec2 between(Vec2 from, Vec2 to, double share) {
  return {from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)};
}

Drive between(const Drive& from, const Drive& to, double share) {
  return {between(from.depth_mm, to.depth_mm, share),
          between(from.force_n, to.force_n, share),
          between(from.closing_mm, to.closing_mm, share),
          between(from.at_mm, to.at_mm, share),
          from.twist_rad + share * (to.twist_rad - from.twist_rad),
          between(from.pull_n, to.pull_n, share),
          from.friction + share * (to.friction - from.friction)};
}

// Force of a gripper that has closed so far, by the depth of gel and the give of the object in series. A table over the
// force, made by pressing a contact of the same kind, as far as it is asked for.
class Closing {
 public:
  explicit Closing(const Scene& scene)
      : contact_(make_contact(scene, {})), object_(scene.object), next_n_(kLeastForce_n) {}

  [[nodiscard]] double force_n(double closing_mm) {
    // Force rises at least as depth does: steps that grow with it. Between them the force is 0.2 % high at most,
    // but for the first hundredth of a newton.
    while (curve_.back().first < closing_mm && next_n_ < kMostForce_n) {
      const ContactState& pressed = contact_->press_to(next_n_, object_.touch_mm, 0.0);
      curve_.emplace_back(pressed.depth_mm + object_.compliance_mm_per_n * next_n_, next_n_);
      next_n_ *= kForceStep;
    }
    const auto after = std::upper_bound(curve_.begin(), curve_.end(), closing_mm,
                                        [](double mm, const auto& point) { return mm < point.first; });
    if (after == curve_.begin()) return 0.0;
    const auto& from = *std::prev(after);
    if (after == curve_.end()) return from.second;
    return from.second + (closing_mm - from.first) / (after->first - from.first) * (after->second - from.second);
  }

 private:
  static constexpr double kLeastForce_n = 0.01;
  static constexpr double kMostForce_n = 200.0;
  static constexpr double kForceStep = 1.2;
  std::unique_ptr<Contact> contact_;
  Object object_;
  double next_n_;
  std::vector<std::pair<double, double>> curve_{{0.0, 0.0}};
};

std::vector<Dot> print_dots(const Scene& scene) {
  const MarkerGrid& grid = scene.markers;
  const Effects& effects = scene.effects;
  const double turn = effects.fabrication_turn_deg * pi / 180.0;
  const double c = portable::cos(turn);
  const double s = portable::sin(turn);
  Random random(scene.seed, kFabrication, 0);
  std::vector<Dot> dots;
  for (int row = 0; row < grid.rows; ++row) {
    for (int col = 0; col < grid.cols; ++col) {
      const double x = (col - 0.5 * (grid.cols - 1)) * grid.pitch_mm;
      const double y = (row - 0.5 * (grid.rows - 1)) * grid.pitch_mm;
      Dot dot;
      dot.marker = row * grid.cols + col;
      const double off_mm = effects.fabrication_um * 1e-3;
      dot.rest_mm.x = c * x - s * y + off_mm * random.normal();
      dot.rest_mm.y = s * x + c * y + off_mm * random.normal();
      dots.push_back(dot);
    }
  }
  const int count = static_cast<int>(dots.size());
  Random missing(scene.seed, kMissing, 0);
  for (int left = std::min(effects.marker_missing, count); left > 0;) {
    Dot& dot = dots[static_cast<std::size_t>(missing.below(count))];
    left -= dot.printed ? 1 : 0;
    dot.printed = false;
  }
  Random doubles(scene.seed, kDoubles, 0);
  for (int i = 0; i < effects.marker_duplicates; ++i) {
    Dot dot = dots[static_cast<std::size_t>(doubles.below(count))];
    const double away = grid.pitch_mm * (kLeastAside + (kMostAside - kLeastAside) * doubles.uniform());
    const double angle = 2.0 * pi * doubles.uniform();
    dot.rest_mm = {dot.rest_mm.x + away * portable::cos(angle), dot.rest_mm.y + away * portable::sin(angle)};
    dot.printed = dot.extra = true;
    dots.push_back(dot);
  }
  return dots;
}

}  // namespace

struct Simulation::State {
  explicit State(const Scene& what) : scene(what), script(what), dots(print_dots(what)) {
    for (const Dot& dot : dots) {
      if (!dot.extra) markers.push_back(dot.rest_mm);
    }
    contact = make_contact(scene, markers);
    snapshot.motion_mm.resize(markers.size());
    snapshot.before_mm.resize(markers.size());
    crept.resize(markers.size());
    drive = script.at(0.0);
    snapshot.object_mm = drive.at_mm;
  }

  void place(const Drive& to);
  void move(const Drive& to, double dt_s);
  void observe(double elapsed_s, std::vector<Vec2>& out);

  Scene scene;
  Script script;
  std::vector<Dot> dots;
  std::vector<Vec2> markers;
  std::unique_ptr<Contact> contact;
  std::optional<Closing> closing;
  Drive drive;  // at the end of the last frame
  ContactState touch;
  Vec2 speed_mm_s;          // of an object with mass
  std::vector<Vec2> crept;  // the slow part of the solid
  int frames = 0;
  Snapshot snapshot;
};

// Object where the drive (or its own mass) has it, pressed as the drive says.
void Simulation::State::place(const Drive& to) {
  const Vec2 at{scene.object.touch_mm.x + snapshot.object_mm.x, scene.object.touch_mm.y + snapshot.object_mm.y};
  contact->scale_friction(to.friction);
  if (to.closing_mm) {
    if (!closing) closing.emplace(scene);
    touch = contact->press_to(closing->force_n(*to.closing_mm), at, to.twist_rad);
  } else if (to.force_n) {
    touch = contact->press_to(*to.force_n, at, to.twist_rad);
  } else {
    touch = contact->move_to({to.depth_mm.value_or(0.0), at, to.twist_rad});
  }
}

// The drive from where it is to `to`, in a straight line.
void Simulation::State::move(const Drive& to, double dt_s) {
  const Drive from = std::exchange(drive, to);
  if (!(scene.object.mass_g > 0.0) || !(dt_s > 0.0)) {
    snapshot.object_mm = to.at_mm;
    place(to);
    return;
  }
  const double mass_kg = scene.object.mass_g * 1e-3;
  const double spring = scene.effects.drive_stiffness_n_per_mm;
  const double damping = scene.effects.damping_n_s_per_mm;
  const auto gel = [this] {
    return 8.0 * scene.gel.shear_modulus_mpa * touch.contact_radius_mm / (2.0 - scene.gel.poisson);
  };
  // 1000: N per kg is m/s^2.
  const double swing_per_s = std::sqrt(1000.0 * (spring + gel()) / mass_kg);
  const double wanted = std::ceil(dt_s * swing_per_s / kSwingShare);
  const int steps = static_cast<int>(std::clamp(wanted, 1.0, double{kMostSteps}));
  const double step_s = dt_s / steps;
  const double push = 1000.0 * step_s / mass_kg;
  for (int i = 1; i <= steps; ++i) {
    const Drive now = between(from, to, static_cast<double>(i) / steps);
    // An object too light for its swings to be followed goes where its forces balance: their change within the step is
    // taken into account, which damps.
    const double resists = damping + (wanted > kMostSteps ? step_s * (spring + gel()) : 0.0);
    const auto moved = [&](double at, double speed, double arm, double pull, double shear) {
      return (speed + push * (spring * (arm - at) + pull - shear)) / (1.0 + push * resists);
    };
    speed_mm_s = {moved(snapshot.object_mm.x, speed_mm_s.x, now.at_mm.x, now.pull_n.x, touch.shear_n.x),
                  moved(snapshot.object_mm.y, speed_mm_s.y, now.at_mm.y, now.pull_n.y, touch.shear_n.y)};
    snapshot.object_mm = {snapshot.object_mm.x + step_s * speed_mm_s.x, snapshot.object_mm.y + step_s * speed_mm_s.y};
    place(now);
  }
}

// Marker motion now, with creep since the last look.
void Simulation::State::observe(double elapsed_s, std::vector<Vec2>& out) {
  contact->field(out);
  const double gain = scene.effects.creep_gain;
  if (!(gain > 0.0)) return;
  const double share = -portable::expm1(-elapsed_s / scene.effects.creep_tau_s);
  for (std::size_t i = 0; i < out.size(); ++i) {
    crept[i] = between(crept[i], out[i], share);
    out[i] = {out[i].x + gain * crept[i].x, out[i].y + gain * crept[i].y};
  }
}

Drive drive_at(const Scene& scene, double t_s) {
  return Script(scene).at(t_s);
}

int frame_count(const Scene& scene) {
  // Half a microsecond of slack: duration and rate are decimal numbers.
  return static_cast<int>(std::floor((scene.duration_s + 5e-7) * scene.fps)) + 1;
}

Simulation::Simulation(const Scene& scene) : state_(std::make_unique<State>(scene)) {}
Simulation::Simulation(Simulation&&) noexcept = default;
Simulation& Simulation::operator=(Simulation&&) noexcept = default;
Simulation::~Simulation() = default;

const Scene& Simulation::scene() const {
  return state_->scene;
}
std::span<const Vec2> Simulation::markers() const {
  return state_->markers;
}
std::span<const Dot> Simulation::dots() const {
  return state_->dots;
}

const Snapshot& Simulation::next() {
  return next(state_->script.at(state_->frames / state_->scene.fps));
}

const Snapshot& Simulation::next(const Drive& drive) {
  State& s = *state_;
  Snapshot& out = s.snapshot;
  out.frame = s.frames++;
  out.t_s = out.frame / s.scene.fps;
  const double dt_s = out.frame == 0 ? 0.0 : 1.0 / s.scene.fps;
  const Effects& effects = s.scene.effects;
  const double open_s = std::min((effects.exposure_ms + effects.rolling_shutter_ms) * 1e-3, dt_s);
  const ContactState before = s.touch;

  double rest_s = dt_s;
  if (open_s > 0.0) {
    s.move(between(s.drive, drive, 1.0 - open_s / dt_s), dt_s - open_s);
    s.observe(dt_s - open_s, out.before_mm);
    out.object_before_mm = out.object_mm;
    out.object_before_rad = s.drive.twist_rad;
    rest_s = open_s;
  }
  s.move(drive, rest_s);
  s.observe(rest_s, out.motion_mm);
  out.object_rad = drive.twist_rad;
  if (!(open_s > 0.0)) {
    out.before_mm = out.motion_mm;
    out.object_before_mm = out.object_mm;
    out.object_before_rad = out.object_rad;
  }

  out.contact = s.touch;
  out.level = slip_level(out.contact.slip_fraction, out.contact.gross);
  out.slide_mm_s = out.slide_deg_s = 0.0;
  if (dt_s > 0.0 && before.contact_radius_mm > 0.0 && s.touch.contact_radius_mm > 0.0) {
    const double x = s.touch.slid_mm.x - before.slid_mm.x;
    const double y = s.touch.slid_mm.y - before.slid_mm.y;
    out.slide_mm_s = std::sqrt(x * x + y * y) / dt_s;
    out.slide_deg_s = std::abs(s.touch.slid_rad - before.slid_rad) * 180.0 / (pi * dt_s);
  }
  return out;
}

void see_markers(const Simulation& simulation, const Snapshot& snapshot, std::vector<SeenMarker>& out) {
  const Effects& effects = simulation.scene().effects;
  const std::span<const Vec2> rest = simulation.markers();
  const std::span<const Dot> dots = simulation.dots();
  const auto frame = static_cast<std::uint64_t>(snapshot.frame);
  Random noise(simulation.scene().seed, kMarkerNoise, frame);
  Random loss(simulation.scene().seed, kMarkerLoss, frame);
  const double sigma_mm = effects.marker_noise_um * 1e-3;
  out.resize(rest.size());
  for (std::size_t i = 0; i < rest.size(); ++i) {
    const Vec2 at{rest[i].x + snapshot.motion_mm[i].x, rest[i].y + snapshot.motion_mm[i].y};
    const double off_x = sigma_mm * noise.normal();
    const double off_y = sigma_mm * noise.normal();
    const bool lost = loss.uniform() < effects.marker_loss;
    out[i] = {{at.x + off_x, at.y + off_y}, dots[i].printed && !lost};
  }
}

}  // namespace holdfast::scene
