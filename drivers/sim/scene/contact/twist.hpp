// SPDX-License-Identifier: Apache-2.0
// A sphere turned on the gel about the normal: Lubkin's partial slip with load history by springs, the motion of the
// gel's surface, and the rule by which shear and twist share one friction.
//
// Modelled
//   * rigid sphere on an elastic half-space under Hertz's pressure; Coulomb friction: a stick disc inside a slip
//     annulus
//   * turning of the whole contact; a bonded contact (mu infinite) that never slips
//   * reversal, cycles, a normal force that changes under twist, static and kinetic friction
//   * motion of every surface point, around the centre of the contact
//   * shear and twist together: an ellipse of their limits (share_friction)
//
// Not modelled
//   * the gel's finite thickness. Each state is a sum of turned discs (TwistDiscs), so what a layer adds is
//     Layer::torque(a, r) - Layer(half-space).torque(a, r) of each disc, times disc_moment_nmm: smooth, unlike the
//     field itself, which bends sharply at each disc's rim
//   * shapes that are not round; twist that changes the shear's slip annulus other than by the ellipse; time
//
// Formulas, c = radius of the stick disc, s = c/a, E and K of the modulus sqrt(1 - s^2): Lubkin (1951), in the form
// that follows from dM = (16/3) G c^3 dbeta (a disc of radius c turned as one, Reissner & Sagoci 1944):
//   G a^2 beta / (mu P) = (3 / 4 pi) (K - E),   M / (mu P a) = (4 / pi) * integral of s^2 E(s) from c/a to 1,
//   M_max = (3 pi / 16) mu P a.   beta grows as ln(a/c): at c = a / 1000 the contact counts as turning. M is within
//   7e-10 of M_max there.
// The surface is a sum of discs, each turned as one: u(r) = integral over c < s < a of U(r, s) |dbeta/ds| ds with
//   U = r inside s, (2/pi) (r asin(s/r) - s sqrt(1 - s^2/r^2)) outside.
//
// Units: mm, N, N mm, MPa, rad, mJ. Range: any finite numbers, friction may be infinite; no force, no friction, no
// radius are no contact or no hold, as in hertz.hpp. No input of that range gives NaN. Only + - * / sqrt and
// portable.hpp: the same bits on every IEEE machine.
#pragma once

#include <array>
#include <cstddef>

#include "drivers/sim/scene/contact/hertz.hpp"

namespace holdfast::scene {

inline constexpr int kMostTwistSprings = 256;

// --- a twisted surface as turned discs ---

struct TwistDiscs {
  struct Disc {
    double radius_mm = 0.0;
    double turn_rad = 0.0;
    double spread_mm = 0.0;  // the turn is shared evenly by discs of radius - spread .. radius + spread
  };
  std::array<Disc, kMostTwistSprings + 1> discs{};
  int count = 0;
};

// (16/3) G turn (radius^3 + radius spread^2).
[[nodiscard]] double disc_moment_nmm(const Gel& gel, const TwistDiscs::Disc& disc);
// Around the centre, at distance r, of the half-space.
[[nodiscard]] double disc_motion_mm(const TwistDiscs::Disc& disc, double r_mm);

// --- twist with load history ---

struct TwistSpringSetup {
  double shear_modulus_mpa = 0.1;
  double extent_mm = 10.0;  // largest contact radius: the springs stand on it, a larger contact counts as that
  int springs = 64;         // 1 .. kMostTwistSprings; the error counts those in contact
};

struct TwistSpringState {
  double moment_nmm = 0.0;         // carried by friction
  double contact_radius_mm = 0.0;  // 0 = no contact
  double stick_radius_mm = 0.0;    // a * sqrt(stick_fraction): Lubkin's c where the stick area is a disc
  double stick_fraction = 0.0;     // of the area of the contact
  double slip_fraction = 0.0;      // the rest of it
  double gel_rad = 0.0;            // turn of the gel under the centre of the contact
  double slid_rad = 0.0;           // of the object against it, since they touched
  bool turning = false;            // every spring slips
  double dissipated_mj = 0.0;      // since the start; never falls
  double stored_mj = 0.0;          // in the springs
};

// Parallel springs and sliders (Iwan 1966). A spring is a ring s .. s + ds of stiffness 16 G s^2 ds that holds up to
// the angle at which Lubkin's stick disc has that radius: so a first twist is Lubkin's, a reversal Masing's. Springs
// are cells of [0, extent] whose stiffness and hold are exact integrals over the part of the cell in contact: the first
// stiffness and M_max hold for any N; only the cell in which stick ends is an average. Measured at a = extent in a
// first twist: moment 1.2 N^-2 M_max at worst, 0.28 N^-2 rms; stick radius 0.9 N^-2 a; field of 63 markers (discs) 0.4
// N^-2 of the rim's motion rms for c > a / 2, 0.9 N^-2 for c = a / 5; with 64 springs 2e-4 at worst, 6e-3 on the way
// back. About 1 us a step for 64 springs.
//
// A contact that shrinks takes moment and energy of what leaves it along; what enters starts unstressed. A spring that
// slips carries the kinetic limit until a step leaves it below that. A step is two: first the press changes under an
// object at rest, then the object turns. One step or many give the same state at constant press with one friction.
class TwistSprings {
 public:
  explicit TwistSprings(const TwistSpringSetup& setup);

  // Hertz's pressure of `press` (its radius and force), then the object turns by `turn_rad`. The frictions are what is
  // left for the twist (share_friction), kinetic at most static.
  const TwistSpringState& step(const Press& press, double static_friction, double kinetic_friction, double turn_rad);

  [[nodiscard]] const TwistSpringState& state() const { return state_; }
  // The springs' turns as discs: number k between springs k and k + 1 (so the first ones stay put, and what they do to
  // a marker does), then two at the rim.
  [[nodiscard]] TwistDiscs discs() const;

 private:
  void press_to(const Press& press);
  void settle(std::size_t k, double trial_nmm, double start_limit_nmm);
  void turn(double turn_rad);
  void summarize();
  [[nodiscard]] double limit_nmm(std::size_t k, bool slips) const;
  [[nodiscard]] double stiffness(std::size_t k) const;
  [[nodiscard]] double center(std::size_t k) const;
  [[nodiscard]] double stick_edge(std::size_t last_stuck) const;

  double shear_modulus_ = 0.0;
  double extent_mm_ = 0.0;
  std::size_t springs_ = 0;
  double static_friction_ = 0.0;
  double kinetic_friction_ = 0.0;

  // Radii in units of the extent.
  double rim_ = 0.0;          // a
  std::size_t touching_ = 0;  // springs in contact: 0 .. touching_ - 1
  std::array<double, kMostTwistSprings + 1> edge_{};
  std::array<double, kMostTwistSprings> outer_{};     // of the part in contact
  std::array<double, kMostTwistSprings> hold_nmm_{};  // limit with friction 1
  std::array<double, kMostTwistSprings> moment_nmm_{};
  std::array<bool, kMostTwistSprings> slips_{};
  TwistSpringState state_;
};

// --- shear and twist together ---

// Shares of one friction: limits become for_shear * mu P and for_twist * M_max.
struct FrictionShare {
  double for_shear = 1.0;
  double for_twist = 1.0;
};

// Limit surface (Q / mu P)^2 + (M / M_max)^2 = 1, as an ellipse (Howe & Cutkosky 1996; the exact surface of Hertz's
// pressure lies within 6 % of it, contact_grid_test.cpp). Given is what each load would be alone, over its limit;
// beyond 1 how far its motion is beyond the limit; the sign does not count. Inside the ellipse each load has what the
// other leaves: sqrt(1 - other^2); outside it both get what lies on the ellipse in their direction. Continuous; a load
// that the other does not disturb has the whole friction, exactly. NaN (0 over a limit of 0) counts as 0; infinite
// loads against each other count as equal.
[[nodiscard]] FrictionShare share_friction(double shear_load, double twist_load);

}  // namespace holdfast::scene
