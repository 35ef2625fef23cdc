// SPDX-License-Identifier: Apache-2.0
// A sphere pressed and dragged on the gel, in closed form: Hertz's press, Cattaneo's and Mindlin's partial
// slip, and the motion of the gel's surface where the markers sit. About 5 us for 63 markers.
//
// Modelled
//   * rigid sphere on an elastic half-space (G, nu), contact radius, pressure, depth (Hertz 1882)
//   * Coulomb friction: stick disc inside a slip annulus under monotone shear (Cattaneo 1938, Mindlin 1949)
//   * gross sliding at Q = mu P; a bonded contact (mu infinite) that never slips
//   * tangential motion of every surface point, along and across the load
//
// Not modelled
//   * the gel's finite thickness. A bonded layer of 4.25 mm moves less than this half-space: at a = 4 mm
//     0.75x in the centre, 0.63x at the rim, 0.39x 4 mm outside along the load and 0.02x across it; at
//     a = 2 mm 0.87x, 0.78x, 0.49x and 0.06x
//   * load history: each state is the one reached by monotone shear at the present normal force
//   * coupling of press and shear (vanishes for rigid on incompressible gel: Dundurs' beta -> 0 at nu = 1/2),
//     large strain, creep, static against kinetic friction, inertia, twist, other shapes
//
// Units: mm, N, MPa (= N/mm^2). Formulas: Johnson, Contact Mechanics (1985), chapters 3, 4 and 7.
// Range: any finite numbers with G > 0 and 0 <= nu <= 1/2. No force, no friction, no radius or a radius
// without end is "no contact": every result is 0. No input of that range gives NaN.
#pragma once

#include <limits>

#include "drivers/sim/scene/vec2.hpp"

namespace holdfast::scene {

struct Gel {
  double shear_modulus_mpa = 0.1;
  double poisson = 0.49;
  double thickness_mm = std::numeric_limits<double>::infinity();  // of the layer bonded to glass; infinite = half-space
};

// E* = E / (1 - nu^2) = 2 G / (1 - nu): the indenter is rigid.
[[nodiscard]] double effective_modulus_mpa(const Gel& gel);

struct Press {
  double force_n = 0.0;
  double contact_radius_mm = 0.0;  // a; 0 = no contact
  double depth_mm = 0.0;           // a^2 / R
  double peak_pressure_mpa = 0.0;  // p0
};

[[nodiscard]] Press press_sphere(const Gel& gel, double sphere_radius_mm, double force_n);

// Below this Q/(mu P) dome(a) - dome(c) loses more (eps/q) than the slip annulus matters (sqrt(q), and only
// at its rim): the contact counts as stuck. Both errors are below 1e-5 there.
inline constexpr double kStuckLoad = 3e-11;

struct FrictionContact {
  Gel gel;
  Press press;
  double friction = 0.5;  // mu; infinity = bonded
};

// State of a sheared contact. Force and displacement carry the sign of the load.
struct Shear {
  double force_n = 0.0;          // carried by friction, at most mu P
  double displacement_mm = 0.0;  // delta: stick disc against gel far away; delta_gross in sliding
  double stick_radius_mm = 0.0;  // c; 0 in sliding
  bool sliding = false;
};

// delta_gross = 3 (2 - nu) mu P / (16 G a): where the last of the stick disc lets go. Infinite when bonded.
[[nodiscard]] double gross_displacement_mm(const FrictionContact& contact);
[[nodiscard]] Shear shear_by_force(const FrictionContact& contact, double force_n);
[[nodiscard]] Shear shear_by_displacement(const FrictionContact& contact, double displacement_mm);
// dQ/ddelta = 8 G c / (2 - nu); 0 in sliding.
[[nodiscard]] double tangent_stiffness_n_per_mm(const FrictionContact& contact, const Shear& shear);
// 1 - (c/a)^2: share of the contact's area that slips.
[[nodiscard]] double slip_fraction(const FrictionContact& contact, const Shear& shear);

// Motion of the surface point `at` (contact centre = 0, load along +x) under the traction
// slope * sqrt(radius^2 - r^2) on the disc r < radius. Error <= 5e-11 relative, the worst where the series
// takes over at r = 30 radius.
[[nodiscard]] Vec2 dome_field_mm(const Gel& gel, double radius_mm, double slope_mpa_per_mm, Vec2 at_mm);
// The same under force / (2 pi radius sqrt(radius^2 - r^2)): a disc that moves as one, nothing slips.
[[nodiscard]] Vec2 stuck_field_mm(const Gel& gel, double radius_mm, double force_n, Vec2 at_mm);
// Motion of the surface point `at` in the sheared contact: dome(a) - dome(c).
[[nodiscard]] Vec2 shear_field_mm(const FrictionContact& contact, const Shear& shear, Vec2 at_mm);

}  // namespace holdfast::scene
