// SPDX-License-Identifier: Apache-2.0
// Cattaneo's and Mindlin's partial slip of a sphere on a half-space in closed form, an oracle of the contact levels:
// a stick disc inside a slip annulus under monotone shear, and how the surface moves. Johnson, Contact Mechanics
// (1985), chapter 7. Checked by contact_hertz_test.cpp against Cerruti's point loads.
#pragma once

#include "drivers/sim/scene/contact/hertz.hpp"

namespace holdfast::test {

// Force and displacement carry the sign of the load.
struct Shear {
  double force_n = 0.0;          // carried by friction, at most mu P
  double displacement_mm = 0.0;  // delta: stick disc against gel far away; gross_displacement_mm() in sliding
  double stick_radius_mm = 0.0;  // c; 0 in sliding
  bool sliding = false;
};

[[nodiscard]] Shear shear_by_force(const scene::FrictionContact& contact, double force_n);
[[nodiscard]] Shear shear_by_displacement(const scene::FrictionContact& contact, double displacement_mm);
// 1 - (c/a)^2: share of the contact's area that slips.
[[nodiscard]] double slip_fraction(const scene::FrictionContact& contact, const Shear& shear);
// Motion of the surface point `at` (contact centre = 0, load along +x): dome(a) - dome(c).
[[nodiscard]] scene::Vec2 shear_field_mm(const scene::FrictionContact& contact, const Shear& shear, scene::Vec2 at_mm);

}  // namespace holdfast::test
