// SPDX-License-Identifier: Apache-2.0
// Scenes as they play: the truth of the project's three scenes against closed forms written here, and what the
// simulation adds to a contact (drives, creep, mass, exposure, imperfect markers). The contacts themselves have their
// own tests.
#include "drivers/sim/scene/simulation.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <vector>

#include "drivers/sim/scene/scenes.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using std::numbers::pi;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::array kLevels{ContactLevel::kSprings, ContactLevel::kGrid};

// Taken on x86-64; the aarch64 build under qemu-user finds the same. Order of kLevels.
constexpr std::array<std::uint64_t, 2> kHashes{13622688902358280862u, 2466645481905566653u};

double largest(const std::vector<Vec2>& vectors) {
  double most = 0.0;
  for (const Vec2& v : vectors) most = std::max(most, length(v));
  return most;
}

std::vector<Snapshot> play(const Scene& scene) {
  Simulation simulation(scene);
  std::vector<Snapshot> out;
  out.reserve(static_cast<std::size_t>(frame_count(scene)));
  for (int k = 0; k < frame_count(scene); ++k) out.push_back(simulation.next());
  return out;
}

// The same motion, looked at more often.
Scene at_rate(Scene scene, double fps) {
  scene.fps = fps;
  return scene;
}

// Hertz, Cattaneo and Mindlin for sphere_slip, from the figures of its file (Johnson 1985, sections 4.2 and 7.2).
struct Slip {
  double g = 0.1, nu = 0.49, radius = 15.0, mu = 0.5, force = 3.0, speed = 8.0, start_s = 1.48;
  double modulus = 2.0 * g / (1.0 - nu);
  double a = std::cbrt(0.75 * force * radius / modulus);
  double gross_mm = 3.0 * (2.0 - nu) * mu * force / (16.0 * g * a);
  // (c/a)^2 = 1 - way / gross_mm.
  double half_s = start_s + 0.5 * gross_mm / speed;
  double gross_s = start_s + gross_mm / speed;
  Vec2 along{std::cos(20.0 * pi / 180.0), std::sin(20.0 * pi / 180.0)};
};

// A sphere on the default gel that is pressed on at once and stands still from then on, unless a drive moves it.
Scene pressed(double force_n, double duration_s) {
  Scene scene;
  scene.name = "pressed";
  scene.duration_s = duration_s;
  scene.trajectory = {{.t_s = 0.0, .force_n = force_n}};
  return scene;
}

// Press, drag, turn and back, with everything that moves markers on.
Scene everything(ContactLevel level) {
  Scene scene;
  scene.name = "everything";
  scene.seed = 7;
  const bool grid = level == ContactLevel::kGrid;
  scene.duration_s = grid ? 0.48 : 1.6;
  scene.level.contact = level;
  scene.level.cell_mm = 1.0;
  scene.object.friction = 0.6;
  scene.object.kinetic_friction = 0.5;
  const double x_mm = grid ? 0.8 : 3.0;
  scene.trajectory = {
      {.t_s = 0.0, .force_n = 0.0, .x_mm = 0.0, .y_mm = 0.0, .twist_deg = 0.0},
      {.t_s = 0.12, .force_n = 2.5, .x_mm = 0.0, .y_mm = 0.0, .twist_deg = 0.0},
      {.t_s = 0.75 * scene.duration_s, .force_n = 3.0, .x_mm = x_mm, .y_mm = -0.4 * x_mm, .twist_deg = 6.0},
      {.t_s = scene.duration_s, .force_n = 1.0, .x_mm = 0.9 * x_mm, .y_mm = 0.0, .twist_deg = 5.0}};
  scene.profile = Profile::kMinimumJerk;
  scene.effects.press_dilation = 0.04;
  scene.effects.creep_gain = 0.08;
  scene.effects.creep_tau_s = 0.7;
  scene.effects.marker_noise_um = 3.0;
  scene.effects.marker_loss = 0.02;
  scene.effects.marker_missing = 2;
  scene.effects.marker_duplicates = 1;
  scene.effects.fabrication_um = 20.0;
  scene.effects.fabrication_turn_deg = 1.5;
  scene.effects.exposure_ms = 8.0;
  if (level == ContactLevel::kSprings) {
    scene.object.mass_g = 60.0;
    scene.effects.drive_stiffness_n_per_mm = 2.0;
    scene.effects.damping_n_s_per_mm = 0.003;
  }
  return scene;
}

std::uint64_t hash_of(const Scene& scene) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  const auto take = [&hash](Vec2 v) {
    for (const double part : {v.x, v.y}) {
      const auto bits = std::bit_cast<std::uint64_t>(part);
      for (int shift = 0; shift < 64; shift += 8) hash = (hash ^ ((bits >> shift) & 0xff)) * 0x100000001b3u;
    }
  };
  Simulation simulation(scene);
  std::vector<SeenMarker> seen;
  for (const Dot& dot : simulation.dots()) take(dot.rest_mm);
  for (int k = 0; k < frame_count(scene); ++k) {
    const Snapshot& now = simulation.next();
    for (const Vec2& u : now.motion_mm) take(u);
    for (const Vec2& u : now.before_mm) take(u);
    see_markers(simulation, now, seen);
    for (const SeenMarker& marker : seen) take({marker.at_mm.x, marker.valid ? marker.at_mm.y : 0.0});
    take(now.contact.shear_n);
    take(now.contact.slid_mm);
  }
  return hash;
}

void check_finite(const Snapshot& now) {
  const ContactState& c = now.contact;
  for (const double value :
       {c.depth_mm, c.normal_n, c.contact_radius_mm, c.stick_radius_mm, c.slip_fraction, c.shear_n.x, c.shear_n.y,
        c.moment_nmm, c.slid_mm.x, c.slid_mm.y, c.slid_rad, c.center_mm.x, c.center_mm.y, now.object_mm.x,
        now.object_mm.y, now.slide_mm_s, now.slide_deg_s, largest(now.motion_mm), largest(now.before_mm)}) {
    CHECK(std::isfinite(value));
  }
}

}  // namespace

TEST_GROUP(Simulation){};

// --- The three scenes ---

TEST(Simulation, OnsetsOfSphereSlipAreTheClosedForms) {
  const Slip theory;
  // Stamps are multiples of the frame time, and the file's end of the drag is rounded to 0.1 um in 7 mm.
  constexpr double kRate = 4000.0;
  std::array<double, 3> seen_s{-1.0, -1.0, -1.0};
  double fraction = 0.0;
  for (const Snapshot& now : play(at_rate(sphere_slip(), kRate))) {
    for (std::size_t i = 0; i < seen_s.size(); ++i) {
      if (seen_s[i] < 0.0 && static_cast<std::size_t>(now.level) > i) seen_s[i] = now.t_s;
    }
    if (now.t_s >= 2.40) continue;
    CHECK(now.contact.slip_fraction >= fraction);
    fraction = now.contact.slip_fraction;
    CHECK_EQUAL(now.contact.gross, fraction == 1.0);
    if (now.t_s > theory.start_s && now.t_s < theory.gross_s) {
      DOUBLES_EQUAL((now.t_s - theory.start_s) * theory.speed / theory.gross_mm, fraction, 2e-5);
    }
  }
  DOUBLES_EQUAL(1.0, fraction, 0.0);
  DOUBLES_EQUAL(theory.start_s, seen_s[0], 1.01 / kRate);
  DOUBLES_EQUAL(theory.half_s, seen_s[1], 1.01 / kRate);
  DOUBLES_EQUAL(theory.gross_s, seen_s[2], 1.01 / kRate);
  // The promise in the file.
  CHECK(theory.half_s > 1.52 && theory.half_s < 1.56);
}

TEST(Simulation, SlidingObjectTravelsAtItsSpeedAndTakesTheContactAlong) {
  const Slip theory;
  Snapshot before;
  int sliding = 0;
  for (const Snapshot& now : play(sphere_slip())) {
    const ContactState& contact = now.contact;
    if (now.t_s > 1.1 && now.t_s < 2.41) {
      DOUBLES_EQUAL(theory.a, contact.contact_radius_mm, 1e-9);
      DOUBLES_EQUAL(theory.a * theory.a / theory.radius, contact.depth_mm, 1e-9);
    }
    if (now.t_s < theory.gross_s) DOUBLES_EQUAL(0.0, length(contact.slid_mm), 0.0);
    if (now.t_s > theory.gross_s && now.t_s < 2.41) {
      const double way_mm = theory.speed * (now.t_s - theory.start_s);
      DOUBLES_EQUAL(way_mm - theory.gross_mm, length(contact.slid_mm), 1e-4);
      DOUBLES_EQUAL(theory.mu * theory.force, length(contact.shear_n), 1e-9);
      // The imprint is carried by the gel and by the slip.
      DOUBLES_EQUAL(0.4 + way_mm * theory.along.x, contact.center_mm.x, 1e-4);
      DOUBLES_EQUAL(-0.3 + way_mm * theory.along.y, contact.center_mm.y, 1e-4);
      if (before.contact.gross) DOUBLES_EQUAL(theory.speed, now.slide_mm_s, 1e-3);
      ++sliding;
    }
    before = now;
  }
  LONGS_EQUAL(20, sliding);
}

TEST(Simulation, LoadsAndMotionHaveNoJumps) {
  constexpr double kRate = 2000.0;
  Snapshot before;
  for (const Snapshot& now : play(at_rate(sphere_slip(), kRate))) {
    CHECK(std::abs(now.contact.normal_n - before.contact.normal_n) < 15.0 / kRate);  // 2 x 7.5 N/s
    // Contact ends when the force does, and motion goes as its power of 2/3 there.
    CHECK(length(now.contact.shear_n - before.contact.shear_n) < 35.0 / kRate);
    double jump = 0.0;
    for (std::size_t i = 0; i < before.motion_mm.size(); ++i) {
      jump = std::max(jump, length(now.motion_mm[i] - before.motion_mm[i]));
    }
    CHECK(jump < 0.015);
    before = now;
  }
}

// --- Drives ---

TEST(Simulation, TheScriptsDriveFromOutsideIsTheScript) {
  for (const ContactLevel level : kLevels) {
    const Scene scene = everything(level);
    Simulation scripted(scene);
    Simulation driven(scene);
    for (int k = 0; k < frame_count(scene); ++k) {
      const Snapshot& a = scripted.next();
      const Snapshot& b = driven.next(drive_at(scene, k / scene.fps));
      CHECK(a.motion_mm == b.motion_mm);
      CHECK(a.before_mm == b.before_mm);
      CHECK(a.object_mm == b.object_mm);
      CHECK(a.contact.shear_n == b.contact.shear_n);
      LONGS_EQUAL(k, b.frame);
      DOUBLES_EQUAL(k / scene.fps, b.t_s, 0.0);
    }
  }
}

TEST(Simulation, DrivesLieOnTheScriptsCurves) {
  Scene scene;
  scene.trajectory = {{.t_s = 1.0, .depth_mm = 0.2},
                      {.t_s = 2.0, .x_mm = 1.0, .twist_deg = 90.0},
                      {.t_s = 3.0, .depth_mm = 0.6},
                      {.t_s = 4.0, .x_mm = 5.0, .pull_y_n = 2.0}};
  const Drive middle = drive_at(scene, 2.5);
  DOUBLES_EQUAL(0.5, *middle.depth_mm, 1e-12);  // between its own neighbours, at 1 and 3 s
  DOUBLES_EQUAL(2.0, middle.at_mm.x, 1e-12);
  DOUBLES_EQUAL(0.5 * pi, middle.twist_rad, 1e-12);
  DOUBLES_EQUAL(2.0, middle.pull_n.y, 0.0);
  CHECK_FALSE(middle.force_n.has_value() || middle.closing_mm.has_value());
  DOUBLES_EQUAL(0.2, *drive_at(scene, 0.0).depth_mm, 0.0);
  DOUBLES_EQUAL(0.6, *drive_at(scene, 1e9).depth_mm, 0.0);

  // 10 s^3 - 15 s^4 + 6 s^5 (Flash & Hogan 1985): rest at both ends, 15/8 of the mean speed in the middle.
  scene.profile = Profile::kMinimumJerk;
  const auto x = [&](double t_s) { return drive_at(scene, t_s).at_mm.x; };
  DOUBLES_EQUAL(1.0 + 4.0 * 0.103515625, x(2.5), 1e-12);
  DOUBLES_EQUAL(3.0, x(3.0), 1e-12);
  DOUBLES_EQUAL(2.0 * 15.0 / 8.0, (x(3.001) - x(2.999)) / 0.002, 1e-5);
  for (const double end : {2.0, 4.0}) {
    DOUBLES_EQUAL(x(end), x(end + 0.001), 1e-8);
    DOUBLES_EQUAL(x(end), x(end - 0.001), 1e-8);
  }
}

TEST(Simulation, FramesAreCountedInDecimalTimes) {
  Scene scene;
  for (const auto& [fps, duration_s, frames] : std::vector<std::tuple<double, double, int>>{
           {25.0, 3.28, 83}, {18.75, 1.6, 31}, {30.0, 0.1, 4}, {25.0, 0.0, 1}}) {
    scene.fps = fps;
    scene.duration_s = duration_s;
    LONGS_EQUAL(frames, frame_count(scene));
  }
}

TEST(Simulation, ClosingPressesGelAndObjectInSeries) {
  Scene scene = pressed(0.0, 1.0);
  scene.object.compliance_mm_per_n = 0.1;
  const auto close = [&](double closing_mm) {
    Simulation simulation(scene);
    (void)simulation.next();
    return simulation.next({.closing_mm = closing_mm}).contact;
  };
  // The force comes from a table that is 0.2 % high between its entries.
  scene.gel.thickness_mm = kInfinity;
  const double modulus = 2.0 * scene.gel.shear_modulus_mpa / (1.0 - scene.gel.poisson);
  for (const double closing_mm : {0.1, 0.5, 1.0, 2.0}) {
    const double force = close(closing_mm).normal_n;
    // Hertz: depth^3 = 9 P^2 / (16 E*^2 R).
    const double depth = std::cbrt(9.0 * force * force / (16.0 * modulus * modulus * 15.0));
    DOUBLES_EQUAL(closing_mm, depth + 0.1 * force, 0.003 * closing_mm);
  }
  CHECK(close(0.0).normal_n == 0.0);
  CHECK(close(-1.0).normal_n == 0.0);
  // On the layer the depth is the contact's own.
  scene.gel.thickness_mm = 4.25;
  for (const ContactLevel level : kLevels) {
    scene.level.contact = level;
    scene.level.cell_mm = 1.0;
    const ContactState contact = close(1.0);
    DOUBLES_EQUAL(1.0, contact.depth_mm + 0.1 * contact.normal_n, 0.003);
  }
  // A sponge takes nearly all of it, something hard nothing.
  scene.level.contact = ContactLevel::kSprings;
  for (const double compliance : {100.0, 0.0}) {
    scene.object.compliance_mm_per_n = compliance;
    const ContactState contact = close(2.0);
    DOUBLES_EQUAL(2.0, contact.depth_mm + compliance * contact.normal_n, 0.006);
  }
}

TEST(Simulation, LimitsStayFinite) {
  Scene usual = pressed(0.0, 0.4);
  usual.trajectory = {{.t_s = 0.0, .force_n = 0.0, .x_mm = 0.0, .twist_deg = 0.0},
                      {.t_s = 0.1, .force_n = 3.0, .x_mm = 0.0, .twist_deg = 0.0},
                      {.t_s = 0.3, .force_n = 3.0, .x_mm = 4.0, .twist_deg = 20.0},
                      {.t_s = 0.4, .force_n = 0.0}};
  std::vector<Scene> extremes(12, usual);
  extremes[0].object.friction = 0.0;
  for (Waypoint& point : extremes[1].trajectory) {
    if (point.force_n) point.force_n = 0.0;
  }
  extremes[2].trajectory[1].t_s = 0.0001;  // sudden
  extremes[3].object.bonded = true;
  extremes[4].gel.shear_modulus_mpa = 1e-6;
  extremes[5].gel.shear_modulus_mpa = 1e6;
  extremes[6].gel.poisson = 0.5;
  extremes[7].gel.poisson = 0.0;
  extremes[8].trajectory[2].x_mm = 1e6;
  extremes[9].object.mass_g = 1e-3;  // swings a thousand times a frame
  extremes[9].effects.drive_stiffness_n_per_mm = 1e4;
  extremes[10].object.mass_g = 1e5;
  extremes[10].effects.drive_stiffness_n_per_mm = 1e-6;
  extremes[11].object.mass_g = 1e-9;  // no number of steps would follow it
  extremes[11].effects.drive_stiffness_n_per_mm = 0.1;
  extremes[9].duration_s = extremes[11].duration_s = 0.16;  // 4000 steps a frame
  for (const Scene& scene : extremes) {
    Simulation simulation(scene);
    for (int k = 0; k < frame_count(scene) + 3; ++k) check_finite(simulation.next());
    for (const double huge : {1e9, -1e9}) {
      check_finite(simulation.next({.force_n = std::abs(huge), .at_mm = {huge, huge}, .twist_rad = huge}));
      check_finite(simulation.next({.depth_mm = huge}));
      check_finite(simulation.next({.closing_mm = huge}));
    }
  }
}

// --- Creep ---

TEST(Simulation, CreepIsTheStandardLinearSolid) {
  constexpr double kGain = 0.1;
  constexpr double kTau_s = 0.5;
  for (const double fps : {25.0, 200.0}) {  // of a held load each step is exact
    Scene scene = pressed(3.0, 2.0);
    scene.fps = fps;
    scene.effects.creep_gain = kGain;
    scene.effects.creep_tau_s = kTau_s;
    Simulation simulation(scene);
    const std::vector<Vec2> elastic = simulation.next().motion_mm;
    double t_s = 0.0;
    while (t_s < 1.0) {
      const Snapshot& now = simulation.next();
      t_s = now.t_s;
      const double share = 1.0 + kGain * (1.0 - std::exp(-t_s / kTau_s));
      for (std::size_t i = 0; i < elastic.size(); ++i) {
        DOUBLES_EQUAL(share * elastic[i].x, now.motion_mm[i].x, 1e-12);
        DOUBLES_EQUAL(share * elastic[i].y, now.motion_mm[i].y, 1e-12);
      }
    }
    // The load is gone; what has crept goes back in its own time.
    const std::vector<Vec2> left = simulation.next({.force_n = 0.0}).motion_mm;
    CHECK(largest(left) > 0.05 * largest(elastic));
    for (int k = 1; k < 20; ++k) {
      const Snapshot& now = simulation.next({.force_n = 0.0});
      for (std::size_t i = 0; i < left.size(); ++i) {
        DOUBLES_EQUAL(left[i].x * std::exp(-k / fps / kTau_s), now.motion_mm[i].x, 1e-12);
      }
    }
  }
}

// --- Mass ---

namespace {

// 100 g on one spring of friction (it lets go as a whole), pulled through a soft arm. A swing of the damped object
// overshoots by `kOvershoot` of what set it off.
constexpr double kMass_kg = 0.1;
constexpr double kArm = 0.1;  // N/mm
constexpr double kPress_n = 3.0;
constexpr double kStatic = 0.6;
constexpr double kKinetic = 0.4;
constexpr double kDampingShare = 0.1;

Scene stick_slip(double speed_mm_s, double duration_s) {
  Scene scene = pressed(kPress_n, duration_s);
  scene.fps = 1000.0;
  scene.gel.thickness_mm = kInfinity;
  scene.level.contact = ContactLevel::kSprings;
  scene.level.springs = 1;
  scene.object.friction = kStatic;
  scene.object.kinetic_friction = kKinetic;
  scene.object.mass_g = 1000.0 * kMass_kg;
  scene.effects.drive_stiffness_n_per_mm = kArm;
  scene.effects.damping_n_s_per_mm = 1e-3 * 2.0 * kDampingShare * std::sqrt(1000.0 * kArm * kMass_kg);
  scene.trajectory.front().x_mm = 0.0;
  scene.trajectory.push_back({.t_s = duration_s, .x_mm = speed_mm_s * duration_s});
  return scene;
}

}  // namespace

TEST(Simulation, StickSlipHasThePeriodAndAmplitudeOfTheory) {
  constexpr double kSpeed = 10.0;  // mm/s; a twentieth of the speed at which it ends
  std::vector<double> slips_s;     // start of each
  std::vector<double> jumps_mm;
  double from_mm = 0.0;
  bool sliding = false;
  double slid_mm = 0.0;
  const std::vector<Snapshot> all = play(stick_slip(kSpeed, 10.0));
  for (const Snapshot& now : all) {
    CHECK(length(now.contact.shear_n) <= kStatic * kPress_n + 1e-9);
    const bool slides = now.slide_mm_s > 0.0;
    if (slides && !sliding) {
      slips_s.push_back(now.t_s);
      from_mm = slid_mm;
    }
    slid_mm = now.contact.slid_mm.x;
    if (!slides && sliding) jumps_mm.push_back(slid_mm - from_mm);
    sliding = slides;
  }
  CHECK(slips_s.size() >= 6);
  const auto slips = static_cast<double>(slips_s.size() - 2);
  const double period_s = (slips_s.back() - slips_s[1]) / slips;

  const double fall_n = (kStatic - kKinetic) * kPress_n;
  const double gel = 8.0 * 0.035 * std::cbrt(0.75 * kPress_n * 15.0 * 0.51 / 0.07) / 1.51;
  const double swing_s = pi * std::sqrt(kMass_kg / (1000.0 * kArm));
  // The textbook's undamped object on a drive much softer than the gel: 2 (mu_s - mu_k) P / (k v) + pi sqrt(m / k).
  // Damping, which keeps one slip from shaking the next, takes 9 %.
  DOUBLES_EQUAL(2.0 * fall_n / (kArm * kSpeed) + swing_s, period_s, 0.12 * period_s);
  // With both: the object swings by 1 + o of its fall, and back with the gel until that holds it.
  const double overshoot = std::exp(-pi * kDampingShare / std::sqrt(1.0 - kDampingShare * kDampingShare));
  const double stick_s = fall_n * (gel + kArm + overshoot * gel) / (gel * kArm * kSpeed);
  DOUBLES_EQUAL(stick_s + swing_s, period_s, 0.03 * period_s);
  // Amplitude of the textbook: half the way of a slip is (mu_s - mu_k) P / k; damped (1 + o) / 2 of it. The arm
  // goes on meanwhile, and the gel springs back by its share of the fall at once.
  for (std::size_t k = 1; k < jumps_mm.size(); ++k) {
    const double way_mm = (1.0 + overshoot) * fall_n / kArm + kSpeed * swing_s + fall_n / gel;
    DOUBLES_EQUAL(way_mm, jumps_mm[k], 0.03 * way_mm);
  }
  // In the mean the object keeps up with the arm.
  DOUBLES_EQUAL(kSpeed, jumps_mm.back() / period_s, 0.02 * kSpeed);
}

TEST(Simulation, APullMovesAnObjectThatNothingHolds) {
  Scene scene = pressed(0.0, 0.5);
  scene.fps = 100.0;
  scene.object.mass_g = 50.0;
  scene.trajectory = {{.t_s = 0.0, .pull_x_n = 0.02, .pull_y_n = -0.01}};
  const Snapshot last = play(scene).back();
  // Half of F / m t^2, to a step of Euler's: 0.4 and -0.2 m/s^2 for 0.5 s. A step is the whole frame here.
  DOUBLES_EQUAL(50.0, last.object_mm.x, 0.021 * 50.0);
  DOUBLES_EQUAL(-25.0, last.object_mm.y, 0.021 * 25.0);
}

// --- The camera's time ---

TEST(Simulation, BeforeIsWhereMarkersWereWhenTheShutterOpened) {
  Scene scene = pressed(3.0, 0.4);
  scene.object.bonded = true;  // motion goes straight with the object
  scene.level.contact = ContactLevel::kSprings;
  scene.trajectory = {{.t_s = 0.0, .force_n = 3.0, .x_mm = 0.0}, {.t_s = 0.4, .force_n = 3.0, .x_mm = 0.4}};
  for (const Snapshot& now : play(scene)) CHECK(now.before_mm == now.motion_mm);

  scene.effects.exposure_ms = 6.0;
  scene.effects.rolling_shutter_ms = 4.0;  // a quarter of the frame's 40 ms in all
  Snapshot last;
  for (const Snapshot& now : play(scene)) {
    for (std::size_t i = 0; i < last.motion_mm.size(); ++i) {
      DOUBLES_EQUAL(0.25 * last.motion_mm[i].x + 0.75 * now.motion_mm[i].x, now.before_mm[i].x, 1e-9);
      DOUBLES_EQUAL(0.25 * last.motion_mm[i].y + 0.75 * now.motion_mm[i].y, now.before_mm[i].y, 1e-9);
    }
    last = now;
  }
  // The camera changes nothing of what happens.
  Scene closed_shutter = scene;
  closed_shutter.effects = {};
  const std::vector<Snapshot> open = play(scene);
  const std::vector<Snapshot> shut = play(closed_shutter);
  for (std::size_t k = 0; k < open.size(); ++k) {
    DOUBLES_EQUAL(shut[k].contact.shear_n.x, open[k].contact.shear_n.x, 1e-9);
  }
}

TEST(Simulation, TheObjectIsWhereItsDriveHasItAndComesFromWhereItWas) {
  Scene scene = pressed(3.0, 0.4);
  scene.level.contact = ContactLevel::kSprings;
  scene.trajectory = {{.t_s = 0.0, .force_n = 3.0, .x_mm = 0.0, .y_mm = 0.0, .twist_deg = 0.0},
                      {.t_s = 0.8, .force_n = 3.0, .x_mm = 8.0, .y_mm = -4.0, .twist_deg = 40.0}};
  for (const double exposure_ms : {0.0, 10.0}) {
    scene.effects.exposure_ms = exposure_ms;
    for (const Snapshot& now : play(scene)) {
      const double t_s = std::min(now.t_s, 0.8);
      DOUBLES_EQUAL(10.0 * t_s, now.object_mm.x, 1e-9);
      DOUBLES_EQUAL(-5.0 * t_s, now.object_mm.y, 1e-9);
      DOUBLES_EQUAL(50.0 * t_s, now.object_rad * 180.0 / pi, 1e-9);
      // A quarter of the frame before, in a straight line from the last one; it slides or it does not.
      const double last_s = std::max(now.t_s - 0.04, 0.0);
      const double before_s = exposure_ms > 0.0 ? 0.75 * t_s + 0.25 * std::min(last_s, 0.8) : t_s;
      DOUBLES_EQUAL(10.0 * before_s, now.object_before_mm.x, 1e-9);
      DOUBLES_EQUAL(-5.0 * before_s, now.object_before_mm.y, 1e-9);
      DOUBLES_EQUAL(50.0 * before_s, now.object_before_rad * 180.0 / pi, 1e-9);
    }
  }
}

// --- Markers as they are seen ---

TEST(Simulation, SeenMarkersHaveTheNoiseAndTheLossesAskedFor) {
  Scene scene = pressed(0.0, 8.0);
  scene.effects.marker_noise_um = 10.0;
  scene.effects.marker_loss = 0.05;
  scene.effects.marker_missing = 3;
  Simulation simulation(scene);
  std::vector<SeenMarker> seen;
  std::vector<int> count(63);
  double sum = 0.0;
  double square = 0.0;
  double lagged = 0.0;
  Vec2 last{};
  const int frames = frame_count(scene);
  for (int k = 0; k < frames; ++k) {
    const Snapshot& now = simulation.next();
    see_markers(simulation, now, seen);
    LONGS_EQUAL(63, seen.size());
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Vec2 off = seen[i].at_mm - simulation.markers()[i];
      sum += off.x + off.y;
      square += off.x * off.x + off.y * off.y;
      lagged += off.x * last.x + off.y * last.y + off.x * off.y;
      last = off;
      count[i] += seen[i].valid ? 1 : 0;
    }
  }
  const double samples = 2.0 * 63.0 * frames;
  // Four standard errors of 25 326 numbers each; nothing is correlated with its neighbour.
  DOUBLES_EQUAL(0.0, sum / samples, 4.0 * 0.010 / std::sqrt(samples));
  DOUBLES_EQUAL(0.010, std::sqrt(square / samples), 4.0 * 0.010 / std::sqrt(2.0 * samples));
  DOUBLES_EQUAL(0.0, lagged / samples, 4.0 * 0.0001 / std::sqrt(samples));
  int missing = 0;
  int lost = 0;
  for (const int times : count) {
    missing += times == 0 ? 1 : 0;
    if (times > 0) lost += frames - times;
  }
  LONGS_EQUAL(3, missing);
  DOUBLES_EQUAL(0.05, lost / (60.0 * frames), 4.0 * std::sqrt(0.05 * 0.95 / (60.0 * frames)));

  // All off: exact and complete.
  const Scene plain = pressed(3.0, 0.2);
  Simulation exact(plain);
  const Snapshot& now = exact.next();
  see_markers(exact, now, seen);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    CHECK(seen[i].valid);
    DOUBLES_EQUAL(exact.markers()[i].x + now.motion_mm[i].x, seen[i].at_mm.x, 0.0);
    DOUBLES_EQUAL(exact.markers()[i].y + now.motion_mm[i].y, seen[i].at_mm.y, 0.0);
  }
}

TEST(Simulation, DotsAreWhereTheyWerePrinted) {
  Scene scene;
  scene.gel.thickness_mm = kInfinity;  // a layer takes 8 ms to make
  const Simulation plain(scene);
  LONGS_EQUAL(63, plain.dots().size());
  DOUBLES_EQUAL(-4.0 * 2.02, plain.markers()[0].x, 1e-12);
  DOUBLES_EQUAL(-3.0 * 2.02, plain.markers()[0].y, 1e-12);
  DOUBLES_EQUAL(4.0 * 2.02, plain.markers()[8].x, 1e-12);
  DOUBLES_EQUAL(0.0, length(plain.markers()[31]), 1e-12);

  scene.effects.fabrication_turn_deg = 3.0;
  const Simulation turned(scene);
  DOUBLES_EQUAL(2.02 * std::cos(3.0 * pi / 180.0), turned.markers()[32].x, 1e-12);
  DOUBLES_EQUAL(2.02 * std::sin(3.0 * pi / 180.0), turned.markers()[32].y, 1e-12);  // +x towards +y

  scene.effects = {};
  scene.effects.fabrication_um = 50.0;
  scene.effects.marker_duplicates = 20;
  scene.effects.marker_missing = 5;
  double square = 0.0;
  constexpr int kPrints = 40;
  for (int k = 0; k < kPrints; ++k) {
    scene.seed = static_cast<std::uint64_t>(k);
    const Simulation printed(scene);
    LONGS_EQUAL(63 + 20, printed.dots().size());
    int missing = 0;
    for (std::size_t i = 0; i < 63; ++i) {
      const Vec2 off = printed.markers()[i] - plain.markers()[i];
      square += off.x * off.x + off.y * off.y;
      missing += printed.dots()[i].printed ? 0 : 1;
      LONGS_EQUAL(i, printed.dots()[i].marker);
      CHECK_FALSE(printed.dots()[i].extra);
    }
    LONGS_EQUAL(5, missing);
    for (std::size_t i = 63; i < printed.dots().size(); ++i) {
      const Dot& dot = printed.dots()[i];
      CHECK(dot.extra && dot.printed);
      const double aside = length(dot.rest_mm - printed.markers()[static_cast<std::size_t>(dot.marker)]) / 2.02;
      CHECK(aside >= 0.35 - 1e-12 && aside <= 0.5);
    }
  }
  // Four standard errors.
  const double samples = 2.0 * 63.0 * kPrints;
  DOUBLES_EQUAL(0.050, std::sqrt(square / samples), 4.0 * 0.050 / std::sqrt(2.0 * samples));
  scene.effects.marker_missing = 1000;  // all of them, and no more
  const Simulation blank(scene);
  for (std::size_t i = 0; i < 63; ++i) CHECK_FALSE(blank.dots()[i].printed);
}

// --- Determinism ---

// A drag that gathers speed in 0.3 s. The grid's solver leaves half of the cells that slide less than its tolerance
// below their limit of friction.
TEST(Simulation, AllOfACylinderThatSlidesSlips) {
  for (const double speed_mm_s : {4.0, 5.0, 7.5}) {
    constexpr double kStart_s = 1.6, kGathers_s = 0.3, kEnd_s = 3.0;
    Scene scene;
    scene.name = "cylinder";
    scene.duration_s = kEnd_s;
    scene.level.contact = ContactLevel::kGrid;
    scene.object.shape.kind = ShapeKind::kCylinder;
    scene.object.shape.radius_mm = 14.0;
    scene.trajectory = {{.t_s = 0.6, .force_n = 0.0}, {.t_s = 1.0, .force_n = 2.0}, {.t_s = kStart_s, .x_mm = 0.0}};
    for (int k = 1; k <= 6; ++k) {
      const double since_s = kGathers_s * k / 6;
      scene.trajectory.push_back(
          {.t_s = kStart_s + since_s, .x_mm = 0.5 * speed_mm_s * since_s * since_s / kGathers_s});
    }
    const double gone_mm = 0.5 * speed_mm_s * kGathers_s;
    scene.trajectory.push_back(
        {.t_s = kEnd_s, .force_n = 2.0, .x_mm = gone_mm + speed_mm_s * (kEnd_s - kStart_s - kGathers_s)});
    int slides = 0;
    for (const Snapshot& now : play(scene)) {
      // It has gone three times as far as the gel can follow.
      if (now.t_s < 2.4) continue;
      CHECK_TRUE(now.contact.gross);
      ++slides;
    }
    CHECK(slides > 10);
  }
}

TEST(Simulation, TheSameSeedGivesTheSameBitsOnEveryMachine) {
  for (std::size_t i = 0; i < kLevels.size(); ++i) {
    const Scene scene = everything(kLevels[i]);
    const std::uint64_t hash = hash_of(scene);
    CHECK_EQUAL(hash, hash_of(scene));
    if (hash != kHashes[i]) {
      UT_PRINT(StringFromFormat("%s: %llu", kContactLevelNames[i].data(), static_cast<unsigned long long>(hash))
                   .asCharString());
    }
    CHECK_EQUAL(kHashes[i], hash);
    Scene other = scene;
    other.seed = 8;
    CHECK(hash_of(other) != hash);
  }
}
