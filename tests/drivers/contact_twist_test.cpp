// SPDX-License-Identifier: Apache-2.0
// Oracles: elliptic integrals and Lubkin's curve by plain quadrature, Cerruti's point loads over the friction traction,
// Coulomb's law in the slip annulus, finite differences, Masing's rule, energy balance.
#include "drivers/sim/scene/contact_twist.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using std::numbers::pi;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr Gel kGel{0.1, 0.49};
constexpr double kSphere_mm = 8.0;
constexpr double kPress_n = 8.0;
constexpr double kFriction = 0.6;

FrictionContact contact_of(double friction = kFriction, double press_n = kPress_n) {
  return {kGel, press_sphere(kGel, kSphere_mm, press_n), friction};
}

// mu P = 1, G = 1, a = 1: moments and angles are the numbers of the notes.
FrictionContact unit_contact() {
  return {{1.0, 0.49}, {1.0, 1.0, 1.0, 1.5 / pi}, 1.0};
}

double angle_unit(const FrictionContact& c) {
  const double a = c.press.contact_radius_mm;
  return c.friction * c.press.force_n / (c.gel.shear_modulus_mpa * a * a);
}

double moment_unit(const FrictionContact& c) {
  return c.friction * c.press.force_n * c.press.contact_radius_mm;
}

double midpoint(const std::function<double(double)>& f, double from, double to, int n) {
  const double h = (to - from) / n;
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += f(from + h * (i + 0.5));
  return sum * h;
}

// Quarter of the ellipse with half axes 1 and s. A periodic integrand: the midpoint rule gains digits with every node.
double ellipse(double s) {
  return midpoint([s](double phi) { return std::hypot(std::cos(phi), s * std::sin(phi)); }, 0.0, pi / 2.0,
                  s > 0.2 ? 60 : static_cast<int>(20.0 / s));
}

// Lubkin's curve from dM = (16/3) G c^3 dbeta and beta' = (3 / 4 pi) E(s) / s.
double oracle_angle(double c) {
  return midpoint([](double t) { return 0.75 / pi * ellipse(std::exp(-t)); }, 0.0, -std::log(c), 2000);
}

double oracle_moment(double c) {
  return midpoint([](double s) { return 4.0 / pi * s * s * ellipse(s); }, c, 1.0, 2000);
}

double turned(double r, double s) {
  if (r <= s) return r;
  return 2.0 / pi * (r * std::asin(s / r) - s * std::sqrt(1.0 - s * s / (r * r)));
}

// Field of the unit contact with stick radius c, from the superposition; s = r (1 - v^2) below r takes out the kink.
double oracle_field(double r, double c) {
  if (r <= c) return r * oracle_angle(c);
  const double larger = r < 1.0 ? r * oracle_angle(r) : 0.0;
  const double begin = r > 1.0 ? std::sqrt(1.0 - 1.0 / r) : 0.0;
  return larger + midpoint(
                      [r](double v) {
                        const double s = r * (1.0 - v * v);
                        return 0.75 / pi * ellipse(s) / s * turned(r, s) * 2.0 * v * r;
                      },
                      begin, std::sqrt(1.0 - c / r), 400);
}

double order(double coarse, double fine) {
  return std::log2(std::abs(coarse) / std::abs(fine));
}

void check_finite(const Twist& t) {
  CHECK(std::isfinite(t.moment_nmm));
  CHECK(std::isfinite(t.angle_rad));
  CHECK(std::isfinite(t.stick_radius_mm));
}

void check_finite(const TwistSpringState& s) {
  for (const double value : {s.moment_nmm, s.contact_radius_mm, s.stick_radius_mm, s.stick_fraction, s.slip_fraction,
                             s.gel_rad, s.slid_rad, s.dissipated_mj, s.stored_mj}) {
    CHECK(std::isfinite(value));
  }
  CHECK(s.dissipated_mj >= 0.0);
  CHECK(s.stick_fraction >= 0.0 && s.slip_fraction >= 0.0 && s.stick_radius_mm <= s.contact_radius_mm);
}

// Numerical Recipes' quick generator: a path that is the same everywhere.
struct Dice {
  std::uint32_t seed = 1;
  double next() {
    seed = seed * 1664525U + 1013904223U;
    return static_cast<double>(seed >> 8) / 16777216.0;
  }
};

struct Row {
  double c, moment, angle;
};
constexpr std::array<Row, 7> kNotes{{{0.98, 0.03901, 0.00754},
                                     {0.9, 0.17635, 0.03851},
                                     {0.8, 0.31053, 0.07942},
                                     {0.6, 0.48048, 0.17164},
                                     {0.4, 0.55919, 0.28853},
                                     {0.2, 0.58554, 0.46925},
                                     {1e-3, 0.58905, 1.74133}}};

}  // namespace

TEST_GROUP(ContactTwist){};

TEST(ContactTwist, RowsOfTheNotes) {
  const FrictionContact contact = unit_contact();
  for (const Row& row : kNotes) {
    // Half a digit of the row's last, divided by the slopes: the rows are rounded.
    const double angle = row.c > 1e-3 ? row.angle : 1.7413;
    const Twist twist = twist_by_angle(contact, angle);
    DOUBLES_EQUAL(row.moment, twist.moment_nmm, 4e-5);
    DOUBLES_EQUAL(row.c, twist.stick_radius_mm, 5e-5);
    CHECK_FALSE(twist.turning);
    if (row.c > 0.1) {
      const Twist back = twist_by_moment(contact, row.moment);
      DOUBLES_EQUAL(row.c, back.stick_radius_mm, 3e-4);
      DOUBLES_EQUAL(row.angle, back.angle_rad, 4e-4);
    }
  }
  DOUBLES_EQUAL(1.74133, gross_angle_rad(contact), 5e-6);
  DOUBLES_EQUAL(3.0 * pi / 16.0, moment_limit_nmm(contact), 1e-15);
}

TEST(ContactTwist, AgreesWithQuadrature) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  for (const double c : {0.999, 0.95, 0.7, 0.5, 0.3, 0.1, 0.03}) {
    const double angle = oracle_angle(c) * angle_unit(contact);
    const Twist twist = twist_by_angle(contact, angle);
    // 1e-6: the midpoint rules' own error.
    DOUBLES_EQUAL(c * a, twist.stick_radius_mm, 1e-6 * a);
    DOUBLES_EQUAL(oracle_moment(c) * moment_unit(contact), twist.moment_nmm, 1e-6 * twist.moment_nmm);
    const Twist back = twist_by_moment(contact, twist.moment_nmm);
    // Where M hardly grows any more, the moment's last digit is 1e-16 / c^3 of the radius.
    DOUBLES_EQUAL(twist.stick_radius_mm, back.stick_radius_mm, 1e-13 / (c * c * c) * a);
    DOUBLES_EQUAL(angle, back.angle_rad, 1e-13 / (c * c * c) * angle);
  }
}

TEST(ContactTwist, StiffnessIsTheSlope) {
  const FrictionContact contact = contact_of();
  for (const double load : {1e-6, 0.01, 0.1, 0.3, 0.8}) {
    const double angle = load * angle_unit(contact);
    const double h = 1e-4 * angle;
    const double slope =
        (twist_by_angle(contact, angle + h).moment_nmm - twist_by_angle(contact, angle - h).moment_nmm) / (2.0 * h);
    const double stiffness = tangent_stiffness_nmm_per_rad(contact, twist_by_angle(contact, angle));
    DOUBLES_EQUAL(stiffness, slope, 1e-6 * stiffness);  // h^2 and, for small c, digits of M
  }
}

TEST(ContactTwist, SmallTwistsKeepTheirDigits) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  const double stuck = 16.0 / 3.0 * kGel.shear_modulus_mpa * a * a * a;
  for (double load = 1e-5; load > 1e-30; load *= 0.1) {
    const double angle = load * angle_unit(contact);
    const Twist twist = twist_by_angle(contact, angle);
    // Series of K - E: c/a = 1 - (8/3) b + (16/9) b^2, so M = (16/3) G a^3 beta (1 - 4 b + (80/9) b^2). 1e-14:
    // rounding.
    DOUBLES_EQUAL(1.0 - 4.0 * load + 80.0 / 9.0 * load * load, twist.moment_nmm / (stuck * angle), 2e-14);
    DOUBLES_EQUAL(1.0 - 8.0 / 3.0 * load, twist.stick_radius_mm / a, 1e-15 + 10.0 * load * load);
    const Twist back = twist_by_moment(contact, twist.moment_nmm);
    DOUBLES_EQUAL(1.0, back.angle_rad / angle, 2e-14);
    DOUBLES_EQUAL(1.0, twist_field_mm(contact, twist, {0.5 * a, 0.0}).y / (0.5 * a * angle), 1e-14);
  }
  const double denormal = std::numeric_limits<double>::denorm_min();
  check_finite(twist_by_angle(contact, denormal));
  check_finite(twist_by_moment(contact, denormal));
}

TEST(ContactTwist, SignsAndOrder) {
  const FrictionContact contact = contact_of();
  double before = 0.0;
  for (double load = 0.01; load < 2.5; load *= 1.1) {
    const double angle = load * angle_unit(contact);
    const Twist there = twist_by_angle(contact, angle);
    const Twist back = twist_by_angle(contact, -angle);
    CHECK(there.moment_nmm >= before);
    CHECK(there.moment_nmm <= moment_limit_nmm(contact));
    DOUBLES_EQUAL(-there.moment_nmm, back.moment_nmm, 0.0);
    DOUBLES_EQUAL(there.stick_radius_mm, back.stick_radius_mm, 0.0);
    before = there.moment_nmm;
    LONGS_EQUAL(load > 1.7414, there.turning);
  }
}

// The discs' tractions (4/pi) G beta r / sqrt(s^2 - r^2) must add up to Coulomb's mu p in the slip annulus.
TEST(ContactTwist, SlipAnnulusCarriesFriction) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  for (const double at : {0.2, 0.5, 0.8, 0.95}) {
    const double r = at * a;
    const double last = oracle_angle(at) * angle_unit(contact);
    const double traction = midpoint(
        [&](double x) {
          const double c = twist_by_angle(contact, last * (1.0 - x * x)).stick_radius_mm;
          return 4.0 / pi * kGel.shear_modulus_mpa * r / std::sqrt(c * c - r * r) * 2.0 * last * x;
        },
        0.0, 1.0, 400);
    const double friction = kFriction * contact.press.peak_pressure_mpa * std::sqrt(1.0 - at * at);
    DOUBLES_EQUAL(friction, traction, 1e-4 * friction);  // midpoint rule, and the oracle's angle at c = r
  }
}

// Cerruti's point loads under mu p turned around: the motion of a turning contact, without any disc.
TEST(ContactTwist, TurningFieldAgreesWithCerruti) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  const double limit = kFriction * contact.press.peak_pressure_mpa;
  const Twist twist = twist_by_angle(contact, 10.0);
  CHECK(twist.turning);
  for (const double at : {0.1, 0.4, 0.8, 0.97, 1.05, 1.5, 3.0}) {
    const double x = at * a;
    constexpr int kRays = 2000;
    constexpr int kNodes = 200;
    double u = 0.0;
    for (int i = 0; i < kRays; ++i) {
      const double phi = (i + 0.5) * 2.0 * pi / kRays;
      const double c = std::cos(phi);
      const double s = std::sin(phi);
      const double along = x * c;
      const double chord2 = along * along - (x * x - a * a);
      if (chord2 <= 0.0) continue;
      const double near = std::max(0.0, -along - std::sqrt(chord2));
      const double far = std::max(0.0, -along + std::sqrt(chord2));
      for (int k = 0; k < kNodes; ++k) {
        const double angle = (k + 0.5) * pi / kNodes;
        const double way = near + (far - near) * 0.5 * (1.0 - std::cos(angle));
        const double px = x + way * c;
        const double py = way * s;
        const double r = std::hypot(px, py);
        const double q = limit * std::sqrt(std::max(0.0, 1.0 - r * r / (a * a)));
        const double qx = -q * py / r;
        const double qy = q * px / r;
        u += ((1.0 - kGel.poisson + kGel.poisson * s * s) * qy + kGel.poisson * s * c * qx) * std::sin(angle) *
             (far - near) * 0.5 * pi / kNodes;
      }
    }
    u *= 2.0 * pi / kRays / (2.0 * pi * kGel.shear_modulus_mpa);
    const Vec2 field = twist_field_mm(contact, twist, {x, 0.0});
    DOUBLES_EQUAL(0.0, field.x, 1e-15);
    DOUBLES_EQUAL(u, field.y, 3e-4 * u);  // the rays' steps across the rim
  }
}

TEST(ContactTwist, FieldIsTheSumOfTurnedDiscs) {
  const FrictionContact contact = unit_contact();
  for (const double c : {0.99, 0.8, 0.4, 0.1, 0.05, 0.01}) {
    const Twist twist = twist_by_angle(contact, oracle_angle(c));
    const TwistDiscs discs = twist_discs(contact, twist);
    const double rim = oracle_field(1.0, c);
    for (const double r : {0.3, 0.45, 0.7, 0.85, 0.95, 0.995, 1.0, 1.002, 1.05, 1.3, 2.0, 6.0, 29.0, 31.0, 100.0}) {
      const double wanted = oracle_field(r, c);
      const Vec2 field = twist_field_mm(contact, twist, {0.6 * r, 0.8 * r});
      DOUBLES_EQUAL(0.6 * wanted, field.y, 5e-6 * rim);
      DOUBLES_EQUAL(-0.8 * wanted, field.x, 5e-6 * rim);
      if (r >= 1.0) DOUBLES_EQUAL(0.6 * wanted, twist_field_mm(discs, {0.6 * r, 0.8 * r}).y, 4e-6 * rim);
    }
    double moment = 0.0;
    double angle = 0.0;
    for (int i = 0; i < discs.count; ++i) {
      moment += disc_moment_nmm(contact.gel, discs.discs[static_cast<std::size_t>(i)]);
      angle += discs.discs[static_cast<std::size_t>(i)].turn_rad;
    }
    DOUBLES_EQUAL(twist.moment_nmm, moment, 1e-13);
    DOUBLES_EQUAL(twist.angle_rad, angle, 1e-13);
    // A point moment, far away.
    DOUBLES_EQUAL(twist.moment_nmm / (4.0 * pi * 1e8), twist_field_mm(contact, twist, {1e4, 0.0}).y,
                  3e-6 * moment / 1e9);
  }
}

TEST(ContactTwist, FieldIsContinuous) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  for (const double load : {0.9e-11, 1.1e-11, 1e-9, 1e-3, 0.1, 1.0, 5.0}) {
    const Twist twist = twist_by_angle(contact, load * angle_unit(contact));
    const double rim = twist_field_mm(contact, twist, {a, 0.0}).y;
    CHECK(rim > 0.0);
    for (const double at : {twist.stick_radius_mm, a, 30.0 * a}) {
      if (!(at > 0.0)) continue;
      // A step of 1e-9 a beside the rim of a disc moves by the square root of it; 1e-7 is the series' seam.
      const double in = twist_field_mm(contact, twist, {at * (1.0 - 1e-9), 0.0}).y;
      const double out = twist_field_mm(contact, twist, {at * (1.0 + 1e-9), 0.0}).y;
      DOUBLES_EQUAL(in, out, 1e-4 * rim);
    }
    // Around the stuck load both formulas say the same.
    const TwistDiscs discs = twist_discs(contact, twist);
    DOUBLES_EQUAL(twist_field_mm(discs, {1.5 * a, 0.0}).y, twist_field_mm(contact, twist, {1.5 * a, 0.0}).y,
                  2e-5 * rim);
    const Vec2 center = twist_field_mm(contact, twist, {0.0, 0.0});
    DOUBLES_EQUAL(0.0, std::hypot(center.x, center.y), 0.0);
  }
}

TEST(ContactTwist, BondedTurnsAsOne) {
  const FrictionContact contact = contact_of(kInfinity);
  const double a = contact.press.contact_radius_mm;
  for (const double angle : {1e-300, 1e-9, 0.1, pi, 1e6}) {
    const Twist twist = twist_by_angle(contact, angle);
    const double moment = 16.0 / 3.0 * kGel.shear_modulus_mpa * a * a * a * angle;
    DOUBLES_EQUAL(moment, twist.moment_nmm, 1e-14 * moment);
    DOUBLES_EQUAL(a, twist.stick_radius_mm, 0.0);
    DOUBLES_EQUAL(0.0, slip_fraction(contact, twist), 0.0);
    DOUBLES_EQUAL(angle, twist_by_moment(contact, moment).angle_rad, 1e-14 * angle);
    DOUBLES_EQUAL(turned(2.0 * a, a) * angle, twist_field_mm(contact, twist, {2.0 * a, 0.0}).y, 1e-12 * a * angle);
    LONGS_EQUAL(1, twist_discs(contact, twist).count);
  }
}

TEST(ContactTwist, NothingHoldsNothing) {
  for (const FrictionContact& contact :
       {FrictionContact{kGel, {}, 0.5}, contact_of(0.0), contact_of(0.5, 0.0), contact_of(kInfinity, 0.0)}) {
    for (const double angle : {0.0, 1e-320, 0.1, -pi, 1e300}) {
      for (const Twist& twist : {twist_by_angle(contact, angle), twist_by_moment(contact, angle)}) {
        DOUBLES_EQUAL(0.0, twist.moment_nmm, 0.0);
        DOUBLES_EQUAL(0.0, twist.angle_rad, 0.0);
        const Vec2 u = twist_field_mm(contact, twist, {1.0, 1.0});
        CHECK(u == Vec2{});
        LONGS_EQUAL(0, twist_discs(contact, twist).count);
      }
    }
  }
}

TEST(ContactTwist, ExtremesAreFinite) {
  for (const double modulus : {1e-6, 0.035, 1e6}) {
    for (const double sphere : {1e-9, 8.0, 1e9}) {
      for (const double press : {1e-300, 1e-9, 8.0, 1e9}) {
        for (const double friction : {1e-300, 0.5, 1e3}) {
          const Gel gel{modulus, 0.5};
          const FrictionContact contact{gel, press_sphere(gel, sphere, press), friction};
          for (const double angle : {0.0, 1e-320, 1e-12, 0.1, -pi, pi, 1e300}) {
            const Twist twist = twist_by_angle(contact, angle);
            check_finite(twist);
            check_finite(twist_by_moment(contact, angle));
            for (const double x : {0.0, 1e-12, 1.0, 1e9}) {
              const Vec2 u = twist_field_mm(contact, twist, {x, -x});
              const Vec2 v = twist_field_mm(twist_discs(contact, twist), {x, -x});
              CHECK(std::isfinite(u.x) && std::isfinite(u.y) && std::isfinite(v.x) && std::isfinite(v.y));
            }
          }
        }
      }
    }
  }
}

TEST_GROUP(TwistSprings) {
  FrictionContact contact = contact_of();
  double a = contact.press.contact_radius_mm;
  double unit = angle_unit(contact);
  double limit = moment_limit_nmm(contact);
  TwistSprings springs_of(int n, double extent_mm = 0.0) const {
    return TwistSprings({kGel.shear_modulus_mpa, extent_mm > 0.0 ? extent_mm : a, n});
  }
  const TwistSpringState& turn(TwistSprings & springs, double turn_rad, double kinetic = kFriction) const {
    return springs.step(contact.press, kFriction, kinetic, turn_rad);
  }
  double lubkin(double angle) const {
    return twist_by_angle(contact, angle).moment_nmm;
  }
};

TEST(TwistSprings, FirstTwistIsLubkins) {
  for (const double load : {0.02, 0.08, 0.2, 0.5}) {
    std::array<double, 3> error{};
    std::array<double, 3> stick{};
    const Twist closed = twist_by_angle(contact, load * unit);
    for (std::size_t i = 0; i < 3; ++i) {
      TwistSprings springs = springs_of(32 << i);
      const TwistSpringState& s = turn(springs, load * unit);
      error[i] = std::abs(s.moment_nmm - closed.moment_nmm) / limit;
      stick[i] = std::abs(s.stick_radius_mm - closed.stick_radius_mm) / a;
      const double n = 32 << i;
      CHECK(error[i] <= 1.25 / (n * n));
      CHECK(stick[i] <= 0.9 / (n * n));
    }
  }
}

TEST(TwistSprings, SecondOrderInTheirNumber) {
  // Where in a cell stick ends changes the error; the mean square over a sweep of the angle does not know.
  const auto error = [&](int n) {
    double sum = 0.0;
    for (int i = 0; i < 400; ++i) {
      const double angle = 0.5 * unit * (i + 0.5) / 400;
      TwistSprings springs = springs_of(n);
      const double e = (turn(springs, angle).moment_nmm - lubkin(angle)) / limit;
      sum += e * e;
    }
    return std::sqrt(sum / 400);
  };
  double before = error(8);
  for (const int n : {16, 32, 64, 128}) {
    const double here = error(n);
    CHECK(order(before, here) > 1.8 && order(before, here) < 2.3);
    before = here;
  }
}

TEST(TwistSprings, StiffnessAndLimitHoldForAnyNumber) {
  for (const int n : {1, 2, 3, 64, 100, 256}) {
    for (const double extent : {1.0, 1.3, 7.7}) {
      TwistSprings springs = springs_of(n, extent * a);
      const double angle = 1e-9 * unit;
      const double stuck = 16.0 / 3.0 * kGel.shear_modulus_mpa * a * a * a * angle;
      DOUBLES_EQUAL(stuck, turn(springs, angle).moment_nmm, 1e-12 * stuck);
      const TwistSpringState& s = turn(springs, 100.0 * unit);
      DOUBLES_EQUAL(limit, s.moment_nmm, 1e-13 * limit);
      CHECK(s.turning);
      DOUBLES_EQUAL(0.0, s.stick_radius_mm, 0.0);
      DOUBLES_EQUAL(100.0 * unit + angle, s.slid_rad + s.gel_rad, 1e-12 * unit);
    }
  }
}

TEST(TwistSprings, ReversalFollowsMasing) {
  TwistSprings springs = springs_of(128);
  const double error = 2.0 * 1.25 / (128.0 * 128.0) * limit;  // of the way back: twice a first twist's
  const double top = 0.3 * unit;
  turn(springs, top);
  const double back = 0.05 * unit;
  for (int i = 1; i <= 12; ++i) {
    const double moment = turn(springs, -back).moment_nmm;
    DOUBLES_EQUAL(lubkin(top) - 2.0 * lubkin(0.5 * i * back), moment, error);
    // The stick disc of the way back is that of half the way.
    const double c = twist_by_angle(contact, 0.5 * i * back).stick_radius_mm;
    DOUBLES_EQUAL(c, springs.state().stick_radius_mm, 2e-3 * a);
  }
  // The loop closes: at -top, and again at top.
  DOUBLES_EQUAL(-lubkin(top), springs.state().moment_nmm, error);
  for (int i = 0; i < 12; ++i) turn(springs, back);
  DOUBLES_EQUAL(lubkin(top), springs.state().moment_nmm, error);
  // An inner loop is forgotten when it closes.
  turn(springs, -0.1 * unit);
  turn(springs, 0.1 * unit);
  turn(springs, 0.1 * unit);
  DOUBLES_EQUAL(lubkin(top + 0.1 * unit), springs.state().moment_nmm, error);
}

TEST(TwistSprings, StepsDoNotMatterAtConstantPress) {
  TwistSprings one = springs_of(64);
  TwistSprings many = springs_of(64);
  for (const double way : {0.4, -0.5, 0.9, -3.0}) {
    turn(one, way * unit);
    for (int i = 0; i < 1000; ++i) turn(many, way * unit / 1000);
    DOUBLES_EQUAL(one.state().moment_nmm, many.state().moment_nmm, 1e-10 * limit);
    DOUBLES_EQUAL(one.state().slid_rad, many.state().slid_rad, 1e-10 * unit);
    DOUBLES_EQUAL(one.state().stick_radius_mm, many.state().stick_radius_mm, 1e-8 * a);
    DOUBLES_EQUAL(one.state().dissipated_mj, many.state().dissipated_mj, 1e-10 * limit * unit);
  }
}

TEST(TwistSprings, EnergyBalances) {
  TwistSprings springs = springs_of(64);
  Dice dice;
  double work = 0.0;
  double lost = 0.0;
  for (int i = 0; i < 3000; ++i) {
    const double way = (dice.next() - 0.5) * 0.1 * unit;
    for (int part = 0; part < 16; ++part) {
      const double before = springs.state().moment_nmm;
      work += 0.5 * (before + turn(springs, way / 16.0).moment_nmm) * way / 16.0;
    }
    const TwistSpringState& s = springs.state();
    CHECK(s.dissipated_mj >= lost);
    lost = s.dissipated_mj;
    check_finite(s);
  }
  // The trapezoid rule on steps in which springs let go: 2e-4 here.
  DOUBLES_EQUAL(work, lost + springs.state().stored_mj, 1e-3 * work);
  CHECK(work > 10.0 * springs.state().stored_mj);
}

TEST(TwistSprings, WhatLeavesForgetsAndWhatEntersIsUnstressed) {
  // So much friction that nothing slips.
  TwistSprings springs = springs_of(64);
  const auto step = [&](double radius, double way) {
    return springs.step({kPress_n, radius, 1.0, 1.0}, 1e9, 1e9, way).moment_nmm;
  };
  const double stuck = 16.0 / 3.0 * kGel.shear_modulus_mpa * a * a * a;
  DOUBLES_EQUAL(0.01 * stuck, step(a, 0.01), 1e-12 * stuck);
  DOUBLES_EQUAL(0.01 * 0.125 * stuck, step(0.5 * a, 0.0), 1e-12 * stuck);
  const double stored = springs.state().stored_mj;
  DOUBLES_EQUAL(0.5 * 0.01 * 0.01 * stuck, stored + springs.state().dissipated_mj, 1e-12 * stuck);
  // A part of a spring leaves likewise.
  DOUBLES_EQUAL(0.01 * 0.001 * stuck, step(0.1 * a, 0.0), 1e-12 * stuck);
  TwistSprings whole = springs_of(1);
  whole.step({kPress_n, a, 1.0, 1.0}, 1e9, 1e9, 0.01);
  DOUBLES_EQUAL(0.01 * 0.125 * stuck, whole.step({kPress_n, 0.5 * a, 1.0, 1.0}, 1e9, 1e9, 0.0).moment_nmm,
                1e-12 * stuck);
  DOUBLES_EQUAL(0.5 * 0.01 * 0.01 * 0.875 * stuck, whole.state().dissipated_mj, 1e-12 * stuck);
  step(0.0, 0.0);
  step(0.5 * a, 0.01);
  // Back to the full radius: the ring is new. Then all of it turns.
  DOUBLES_EQUAL(0.01 * 0.125 * stuck, step(a, 0.0), 1e-12 * stuck);
  DOUBLES_EQUAL((0.01 * 0.125 + 0.02) * stuck, step(a, 0.02), 1e-12 * stuck);
  // Gone and back: everything is new.
  DOUBLES_EQUAL(0.0, step(0.0, 0.3), 0.0);
  DOUBLES_EQUAL(0.0, springs.state().slid_rad, 0.0);
  DOUBLES_EQUAL(0.0, step(a, 0.0), 0.0);
}

TEST(TwistSprings, LessPressLetsGo) {
  TwistSprings springs = springs_of(64);
  turn(springs, 0.4 * unit);
  double lost = springs.state().dissipated_mj;
  for (double press_n = kPress_n; press_n > 1e-3; press_n *= 0.9) {
    const FrictionContact now = contact_of(kFriction, press_n);
    const TwistSpringState& s = springs.step(now.press, kFriction, kFriction, 0.0);
    CHECK(s.moment_nmm >= 0.0 && s.moment_nmm <= moment_limit_nmm(now) * (1.0 + 1e-9));
    CHECK(s.dissipated_mj >= lost);
    lost = s.dissipated_mj;
  }
}

TEST(TwistSprings, KineticFrictionCarriesLess) {
  const double kinetic = 0.8 * kFriction;
  // One spring: it holds up to the static limit, then falls to the kinetic one, and what it shed is lost.
  TwistSprings single = springs_of(1);
  const double stuck = 16.0 / 3.0 * kGel.shear_modulus_mpa * a * a * a;
  DOUBLES_EQUAL(0.95 * limit, turn(single, 0.95 * limit / stuck, kinetic).moment_nmm, 1e-12 * limit);
  DOUBLES_EQUAL(0.8 * limit, turn(single, 0.15 * limit / stuck, kinetic).moment_nmm, 1e-12 * limit);
  const double unit_mj = limit * limit / stuck;
  DOUBLES_EQUAL((0.8 * 0.3 + 0.5 * 0.2 * 0.2) * unit_mj, single.state().dissipated_mj, 1e-12 * unit_mj);
  TwistSprings springs = springs_of(64);
  turn(springs, 5.0 * unit, kinetic);
  CHECK(springs.state().turning);
  DOUBLES_EQUAL(0.8 * limit, springs.state().moment_nmm, 1e-9 * limit);
  // Held still they go on slipping; a step back makes them stick and hold the static limit again.
  turn(springs, 0.0, kinetic);
  CHECK(springs.state().turning);
  turn(springs, -1e-6 * unit, kinetic);
  DOUBLES_EQUAL(a, springs.state().stick_radius_mm, 1e-4 * a);
  const double before = springs.state().moment_nmm;
  turn(springs, 1e-3 * unit, kinetic);
  CHECK(springs.state().moment_nmm > before);
}

TEST(TwistSprings, DiscsAreTheFieldOfTheClosedForm) {
  const auto error = [&](int n, double load) {
    TwistSprings springs = springs_of(n);
    turn(springs, load * unit);
    const Twist closed = twist_by_angle(contact, load * unit);
    const TwistDiscs discs = springs.discs();
    const double rim = twist_field_mm(contact, closed, {a, 0.0}).y;
    double sum = 0.0;
    for (int i = 0; i < 63; ++i) {
      const int row = i / 9;
      const int col = i % 9;
      const Vec2 at{(col - 4) * 1.5 + 0.1, (row - 3) * 1.5 - 0.2};
      const Vec2 u = twist_field_mm(discs, at);
      const Vec2 v = twist_field_mm(contact, closed, at);
      sum += (u.x - v.x) * (u.x - v.x) + (u.y - v.y) * (u.y - v.y);
    }
    return std::sqrt(sum / 63) / rim;
  };
  for (const double load : {0.02, 0.08, 0.2, 0.5}) {
    CHECK(error(64, load) < 2.5e-4);
    CHECK(error(256, load) < 2e-5);
    CHECK(order(error(32, load), error(128, load)) / 2.0 > 1.7);
  }
}

// Masing's rule holds for the tractions, so for the field too.
TEST(TwistSprings, DiscsAreTheFieldAfterAReversal) {
  const double top = 0.3 * unit;
  const Twist full = twist_by_angle(contact, top);
  for (const double back : {1e-3, 0.02, 0.1, 0.3, 0.6}) {
    TwistSprings springs = springs_of(64);
    turn(springs, top);
    turn(springs, -back * unit);
    const TwistDiscs discs = springs.discs();
    const Twist half = twist_by_angle(contact, 0.5 * back * unit);
    const double rim = twist_field_mm(contact, full, {a, 0.0}).y;
    for (double r = 0.05 * a; r < 3.0 * a; r += 0.05 * a) {
      const double wanted = twist_field_mm(contact, full, {r, 0.0}).y - 2.0 * twist_field_mm(contact, half, {r, 0.0}).y;
      DOUBLES_EQUAL(wanted, twist_field_mm(discs, {r, 0.0}).y, 5e-3 * rim);
    }
  }
}

TEST(TwistSprings, DiscsCarryTheMoment) {
  for (const double way : {0.01, 0.2, -0.1, 0.9, -0.4}) {
    TwistSprings springs = springs_of(64, 1.37 * a);
    turn(springs, 0.3 * unit);
    const TwistSpringState& s = turn(springs, way * unit);
    const TwistDiscs discs = springs.discs();
    double moment = 0.0;
    double angle = 0.0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(discs.count); ++i) {
      moment += disc_moment_nmm(kGel, discs.discs[i]);
      angle += discs.discs[i].turn_rad;
      CHECK(discs.discs[i].radius_mm + discs.discs[i].spread_mm <= a * (1.0 + 1e-12));
    }
    DOUBLES_EQUAL(s.moment_nmm, moment, 1e-3 * limit);  // straight between the springs: N^-2
    DOUBLES_EQUAL(s.gel_rad, angle, 1e-12 * unit);
  }
}

TEST(TwistSprings, SignsMirror) {
  TwistSprings there = springs_of(64);
  TwistSprings back = springs_of(64);
  Dice dice;
  for (int i = 0; i < 200; ++i) {
    const double way = (dice.next() - 0.5) * unit;
    CHECK(std::bit_cast<std::uint64_t>(turn(there, way).moment_nmm) ==
          std::bit_cast<std::uint64_t>(-turn(back, -way).moment_nmm));
    CHECK(there.state().stick_radius_mm == back.state().stick_radius_mm);
  }
}

TEST(TwistSprings, BondedNeverSlips) {
  TwistSprings springs = springs_of(64);
  const TwistSpringState& s = springs.step(contact.press, kInfinity, kInfinity, 1e6);
  DOUBLES_EQUAL(1e6, s.gel_rad, 1e-6);
  DOUBLES_EQUAL(0.0, s.slip_fraction, 1e-12);
  const TwistDiscs discs = springs.discs();
  DOUBLES_EQUAL(1e6 * turned(2.0 * a, a), twist_field_mm(discs, {2.0 * a, 0.0}).y, 1e-6 * a);
}

TEST(TwistSprings, ExtremesAreFinite) {
  for (const double modulus : {0.0, 1e-300, 1e-6, 1e6, 1e300}) {
    for (const double extent : {0.0, 1e-300, 5.0, 1e300}) {
      for (const int n : {-1, 1, 2, 256, 1000}) {
        for (const double friction : {0.0, 1e-300, 0.5, 1e300, kInfinity}) {
          TwistSprings springs({modulus, extent, n});
          for (const Press& press : {Press{}, Press{1e-300, 1e-300, 0, 0}, Press{1.0, 1e-320, 0, 0}, Press{8, 4, 1, 1},
                                     Press{1e300, 1e300, 0, 0}, Press{8, 3.99999999, 1, 1}}) {
            for (const double way : {0.0, 1e-320, -0.1, pi, 1e300, -1e300}) {
              check_finite(springs.step(press, friction, 0.7 * friction, way));
              const Vec2 u = twist_field_mm(springs.discs(), {1.0, -2.0});
              CHECK(std::isfinite(u.x) && std::isfinite(u.y));
            }
          }
        }
      }
    }
  }
}

TEST_GROUP(FrictionShare){};

TEST(FrictionShare, OneLoadHasItAllExactly) {
  for (const double load : {1e-320, 1e-9, 0.3, 1.0, 1e300, kInfinity}) {
    CHECK(share_friction(-load, 0.0).for_shear == 1.0);
    CHECK(share_friction(0.0, load).for_twist == 1.0);
  }
  // So what does not share is what it was, to the last bit.
  const FrictionContact contact = contact_of();
  const FrictionContact shared = contact_of(kFriction * share_friction(0.0, 0.4).for_twist);
  for (const double load : {0.1, 0.5, 3.0}) {
    const double angle = load * angle_unit(contact);
    CHECK(twist_by_angle(contact, angle).moment_nmm == twist_by_angle(shared, angle).moment_nmm);
  }
}

TEST(FrictionShare, InsideEachHasWhatTheOtherLeavesAndOutsideBothLieOnTheEllipse) {
  for (double q = 0.0; q <= 1.0; q += 0.05) {
    for (double m = 0.0; q * q + m * m <= 1.0; m += 0.05) {
      const FrictionShare share = share_friction(q, -m);
      DOUBLES_EQUAL(1.0, share.for_shear * share.for_shear + m * m, 1e-15);
      DOUBLES_EQUAL(1.0, share.for_twist * share.for_twist + q * q, 1e-15);
    }
  }
  Dice dice;
  for (int i = 0; i < 1000; ++i) {
    const double shear = std::pow(10.0, 300.0 * dice.next());
    const double twist = std::pow(10.0, 600.0 * dice.next() - 300.0);
    const FrictionShare share = share_friction(shear, twist);
    DOUBLES_EQUAL(1.0, share.for_shear * share.for_shear + share.for_twist * share.for_twist, 1e-15);
  }
  const FrictionShare both = share_friction(kInfinity, kInfinity);
  DOUBLES_EQUAL(both.for_shear, both.for_twist, 0.0);
  const FrictionShare none = share_friction(0.0, std::nan(""));
  CHECK(none.for_shear == 1.0 && none.for_twist == 1.0);
  // Continuous where both meet.
  for (double angle = 0.01; angle < 1.57; angle += 0.01) {
    const FrictionShare in = share_friction(0.999999999 * std::cos(angle), 0.999999999 * std::sin(angle));
    const FrictionShare out = share_friction(1.000000001 * std::cos(angle), 1.000000001 * std::sin(angle));
    DOUBLES_EQUAL(in.for_shear, out.for_shear, 1e-6);
    DOUBLES_EQUAL(in.for_twist, out.for_twist, 1e-6);
  }
}

// Shear and twist in any fixed proportion stay inside the ellipse and end on it.
TEST(FrictionShare, ProportionalLoadsReachTheEllipse) {
  const FrictionContact contact = contact_of();
  const double a = contact.press.contact_radius_mm;
  const double shear_limit = kFriction * kPress_n;
  const double twist_limit = moment_limit_nmm(contact);
  for (const double mix : {0.0, 0.01, 0.3, 1.0, 3.0, 100.0}) {
    double used = 0.0;
    for (double way = 1e-6; way < 100.0; way *= 1.3) {
      const double angle = way * mix / a;
      const Shear alone = shear_by_displacement(contact, way);
      const Twist twist_alone = twist_by_angle(contact, angle);
      const FrictionShare share =
          share_friction(alone.sliding ? way / gross_displacement_mm(contact) : alone.force_n / shear_limit,
                         twist_alone.turning ? angle / gross_angle_rad(contact) : twist_alone.moment_nmm / twist_limit);
      const double q = shear_by_displacement(contact_of(kFriction * share.for_shear), way).force_n / shear_limit;
      const double m = twist_by_angle(contact_of(kFriction * share.for_twist), angle).moment_nmm / twist_limit;
      used = q * q + m * m;
      CHECK(used <= 1.0 + 1e-12);
    }
    DOUBLES_EQUAL(1.0, used, 1e-9);
  }
}
