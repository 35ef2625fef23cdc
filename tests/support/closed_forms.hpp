// SPDX-License-Identifier: Apache-2.0
// Cattaneo's and Mindlin's partial slip of a sphere on a half-space in closed form, an oracle of the contact levels:
// a stick disc inside a slip annulus under monotone shear, and how the surface moves. Johnson, Contact Mechanics
// (1985), chapter 7. Checked by contact_hertz_test.cpp against Cerruti's point loads.
#pragma once

#include <cstdint>
#include <limits>

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

// A sphere on a half-space, on which the levels are tried.
namespace sphere_example {
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr scene::Gel kGel{0.1, 0.49};
inline constexpr double kSphere_mm = 8.0;
inline constexpr double kPress_n = 8.0;
inline constexpr double kFriction = 0.6;

[[nodiscard]] inline scene::FrictionContact contact_of(double friction = kFriction, double press_n = kPress_n) {
  return {kGel, scene::press_sphere(kGel, kSphere_mm, press_n), friction};
}

// Numerical Recipes' quick generator: a path that is the same everywhere.
struct Dice {
  std::uint32_t seed = 1;
  double next() {
    seed = seed * 1664525U + 1013904223U;
    return static_cast<double>(seed >> 8) / 16777216.0;
  }
};
}  // namespace sphere_example

}  // namespace holdfast::test
