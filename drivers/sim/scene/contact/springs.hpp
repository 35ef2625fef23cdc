// SPDX-License-Identifier: Apache-2.0
// A round object pressed and dragged on the gel along any path, by the method of dimensionality reduction (contact
// level `springs`): N independent springs on a line carry the same force at the same displacement as the contact they
// stand for, so reversal, cycles and a normal force that changes under shear come for free. With 64 springs 2 us a
// step, and 8 us with the motion of 63 markers.
//
// Modelled
//   * rigid body of revolution f(r) = A r^n on an elastic half-space: sphere (n = 2), cone (n = 1), blunter ones
//   * Coulomb friction of every spring, in both directions of the plane; partial slip with load history (hysteresis)
//   * normal force or depth that changes under shear: what leaves the contact forgets its shear, what enters starts
//     unstressed where the object then is
//   * static and kinetic friction: a spring holds up to mu_s times its normal force; once it slips it carries
//     mu_k times its normal force, until a step leaves it below that: then it sticks and holds up to mu_s again
//   * gross sliding; energy lost to friction
//   * motion of the gel's surface (Traction, SpringField)
//
// Not modelled
//   * the gel's finite thickness in the springs: they are a half-space's (round.hpp scales them to a layer).
//     SpringField knows the layer
//   * twist; a body that is not round; coupling of press and shear (vanishes at nu = 1/2)
//   * the sideways slip that Coulomb's law along x alone leaves in the annulus (Cattaneo's and Mindlin's neglect too)
//   * time: creep, inertia, ageing or speed of friction, adhesion. A spring that let go and is held still counts as
//     slipping. What a spring sheds as it falls from mu_s to mu_k counts as lost
//
// A step is two: first the depth changes under an object at rest, then the object moves at that depth. One step or
// many give the same state on a straight way at constant depth with one friction; elsewhere the step is the accuracy.
//
// Formulas. Popov & Hess, Method of Dimensionality Reduction in Contact Mechanics and Friction (2015), chapters 3, 5:
// g(x) = |x| * integral of f'(r) / sqrt(x^2 - r^2) dr over r < |x| = kappa A |x|^n, kappa = pi/2, 2, 3pi/4, 8/3 ...;
// normal force E* (d - g) dx, stiffness along the surface G* dx with G* = 4 G / (2 - nu). Oracles: Mindlin &
// Deresiewicz (1953); Johnson, Contact Mechanics (1985), chapter 7.
// A spring here is a cell of [0, extent] and its mirror image. Its normal force and width are the exact integrals over
// the part of the cell in contact, so Hertz's force, mu P and the first stiffness hold for any N; only the cell in
// which stick ends is an average: error O(N^-2). Measured at a = extent: force 0.36 N^-2 mu P, delta_gross
// N^-2 / 3; field of 63 markers 0.15 N^-2 delta_gross rms, but 0.3 N^-1.5 beside the rim of the stick disc.
//
// Units: mm, N, MPa, mJ. Range: any finite numbers; friction may be infinite (bonded). Moduli, lengths, loads and
// A beyond 1e40, and moduli, extent and A below 1e-40, count as that bound; A, extent or G <= 0 is no contact. No input
// of that range gives NaN. The springs use + - * / sqrt only: the same bits on every IEEE machine. (The field uses
// asin.)
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/sim/scene/contact/hertz.hpp"
#include "drivers/sim/scene/contact/layer.hpp"

namespace holdfast::scene {

inline constexpr int kMostSprings = 256;

// f(r) = coefficient * r^exponent, exponent 1 .. 8.
struct Indenter {
  double coefficient = 0.0;
  int exponent = 2;
};

[[nodiscard]] Indenter sphere_indenter(double radius_mm);

struct SpringSetup {
  Gel gel;
  Indenter indenter;
  double extent_mm = 10.0;  // largest contact radius: the springs stand on it, and the depth stops there
  double static_friction = 0.5;
  double kinetic_friction = 0.5;  // at most the static one
  int springs = 64;               // 1 .. kMostSprings; the error counts those in contact
};

struct SpringState {
  double depth_mm = 0.0;
  double normal_force_n = 0.0;
  double contact_radius_mm = 0.0;  // a; 0 = no contact
  Vec2 force_n;                    // carried by friction
  Vec2 displacement_mm;            // object against gel far away
  Vec2 gel_mm;                     // gel under the centre of the contact
  Vec2 slid_mm;                    // slip at the centre of the contact since it touched, summed as a vector
  double stick_radius_mm = 0.0;    // a * sqrt(stick_fraction): Mindlin's c where the stick area is a disc
  double stick_fraction = 0.0;     // of the area of the contact
  double slip_fraction = 0.0;      // the rest of it
  bool sliding = false;            // every spring slips
  double dissipated_mj = 0.0;      // since the start; never falls
  double stored_mj = 0.0;          // in the springs, by shear
};

// Shear traction as a sum of domes slope * sqrt(radius^2 - r^2) and one flat punch force / (2 pi a sqrt(a^2 - r^2)).
// A dome's springs carry (pi/2) slope (radius^2 - x^2) per length (Hertz's own pair), so a line load that is
// piecewise linear in x^2 is a sum of domes whose radii are its knots and whose slopes are its changes of slope; its
// step at the rim is a punch (the derivative of a dome by its radius).
struct Traction {
  struct Dome {
    double radius_mm = 0.0;
    Vec2 slope_mpa_per_mm;
  };
  std::array<Dome, kMostSprings + 1> domes{};
  int count = 0;
  double punch_radius_mm = 0.0;
  Vec2 punch_n;
};

class SpringContact {
 public:
  explicit SpringContact(const SpringSetup& setup);

  // d at which the object presses with `force_n`; the depth of the extent if that is not enough.
  [[nodiscard]] double depth_for_force_mm(double force_n) const;

  // Times both frictions from now on: less while a twist takes its share (contact_twist.hpp), more where a layer
  // presses harder than the springs do.
  void scale_friction(double factor);

  // Object to this depth, then to this place.
  const SpringState& move_to(double depth_mm, Vec2 displacement_mm);
  [[nodiscard]] const SpringState& state() const { return state_; }
  [[nodiscard]] Traction traction() const;

 private:
  [[nodiscard]] double limit_n(int i, bool slips) const;
  void press_to(double depth_mm);
  void settle(int i, Vec2 trial_n, double start_limit_n);
  void travel(Vec2 travel_mm);
  const SpringState& summarize(Vec2 displacement_mm);
  [[nodiscard]] double stick_edge(int last_stuck) const;

  Gel gel_;
  int exponent_ = 2;
  int springs_ = 0;
  double extent_mm_ = 0.0;
  double extent_depth_mm_ = 0.0;  // g(extent); 0 = never any contact
  double normal_modulus_ = 0.0;   // E*
  double shear_modulus_ = 0.0;    // G*
  double static_friction_ = 0.0;
  double kinetic_friction_ = 0.0;
  double friction_scale_ = 1.0;

  // In units of the extent and its depth.
  double rim_ = 0.0;        // a
  double rim_depth_ = 0.0;  // d
  int touching_ = 0;        // springs in contact: 0 .. touching_ - 1
  std::array<double, kMostSprings + 1> edge_{};
  std::array<double, kMostSprings + 1> profile_integral_{};  // of x^n up to the edge
  std::array<double, kMostSprings> width_{};                 // in contact
  std::array<double, kMostSprings> line_load_{};             // integral of d - g over that width

  std::array<Vec2, kMostSprings> force_n_{};
  std::array<bool, kMostSprings> slips_{};
  SpringState state_;
};

// The gel's motion at fixed points, half-space or layer. Remembers what each radius does to each point, so only radii
// that changed (at the rim, while the depth changes) are worked out anew.
class SpringField {
 public:
  SpringField(Layer layer, std::span<const Vec2> points_mm);
  // Where the centre of the contact is on the undeformed gel; 0 until told. Costs all that is remembered.
  void move_center(Vec2 center_mm);
  // motion_mm.size() at least the number of points.
  void evaluate(const Traction& traction, std::span<Vec2> motion_mm);

 private:
  struct Column {
    double radius_mm = -1.0;
    std::vector<double> mean;
    std::vector<double> fan;
  };
  void add(Column& column, bool punch, double radius_mm, Vec2 strength);

  Layer layer_;
  std::vector<Vec2> points_mm_;
  Vec2 center_mm_;
  // Distance from the centre, and its direction doubled.
  std::vector<double> r_mm_, cos_2_, sin_2_;
  std::vector<Column> dome_{kMostSprings + 1};
  Column punch_;
  // Sums of mean and fan under loads along x and y.
  std::vector<double> mean_x_, mean_y_, fan_x_, fan_y_;
};

}  // namespace holdfast::scene
