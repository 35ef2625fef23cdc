// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/grasp.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "grip/hande.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::tool {
namespace {

using std::numbers::pi;

constexpr double kFps = 25.0;
// Steps of the physics in a frame: 4 ms. The book swings on the gel with 60 to 150 rad/s; semi-implicit Euler is stable
// up to 2 rad a step.
constexpr int kSteps = 10;
constexpr double kStep_s = 1.0 / (kFps * kSteps);
constexpr double kMarkersCell_mm = 1.0;
constexpr double kDamping_n_s_mm = 0.01;  // of the gel: a fifth of critical for 0.25 kg
constexpr double kShelfShare = 0.8;       // of the way: then the book is out

// Where the arm is: from rest at `accel` to `speed`, and back to rest at the end.
struct Arm {
  double at_mm = 0.0;
  double speed_mm_s = 0.0;
};
Arm arm_at(const Pull& pull, double t_s) {
  const double ramp_s = std::min(pull.speed_mm_s / pull.accel_mm_s2, 0.5 * kPullFor);
  const double accel = pull.speed_mm_s / ramp_s;
  const double t = std::clamp(t_s - kPullAt, 0.0, kPullFor);
  const double slow = std::max(t - (kPullFor - ramp_s), 0.0);
  const double up = std::min(t, ramp_s);
  Arm arm{0.5 * accel * up * up + pull.speed_mm_s * (t - up) - 0.5 * accel * slow * slow, accel * up - accel * slow};
  if (pull.bump_mm > 0.0) {
    const double omega = 2.0 * pi * pull.bump_hz;
    const double shaken = t_s - pull.event_s;
    if (shaken > 0.0 && shaken < 3.0 / pull.bump_hz) {
      // The envelope is smooth, so that speed has no jumps.
      const double envelope = std::sin(pi * shaken * pull.bump_hz / 3.0);
      arm.at_mm += pull.bump_mm * envelope * std::sin(omega * shaken);
      arm.speed_mm_s += pull.bump_mm * (omega * envelope * std::cos(omega * shaken) +
                                        pi * pull.bump_hz / 3.0 * std::cos(pi * shaken * pull.bump_hz / 3.0) *
                                            std::sin(omega * shaken));
    }
  }
  return arm;
}

double way_mm(const Pull& pull) {
  return arm_at(pull, kPullAt + kPullFor).at_mm;
}

scene::Scene scene_of(const Pull& pull) {
  scene::Scene scene;
  scene.name = pull.name;
  scene.seed = pull.seed;
  scene.fps = kFps * kSteps;
  scene.duration_s = pull.ends_s;
  scene.level = {.inject = pull.inject, .contact = scene::ContactLevel::kGrid, .cell_mm = kMarkersCell_mm};
  scene.gel = pull.gel;
  scene.object.shape = pull.shape;
  scene.object.relief = pull.relief;
  scene.object.friction = pull.friction;
  scene.object.kinetic_friction = pull.friction * pull.kinetic_share;
  scene.effects.marker_noise_um = pull.marker_noise_um;
  scene.effects.fabrication_um = pull.fabrication_um;
  if (pull.inject == scene::Inject::kGrey) scene.effects.pixel_noise = 2.0;
  return scene;
}

// The book, its shelf and the arm, along the pull.
class Book {
 public:
  explicit Book(const Pull& pull) : pull_(pull), shelf_until_mm_(kShelfShare * way_mm(pull)) {}

  // One step with what the gel carried at the end of the last; where the book is on the gel then.
  scene::Drive step(const scene::ContactState& contact, double force_n, double t_s) {
    const Arm arm = arm_at(pull_, t_s);
    const scene::Vec2 along{std::cos(pull_.angle_rad), std::sin(pull_.angle_rad)};
    // The gel pulls the book forward by what the book drags it back.
    const double gel_n = -(contact.shear_n.x * along.x + contact.shear_n.y * along.y);
    const bool held = contact.contact_radius_mm > 0.0;
    const double damped_n = held && !contact.gross ? kDamping_n_s_mm * (arm.speed_mm_s - speed_mm_s_) : 0.0;
    const double push_n = gel_n + damped_n - pull_.hang_n;
    // In the shelf, or out of it: then the gel alone has it.
    double shelf_n = at_mm_ < shelf_until_mm_ ? pull_.shelf_n + (t_s >= pull_.event_s ? pull_.added_n : 0.0) : 0.0;
    if (!held && shelf_n == 0.0) shelf_n = 1e9;                // lies where it was lost
    const double speed_up = 1000.0 * kStep_s / pull_.mass_kg;  // N per kg is 1000 mm/s^2
    if (speed_mm_s_ != 0.0 || std::abs(push_n) > shelf_n) {
      const double ahead = speed_mm_s_ != 0.0 ? speed_mm_s_ : push_n;
      const double drag_n = std::copysign(pull_.shelf_kinetic_share * shelf_n, ahead);
      const double speed = speed_mm_s_ + speed_up * (push_n - drag_n);
      speed_mm_s_ = shelf_n > 0.0 && speed * ahead < 0.0 ? 0.0 : speed;  // friction stops it, and does not turn it
    }
    at_mm_ += kStep_s * speed_mm_s_;
    if (at_mm_ < 0.0) at_mm_ = speed_mm_s_ = 0.0;  // the floor
    const double lag_mm = arm.at_mm - at_mm_;
    scene::Drive drive;
    drive.force_n = force_n;
    drive.at_mm = {-lag_mm * along.x, -lag_mm * along.y};
    if (pull_.friction_drops_to && t_s >= pull_.event_s) drive.friction = *pull_.friction_drops_to;
    return drive;
  }

  [[nodiscard]] double at_mm() const { return at_mm_; }

 private:
  const Pull& pull_;
  double shelf_until_mm_;
  double at_mm_ = 0.0;
  double speed_mm_s_ = 0.0;
};

constexpr double kClose_s = 0.5;  // that closing on the book takes

}  // namespace

double force_of(int counts, const LagGripperConfig& config) {
  return config.least_n + (config.most_n - config.least_n) * counts / regulator::kMostCounts;
}

int counts_of(double force_n, const LagGripperConfig& config) {
  const double share = (force_n - config.least_n) / (config.most_n - config.least_n);
  return static_cast<int>(std::clamp(std::floor(share * regulator::kMostCounts + 1e-9), 0.0, 255.0));
}

void LagGripper::tell(const regulator::Command& command) {
  wanted_n_ = command.go ? force_of(command.force, config_) : 0.0;
}

double LagGripper::force_n(double dt_s) {
  const double lagged = force_n_ + (wanted_n_ - force_n_) * -std::expm1(-dt_s / config_.lag_s);
  const double most = config_.rate_n_s * dt_s;
  force_n_ += std::clamp(lagged - force_n_, -most, most);
  return force_n_ < 1e-3 ? 0.0 : force_n_;
}

Grasp play_pull(const Pull& pull, double least_n, const Params& params, const regulator::Config& config,
                Prevention prevention, Gripper& gripper) {
  Grasp grasp;
  regulator::Config settings = config;
  settings.start_force = grasp.start_counts = counts_of(pull.start_share * least_n);
  grasp.start_n = force_of(grasp.start_counts);

  Rig rig(params);
  const scene::Scene scene = scene_of(pull);
  Book book(pull);
  const scene::Snapshot* last = nullptr;
  double force_n = 0.0;
  sim::SceneCamera camera(scene, rig.clock(), [&](double t_s) {
    force_n = gripper.force_n(kStep_s);
    return book.step(last != nullptr ? last->contact : scene::ContactState{}, force_n, t_s);
  });
  last = &camera.snapshot();
  App& app = rig.connect(camera);
  if (!app.start(params).ok()) return grasp;
  regulator::State state;
  std::vector<scene::SeenMarker> seen;
  Saturations saturations;
  const bool pictures = pull.inject == scene::Inject::kGrey;
  const int frames = static_cast<int>(pull.ends_s * kFps);
  for (int k = 0; k < frames; ++k) {
    for (int i = 1; i < kSteps; ++i) {
      camera.pass();
      last = &camera.snapshot();
    }
    if (pictures) {
      if (!app.step()) break;
    } else {
      camera.pass();
      const scene::Snapshot& now = camera.snapshot();
      rig.clock().advance_to(Micros(std::llround(now.t_s * 1e6)));
      scene::see_markers(camera.simulation(), now, seen);
      MarkerField field;
      field.grid = {static_cast<std::uint8_t>(scene.markers.rows), static_cast<std::uint8_t>(scene.markers.cols)};
      for (std::size_t i = 0; i < seen.size(); ++i) {
        const scene::PointPx at = scene::to_px(camera.picture(), seen[i].at_mm);
        field.markers[i] = {PixelsQ8::saturate(std::llround(at.x * 256.0), saturations),
                            PixelsQ8::saturate(std::llround(at.y * 256.0), saturations), seen[i].valid};
      }
      app.step_markers(field, rig.clock().now(), static_cast<std::uint32_t>(k));
    }
    last = &camera.snapshot();
    const scene::Snapshot& now = *last;
    const double t_s = now.t_s;

    const pipeline::Result& result = app.result();
    const supervisor::Outputs& outputs = app.outputs();
    regulator::Input input;
    input.trusted = prevention == Prevention::kOn && result.quality.ok() &&
                    (outputs.state == DeviceState::kOk || outputs.state == DeviceState::kSlip);
    input.request = result.request;
    input.verdict = result.verdict;
    input.entropy = result.features.entropy;
    input.grip = t_s >= kGripAt;
    input.release = t_s >= kReleaseAt;
    const regulator::Command command = regulator::update(state, settings, input, rig.clock().now());
    gripper.tell(command);

    GraspFrame& frame = grasp.frames.emplace_back();
    frame.t_s = t_s;
    frame.state = outputs.state;
    frame.slip = outputs.slip;
    frame.verdict = result.referenced && result.verdict != Verdict::kHold;
    frame.rates_valid = result.features.rates_valid;
    frame.entropy_nat = result.features.entropy.raw() / 65536.0;
    frame.entropy_rate_nat_s = result.features.entropy_rate.raw() / 256.0;
    frame.phase = command.phase;
    frame.force_counts = command.force;
    frame.position_counts = command.go ? hande::kFullyClosed : hande::kFullyOpen;
    frame.steps = command.steps;
    frame.commanded_n = command.go ? force_of(command.force) : 0.0;
    frame.force_n = force_n;
    frame.load_n = length(now.contact.shear_n);
    frame.slid_mm = length(now.contact.slid_mm);
    frame.share = now.contact.slip_fraction;
    frame.book_mm = book.at_mm();
    if (input.release) continue;
    const bool gripped = t_s > kGripAt + kClose_s;
    if (t_s >= kPullAt && !grasp.first_slip_s && now.level >= scene::SlipLevel::kHalf) grasp.first_slip_s = t_s;
    if (t_s >= kPullAt && !grasp.first_alarm_s && outputs.slip) grasp.first_alarm_s = t_s;
    grasp.slid_mm = std::max(grasp.slid_mm, frame.slid_mm);
    grasp.final_n = frame.commanded_n;
    grasp.steps = command.steps;
    if (gripped && !grasp.lost && (frame.slid_mm > kLost_mm || !(now.contact.contact_radius_mm > 0.0))) {
      grasp.lost = true;
      grasp.lost_at_s = t_s;
    }
  }
  return grasp;
}

namespace {

bool holds(const Pull& pull, double force_n, double until_s) {
  scene::Simulation simulation(scene_of(pull));
  Book book(pull);
  const scene::Snapshot* last = nullptr;
  // Nothing happens before the pull but the press, which needs no time.
  const double from_s = kPullAt - 0.1;
  for (int i = 0; from_s + i * kStep_s < until_s; ++i) {
    const scene::ContactState& contact = last != nullptr ? last->contact : scene::ContactState{};
    last = &simulation.next(book.step(contact, force_n * std::min(1.0, 0.1 * i), from_s + i * kStep_s));
    if (i > 10 && (length(last->contact.slid_mm) > kLost_mm || !(last->contact.contact_radius_mm > 0.0))) return false;
  }
  return true;
}

}  // namespace

double least_force(const Pull& pull, double until_s, double accuracy) {
  // The load is at least the shelf's, and at most that and what the inertia adds twice over.
  double low = 0.8 * pull.shelf_n / pull.friction;
  while (holds(pull, low, until_s)) low *= 0.8;
  double high = 1.25 * low;
  while (!holds(pull, high, until_s)) {
    low = high;
    high *= 1.25;
  }
  while (high - low > accuracy * high) {
    const double middle = 0.5 * (low + high);
    (holds(pull, middle, until_s) ? high : low) = middle;
  }
  return high;
}

Pull random_pull(std::uint64_t seed) {
  scene::Random random(seed, 77, 0);
  const auto between = [&](double least, double most) { return least + (most - least) * random.uniform(); };
  Pull pull;
  pull.name = "pull";
  pull.ends_s = pull.event_s;  // nothing is left to happen
  pull.seed = seed;
  pull.gel.shear_modulus_mpa = between(0.06, 0.11);
  pull.shape.half_x_mm = between(6.0, 8.5);
  pull.shape.half_y_mm = between(4.5, 6.5);
  pull.shape.rim_mm = between(0.6, 1.5);
  pull.shape.tilt_rad = between(-0.02, 0.02);
  pull.friction = between(0.3, 0.8);
  pull.kinetic_share = between(0.75, 1.0);
  pull.mass_kg = between(0.1, 0.4);
  pull.shelf_n = pull.friction * between(4.0, 10.0);
  pull.shelf_kinetic_share = between(0.75, 1.0);
  pull.angle_rad = between(-pi, pi);
  pull.speed_mm_s = between(4.0, 12.0);
  pull.accel_mm_s2 = between(50.0, 300.0);
  pull.start_share = between(0.55, 0.95);
  pull.relief = {scene::ReliefKind::kGrain, between(8.0, 50.0), between(0.4, 0.9)};
  pull.marker_noise_um = between(1.0, 2.0);
  pull.fabrication_um = between(20.0, 60.0);
  return pull;
}

LeastForce least_forces(const Pull& pull) {
  const bool event = pull.friction_drops_to || pull.added_n != 0.0 || pull.bump_mm != 0.0;
  LeastForce least;
  least.pull_n = least.all_n = least_force(pull, event ? pull.event_s : kPullAt + kPullFor);
  if (event) least.all_n = std::max(least.pull_n, least_force(pull, kReleaseAt));
  return least;
}

double most_allowed_n(const LeastForce& least, const Grasp& grasp, const regulator::Config& config) {
  return std::max(1.3 * least.all_n, force_of(grasp.start_counts + 2 * config.force_step));
}

std::vector<Pull> named_pulls() {
  Pull book;
  book.speed_mm_s = 8.0;
  book.name = "book";
  book.help = "pulled out of the shelf with a start too gentle to hold it";
  book.inject = scene::Inject::kGrey;
  book.relief = {scene::ReliefKind::kGrain, 15.0, 0.5};
  book.start_share = 0.65;
  Pull held = book;
  held.start_share = 1.15;
  held.event_s = 3.2;
  Pull drops = held;
  drops.name = "friction_halves";
  drops.help = "a book that is held loses half of its cover's friction on the way";
  drops.friction_drops_to = 0.5;
  Pull added = held;
  added.name = "load_added";
  added.help = "a book that is held gets another on top on the way: 1.4 N more to drag";
  added.added_n = 1.4;
  Pull bump = book;
  bump.name = "bump";
  bump.help = "the arm that holds a hanging book is shaken, three times to and fro; must not trigger";
  bump.start_share = 1.15;
  bump.shelf_n = 0.3;
  bump.hang_n = 1.5;
  bump.bump_mm = 1.5;
  bump.bump_hz = 6.0;
  return {book, drops, added, bump};
}

}  // namespace holdfast::tool
