// SPDX-License-Identifier: Apache-2.0
// A sphere pressed on a half-space, the two loads that shear its surface, and how far it goes until it slides (Hertz
// 1882, Cattaneo 1938, Mindlin 1949): what layer.hpp and springs.hpp build on.
//
// Not modelled: the gel's finite thickness (layer.hpp); partial slip with history (springs.hpp, twist.hpp); coupling of
// press and shear (vanishes for rigid on incompressible gel: Dundurs' beta -> 0 at nu = 1/2); large strain.
//
// Units: mm, N, MPa (= N/mm^2). Formulas: Johnson, Contact Mechanics (1985), chapters 3, 4 and 7.
// Range: any finite numbers with G > 0 and 0 <= nu <= 1/2. No force, no friction, no radius or a radius
// without end is "no contact": every result is 0. No input of that range gives NaN.
#pragma once

#include <limits>

#include "drivers/sim/scene/math/vec2.hpp"

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

struct FrictionContact {
  Gel gel;
  Press press;
  double friction = 0.5;  // mu; infinity = bonded
};

// delta_gross = 3 (2 - nu) mu P / (16 G a): where the last of the stick disc lets go. Infinite when bonded.
[[nodiscard]] double gross_displacement_mm(const FrictionContact& contact);

// Motion of the surface point `at` (contact centre = 0, load along +x) under the traction
// slope * sqrt(radius^2 - r^2) on the disc r < radius. Error <= 5e-11 relative, the worst where the series
// takes over at r = 30 radius.
[[nodiscard]] Vec2 dome_field_mm(const Gel& gel, double radius_mm, double slope_mpa_per_mm, Vec2 at_mm);
// The same under force / (2 pi radius sqrt(radius^2 - r^2)): a disc that moves as one, nothing slips.
[[nodiscard]] Vec2 stuck_field_mm(const Gel& gel, double radius_mm, double force_n, Vec2 at_mm);

}  // namespace holdfast::scene
