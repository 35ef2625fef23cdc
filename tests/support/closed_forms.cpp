// SPDX-License-Identifier: Apache-2.0
#include "tests/support/closed_forms.hpp"

#include <cmath>

namespace holdfast::test {

using namespace scene;

namespace {

// Below this Q/(mu P) dome(a) - dome(c) loses more (eps/q) than the slip annulus matters (sqrt(q), and only
// at its rim): the contact counts as stuck. Both errors are below 1e-5 there.
constexpr double kStuckLoad = 3e-11;

bool touches(const FrictionContact& contact) {
  return contact.press.contact_radius_mm > 0.0;
}

double friction_limit_n(const FrictionContact& contact) {
  return contact.friction * contact.press.force_n;
}

}  // namespace

Shear shear_by_force(const FrictionContact& contact, double force_n) {
  if (!touches(contact)) return {};
  const double a = contact.press.contact_radius_mm;
  const double limit_n = friction_limit_n(contact);
  if (force_n == 0.0) return {0.0, 0.0, a, false};
  if (std::abs(force_n) >= limit_n) {
    return {std::copysign(limit_n, force_n), std::copysign(gross_displacement_mm(contact), force_n), 0.0, true};
  }
  if (std::isinf(limit_n)) {
    const double delta = force_n * (2.0 - contact.gel.poisson) / (8.0 * contact.gel.shear_modulus_mpa * a);
    return {force_n, delta, a, false};
  }
  const double load = std::abs(force_n) / limit_n;
  // 1 - (1 - load)^(2/3), exact for small loads.
  const double share = -std::expm1(2.0 / 3.0 * std::log1p(-load));
  return {force_n, std::copysign(gross_displacement_mm(contact) * share, force_n), a * std::cbrt(1.0 - load), false};
}

Shear shear_by_displacement(const FrictionContact& contact, double displacement_mm) {
  if (!touches(contact)) return {};
  const double a = contact.press.contact_radius_mm;
  const double gross_mm = gross_displacement_mm(contact);
  if (displacement_mm == 0.0) return {0.0, 0.0, a, false};
  if (std::abs(displacement_mm) >= gross_mm) {
    return {std::copysign(friction_limit_n(contact), displacement_mm), std::copysign(gross_mm, displacement_mm), 0.0,
            true};
  }
  if (std::isinf(gross_mm)) {
    const double force = displacement_mm * 8.0 * contact.gel.shear_modulus_mpa * a / (2.0 - contact.gel.poisson);
    return {force, displacement_mm, a, false};
  }
  const double share = std::abs(displacement_mm) / gross_mm;
  const double load = -std::expm1(1.5 * std::log1p(-share));
  return {std::copysign(friction_limit_n(contact) * load, displacement_mm), displacement_mm, a * std::sqrt(1.0 - share),
          false};
}

double slip_fraction(const FrictionContact& contact, const Shear& shear) {
  if (!touches(contact)) return 0.0;
  const double ratio = shear.stick_radius_mm / contact.press.contact_radius_mm;
  return (1.0 - ratio) * (1.0 + ratio);
}

Vec2 shear_field_mm(const FrictionContact& contact, const Shear& shear, Vec2 at) {
  if (!touches(contact) || shear.force_n == 0.0) return {};
  const double a = contact.press.contact_radius_mm;
  if (std::abs(shear.force_n) / friction_limit_n(contact) < kStuckLoad) {
    return stuck_field_mm(contact.gel, a, shear.force_n, at);
  }
  // mu p0 sqrt(1 - r^2/a^2) and (c/a) mu p0 sqrt(1 - r^2/c^2) are domes of the same slope mu p0 / a, so
  // nothing is divided by c.
  const double slope = std::copysign(contact.friction * contact.press.peak_pressure_mpa / a, shear.force_n);
  const Vec2 full = dome_field_mm(contact.gel, a, slope, at);
  const Vec2 stick = dome_field_mm(contact.gel, shear.stick_radius_mm, slope, at);
  return {full.x - stick.x, full.y - stick.y};
}

}  // namespace holdfast::test
