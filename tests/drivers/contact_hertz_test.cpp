// SPDX-License-Identifier: Apache-2.0
// Hertz, and Cattaneo's and Mindlin's closed forms that the other contacts are measured with
// (support/closed_forms.hpp). Oracles: quadrature of Boussinesq's and Cerruti's point-load solutions over the textbook
// tractions, force balance, finite differences, and the limits where the answer is known without a formula.
#include "drivers/sim/scene/contact/hertz.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "tests/support/closed_forms.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using namespace holdfast::test::sphere_example;
using namespace holdfast::test;
using std::numbers::pi;

namespace {

// Cerruti: surface motion under a tangential point load q dA along x at distance s, direction phi:
//   ux = q dA / (2 pi G s) ((1 - nu) + nu cos^2 phi),  uy = q dA / (2 pi G s) nu cos phi sin phi.
// Polar around the field point: the 1/s goes with the area element s ds dphi. `traction` depends on r alone
// and is 0 outside `radius`; nodes gather at the ends of each ray, where a dome's slope is infinite.
Vec2 cerruti(const Gel& gel, double radius, const std::function<double(double)>& traction, Vec2 at) {
  constexpr int kRays = 2000;
  constexpr int kNodes = 300;
  Vec2 u;
  for (int i = 0; i < kRays; ++i) {
    const double phi = (i + 0.5) * 2.0 * pi / kRays;
    const double c = std::cos(phi);
    const double s = std::sin(phi);
    const double along = at.x * c + at.y * s;
    const double chord2 = along * along - (at.x * at.x + at.y * at.y - radius * radius);
    if (chord2 <= 0.0) continue;
    const double near = std::max(0.0, -along - std::sqrt(chord2));
    const double far = std::max(0.0, -along + std::sqrt(chord2));
    double ray = 0.0;
    for (int k = 0; k < kNodes; ++k) {
      const double angle = (k + 0.5) * pi / kNodes;
      const double way = near + (far - near) * 0.5 * (1.0 - std::cos(angle));
      ray += traction(std::hypot(at.x + way * c, at.y + way * s)) * std::sin(angle);
    }
    ray *= (far - near) * 0.5 * pi / kNodes;
    u.x += ((1.0 - gel.poisson) + gel.poisson * c * c) * ray;
    u.y += gel.poisson * c * s * ray;
  }
  const double scale = 2.0 * pi / kRays / (2.0 * pi * gel.shear_modulus_mpa);
  return {u.x * scale, u.y * scale};
}

// Traction as the textbook writes it, with p0 and both square roots.
double textbook_traction(const FrictionContact& contact, double c, double r) {
  const double a = contact.press.contact_radius_mm;
  const double limit = contact.friction * contact.press.peak_pressure_mpa;
  double q = r < a ? limit * std::sqrt(1.0 - r * r / (a * a)) : 0.0;
  if (r < c) q -= limit * (c / a) * std::sqrt(1.0 - r * r / (c * c));
  return q;
}

void check_finite(Vec2 u) {
  CHECK(std::isfinite(u.x));
  CHECK(std::isfinite(u.y));
}

constexpr std::array<Vec2, 8> kPoints{{{0, 0}, {1, 0.5}, {2, -1.5}, {3.6, 0.2}, {0.4, 4.3}, {5, 2}, {-7, 1}, {1, 11}}};

}  // namespace

TEST_GROUP(ContactHertz){};

TEST(ContactHertz, HertzCarriesTheForceAndMeetsTheSphere) {
  const Press press = press_sphere(kGel, kSphere_mm, kPress_n);
  const double a = press.contact_radius_mm;
  // Sum of the pressure over rings, and Boussinesq's sinking (1 - nu) / G * integral of p dr in the centre.
  double force = 0.0;
  double sinking = 0.0;
  constexpr int kRings = 200000;
  for (int i = 0; i < kRings; ++i) {
    const double r = (i + 0.5) * a / kRings;
    const double p = press.peak_pressure_mpa * std::sqrt(1.0 - r * r / (a * a));
    force += 2.0 * pi * r * p * a / kRings;
    sinking += (1.0 - kGel.poisson) / kGel.shear_modulus_mpa * p * a / kRings;
  }
  DOUBLES_EQUAL(kPress_n, force, 1e-6 * kPress_n);  // N; quadrature error of the rim's infinite slope
  DOUBLES_EQUAL(press.depth_mm, sinking, 1e-6 * press.depth_mm);
  DOUBLES_EQUAL(a * a / kSphere_mm, press.depth_mm, 1e-12);
  DOUBLES_EQUAL(2.0 * 0.1 / 0.51, effective_modulus_mpa(kGel), 1e-12);
}

TEST(ContactHertz, StickRadiusBalancesTheForce) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  for (const double load : {0.1, 0.5, 0.9, 0.999}) {
    const double force = load * kFriction * kPress_n;
    const double c = shear_by_force(contact, force).stick_radius_mm;
    double sum = 0.0;
    constexpr int kRings = 200000;
    for (int i = 0; i < kRings; ++i) {
      const double r = (i + 0.5) * a / kRings;
      sum += 2.0 * pi * r * textbook_traction(contact, c, r) * a / kRings;
    }
    DOUBLES_EQUAL(force, sum, 1e-5 * force);
  }
}

TEST(ContactHertz, FieldAgreesWithCerrutisIntegral) {
  const FrictionContact contact = contact_of();
  for (const double load : {0.3, 0.9, 1.0}) {
    const Shear shear = shear_by_force(contact, load * kFriction * kPress_n);
    for (const Vec2 at : kPoints) {
      // Two integrals, one per dome: each has its infinite slope at the end of its own rays.
      const double a = contact.press.contact_radius_mm;
      const double c = shear.stick_radius_mm;
      const Vec2 full = cerruti(
          kGel, a, [&](double r) { return textbook_traction(contact, 0.0, r); }, at);
      Vec2 stick;
      if (c > 0.0) {
        stick = cerruti(
            kGel, c, [&](double r) { return textbook_traction(contact, 0.0, r) - textbook_traction(contact, c, r); },
            at);
      }
      const Vec2 u = shear_field_mm(contact, shear, at);
      // 1e-4 of the largest motion in the field: the quadrature's own error.
      DOUBLES_EQUAL(full.x - stick.x, u.x, 1e-4 * shear.displacement_mm);
      DOUBLES_EQUAL(full.y - stick.y, u.y, 1e-4 * shear.displacement_mm);
    }
  }
}

TEST(ContactHertz, GrossDisplacementIsWhereTheStickDiscVanishes) {
  const FrictionContact contact = contact_of();
  const double gross = gross_displacement_mm(contact);
  // The centre of a contact whose traction is mu p everywhere.
  const Vec2 u =
      cerruti(kGel, contact.press.contact_radius_mm, [&](double r) { return textbook_traction(contact, 0.0, r); }, {});
  DOUBLES_EQUAL(u.x, gross, 1e-5 * gross);
  CHECK_FALSE(shear_by_displacement(contact, gross * (1.0 - 1e-12)).sliding);
  CHECK_TRUE(shear_by_displacement(contact, gross).sliding);
  DOUBLES_EQUAL(kFriction * kPress_n, shear_by_displacement(contact, 3.0 * gross).force_n, 1e-15);
}

TEST(ContactHertz, NothingGivesNothing) {
  struct Case {
    Gel gel;
    double sphere_mm, force_n, friction;
  };
  for (const Case& c : {Case{kGel, 8.0, 0.0, 0.6}, Case{kGel, 0.0, 8.0, 0.6}, Case{kGel, kInfinity, 8.0, 0.6},
                        Case{kGel, 8.0, 8.0, 0.0}, Case{kGel, 8.0, 0.0, kInfinity}, Case{kGel, 1e-300, 1e-300, 0.6},
                        Case{kGel, 8.0, -1.0, 0.6}}) {
    const FrictionContact contact{c.gel, press_sphere(c.gel, c.sphere_mm, c.force_n), c.friction};
    for (const double load : {0.0, 1.0, -1.0}) {
      const Shear by_force = shear_by_force(contact, load);
      const Shear by_way = shear_by_displacement(contact, load);
      for (const Shear& shear : {by_force, by_way}) {
        DOUBLES_EQUAL(0.0, shear.force_n, 0.0);
        DOUBLES_EQUAL(0.0, shear.displacement_mm, 0.0);
        CHECK(std::isfinite(shear.stick_radius_mm));
        CHECK(std::isfinite(slip_fraction(contact, shear)));
        for (const Vec2 at : kPoints) CHECK((shear_field_mm(contact, shear, at) == Vec2{}));
      }
    }
  }
}

TEST(ContactHertz, EveryPlaceAndLoadIsFinite) {
  for (const double poisson : {0.0, 0.3, 0.5}) {
    for (const double modulus : {1e-6, 0.1, 1e6}) {
      const Gel gel{modulus, poisson};
      for (const double friction : {0.0, 0.6, 1e12, kInfinity}) {
        const FrictionContact contact{gel, press_sphere(gel, kSphere_mm, kPress_n), friction};
        const double a = contact.press.contact_radius_mm;
        for (const double force : {0.0, 1e-300, 1e-12, 4.0, 4.8, 1e9, -4.0}) {
          const Shear shear = shear_by_force(contact, force);
          for (const double r : {0.0, 1e-300, a, std::nextafter(a, 2.0 * a), shear.stick_radius_mm, 1e9, 1e150}) {
            check_finite(shear_field_mm(contact, shear, {r, 0.0}));
            check_finite(shear_field_mm(contact, shear, {0.0, -r}));
          }
        }
      }
    }
  }
}
