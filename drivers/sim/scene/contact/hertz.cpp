// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/hertz.hpp"

#include <cmath>
#include <numbers>

#include "drivers/sim/scene/math/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Beyond this r/a the closed form's two large terms cancel (they lose (r/a)^2 digits); three terms of the
// series are good to (a/r)^6 / 30 there, so both sides meet at about 4e-11.
constexpr double kFarField = 30.0;

bool touches(const FrictionContact& contact) {
  return contact.press.contact_radius_mm > 0.0;
}

double friction_limit_n(const FrictionContact& contact) {
  return contact.friction * contact.press.force_n;
}

// Shared by both fields: radius over distance, and the direction doubled.
struct Outside {
  double ratio;  // a / r < 1
  double cos_2;
  double sin_2;
};

Outside outside(double radius_mm, Vec2 at, double r) {
  const double cos_1 = at.x / r;
  const double sin_1 = at.y / r;
  return {radius_mm / r, (cos_1 - sin_1) * (cos_1 + sin_1), 2.0 * cos_1 * sin_1};
}

// sqrt(1 - ratio^2) without cancellation near the rim.
double complement(double ratio) {
  return std::sqrt((1.0 - ratio) * (1.0 + ratio));
}

}  // namespace

double effective_modulus_mpa(const Gel& gel) {
  return 2.0 * gel.shear_modulus_mpa / (1.0 - gel.poisson);
}

Press press_sphere(const Gel& gel, double sphere_radius_mm, double force_n) {
  if (!(force_n > 0.0) || !(sphere_radius_mm > 0.0) || !(gel.shear_modulus_mpa > 0.0)) return {};
  const double a = portable::cbrt(0.75 * force_n * sphere_radius_mm / effective_modulus_mpa(gel));
  // A radius too small or too large to square has no pressure that a number can hold.
  if (!(a * a > 0.0) || !std::isfinite(a * a)) return {};
  return {force_n, a, a * a / sphere_radius_mm, 3.0 * force_n / (2.0 * pi * a * a)};
}

double gross_displacement_mm(const FrictionContact& contact) {
  if (!touches(contact)) return 0.0;
  const Gel& gel = contact.gel;
  return 3.0 * (2.0 - gel.poisson) * friction_limit_n(contact) /
         (16.0 * gel.shear_modulus_mpa * contact.press.contact_radius_mm);
}

Vec2 dome_field_mm(const Gel& gel, double radius_mm, double slope_mpa_per_mm, Vec2 at) {
  if (!(radius_mm > 0.0)) return {};
  const double nu = gel.poisson;
  const double scale = slope_mpa_per_mm / (8.0 * gel.shear_modulus_mpa);
  const double r = portable::hypot(at.x, at.y);
  if (r <= radius_mm) {
    const double inside = 0.25 * pi * scale;
    return {
        inside * (4.0 * (2.0 - nu) * radius_mm * radius_mm - (4.0 - 3.0 * nu) * at.x * at.x - (4.0 - nu) * at.y * at.y),
        inside * 2.0 * nu * at.x * at.y};
  }
  const Outside o = outside(radius_mm, at, r);
  const double e2 = o.ratio * o.ratio;
  double mean = 0.0;  // (2 a^2 - r^2) s + a r w
  double fan = 0.0;   // B = r^2 s + (2 a^2 - r^2) w a / r
  if (r >= kFarField * radius_mm) {
    const double cubic = radius_mm * radius_mm * o.ratio;  // a^3 / r
    mean = cubic * (4.0 / 3.0 + e2 * (2.0 / 15.0 + e2 * (3.0 / 70.0)));
    fan = cubic * (8.0 / 3.0 - e2 * (4.0 / 5.0 + e2 * (1.0 / 7.0)));
  } else {
    const double s = portable::asin(o.ratio);
    const double w = complement(o.ratio);
    mean = r * r * ((2.0 * e2 - 1.0) * s + o.ratio * w);
    fan = r * r * (s + (2.0 * e2 - 1.0) * w * o.ratio);
  }
  return {scale * ((2.0 - nu) * mean + 0.5 * nu * fan * o.cos_2), scale * 0.5 * nu * fan * o.sin_2};
}

// The derivative of dome(c) by c: a dome that grows from c to c + dc leaves a flat punch's traction.
Vec2 stuck_field_mm(const Gel& gel, double radius_mm, double force_n, Vec2 at) {
  if (!(radius_mm > 0.0)) return {};
  const double nu = gel.poisson;
  const double scale = force_n / (4.0 * pi * gel.shear_modulus_mpa * radius_mm);
  const double r = portable::hypot(at.x, at.y);
  if (r <= radius_mm) return {scale * (2.0 - nu) * 0.5 * pi, 0.0};
  const Outside o = outside(radius_mm, at, r);
  const double fan = nu * o.ratio * complement(o.ratio);
  return {scale * ((2.0 - nu) * portable::asin(o.ratio) + fan * o.cos_2), scale * fan * o.sin_2};
}

}  // namespace holdfast::scene
