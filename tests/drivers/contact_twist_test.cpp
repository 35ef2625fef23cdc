// SPDX-License-Identifier: Apache-2.0
// Oracles: Lubkin's curve and field by plain quadrature, Masing's rule, energy balance.
#include "drivers/sim/scene/contact/twist.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>

#include "tests/support/closed_forms.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using namespace holdfast::test::sphere_example;
using std::numbers::pi;

namespace {

double angle_unit(const FrictionContact& c) {
  const double a = c.press.contact_radius_mm;
  return c.friction * c.press.force_n / (c.gel.shear_modulus_mpa * a * a);
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

// Lubkin's curve of mu P = G = a = 1 from dM = (16/3) G c^3 dbeta and beta' = (3 / 4 pi) E(s) / s, down to c = a / 20,
// by the midpoint rule in t = ln(a/c): off by 1e-7.
class Lubkin {
 public:
  struct State {
    double angle = 0.0, moment = 0.0, stick = 1.0;
  };
  Lubkin() {
    for (std::size_t i = 0; i + 1 < curve_.size(); ++i) {
      const double t = static_cast<double>(i) / kPerUnit;
      const double c = std::exp(-t - 0.5 / kPerUnit);
      const double turn = 0.75 / pi * ellipse(c) / kPerUnit;
      curve_[i + 1] = {curve_[i].angle + turn, curve_[i].moment + 16.0 / 3.0 * c * c * c * turn,
                       std::exp(-t - 1.0 / kPerUnit)};
    }
  }
  // Range: an angle of the curve, 0 to 0.8.
  [[nodiscard]] State at(double angle) const {
    const auto* to = std::ranges::upper_bound(curve_, angle, {}, &State::angle);
    const State& from = *std::prev(to);
    const double share = (angle - from.angle) / (to->angle - from.angle);
    return {angle, from.moment + share * (to->moment - from.moment), from.stick + share * (to->stick - from.stick)};
  }
  // beta(c).
  [[nodiscard]] double angle_of(double stick) const {
    const double place = -std::log(stick) * kPerUnit;
    const auto i = std::min(static_cast<std::size_t>(place), curve_.size() - 2);
    return curve_[i].angle + (place - static_cast<double>(i)) * (curve_[i + 1].angle - curve_[i].angle);
  }

 private:
  static constexpr int kPerUnit = 1000;
  std::array<State, 3 * kPerUnit + 1> curve_{};
};

const Lubkin& lubkin() {
  static const Lubkin curve;
  return curve;
}

double turned(double r, double s) {
  if (r <= s) return r;
  return 2.0 / pi * (r * std::asin(s / r) - s * std::sqrt(1.0 - s * s / (r * r)));
}

// Its field with stick radius c, from the superposition; s = r (1 - v^2) below r takes out the kink.
double oracle_field(double r, double c) {
  if (r <= c) return r * lubkin().angle_of(c);
  const double larger = r < 1.0 ? r * lubkin().angle_of(r) : 0.0;
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

// Around the centre, at distance r.
double motion_of(const TwistDiscs& discs, double r) {
  double sum = 0.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(discs.count); ++i) sum += disc_motion_mm(discs.discs[i], r);
  return sum;
}

void check_finite(const TwistSpringState& s) {
  for (const double value : {s.moment_nmm, s.contact_radius_mm, s.stick_radius_mm, s.stick_fraction, s.slip_fraction,
                             s.gel_rad, s.slid_rad, s.dissipated_mj, s.stored_mj}) {
    CHECK(std::isfinite(value));
  }
  CHECK(s.dissipated_mj >= 0.0);
  CHECK(s.stick_fraction >= 0.0 && s.slip_fraction >= 0.0 && s.stick_radius_mm <= s.contact_radius_mm);
}

}  // namespace

TEST_GROUP(TwistSprings) {
  FrictionContact contact = contact_of();
  double a = contact.press.contact_radius_mm;
  double unit = angle_unit(contact);
  double limit = 3.0 * pi / 16.0 * kFriction * kPress_n * a;
  TwistSprings springs_of(int n, double extent_mm = 0.0) const {
    return TwistSprings({kGel.shear_modulus_mpa, extent_mm > 0.0 ? extent_mm : a, n});
  }
  const TwistSpringState& turn(TwistSprings & springs, double turn_rad, double kinetic = kFriction) const {
    return springs.step(contact.press, kFriction, kinetic, turn_rad);
  }
  // Moment and stick radius of a first twist.
  double moment_of(double angle) const {
    return lubkin().at(angle / unit).moment * kFriction * kPress_n * a;
  }
  double stick_of(double angle) const {
    return lubkin().at(angle / unit).stick * a;
  }
};

TEST(TwistSprings, FirstTwistIsLubkins) {
  for (const double load : {0.02, 0.08, 0.2, 0.5}) {
    std::array<double, 3> error{};
    std::array<double, 3> stick{};
    for (std::size_t i = 0; i < 3; ++i) {
      TwistSprings springs = springs_of(32 << i);
      const TwistSpringState& s = turn(springs, load * unit);
      error[i] = std::abs(s.moment_nmm - moment_of(load * unit)) / limit;
      stick[i] = std::abs(s.stick_radius_mm - stick_of(load * unit)) / a;
      const double n = 32 << i;
      CHECK(error[i] <= 1.25 / (n * n));
      CHECK(stick[i] <= 0.9 / (n * n));
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
    DOUBLES_EQUAL(moment_of(top) - 2.0 * moment_of(0.5 * i * back), moment, error);
    // The stick disc of the way back is that of half the way.
    const double c = stick_of(0.5 * i * back);
    DOUBLES_EQUAL(c, springs.state().stick_radius_mm, 2e-3 * a);
  }
  // The loop closes: at -top, and again at top.
  DOUBLES_EQUAL(-moment_of(top), springs.state().moment_nmm, error);
  for (int i = 0; i < 12; ++i) turn(springs, back);
  DOUBLES_EQUAL(moment_of(top), springs.state().moment_nmm, error);
  // An inner loop is forgotten when it closes.
  turn(springs, -0.1 * unit);
  turn(springs, 0.1 * unit);
  turn(springs, 0.1 * unit);
  DOUBLES_EQUAL(moment_of(top + 0.1 * unit), springs.state().moment_nmm, error);
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
    CHECK(s.moment_nmm >= 0.0 &&
          s.moment_nmm <= limit * (now.press.force_n * now.press.contact_radius_mm) / (kPress_n * a) * (1.0 + 1e-9));
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

// 63 places around the contact, r / a.
std::array<double, 63> places(double a) {
  std::array<double, 63> r;
  for (int i = 0; i < 63; ++i) {
    const int row = i / 9, column = i % 9;
    r[static_cast<std::size_t>(i)] = std::hypot((column - 4) * 1.5 + 0.1, (row - 3) * 1.5 - 0.2) / a;
  }
  return r;
}

TEST(TwistSprings, DiscsAreTheFieldOfTheSuperposition) {
  for (const double load : {0.02, 0.08, 0.2, 0.5}) {
    const double c = lubkin().at(load).stick;
    const double rim = oracle_field(1.0, c);
    std::array<double, 63> expected;
    std::ranges::transform(places(a), expected.begin(), [&](double r) { return oracle_field(r, c); });
    const auto error = [&](int n) {
      TwistSprings springs = springs_of(n);
      turn(springs, load * unit);
      double sum = 0.0;
      for (std::size_t i = 0; i < expected.size(); ++i) {
        const double off = motion_of(springs.discs(), places(a)[i] * a) / (a * unit) - expected[i];
        sum += off * off;
      }
      return std::sqrt(sum / 63) / rim;
    };
    CHECK(error(64) < 2.5e-4);
    CHECK(error(256) < 2e-5);
    CHECK(order(error(32), error(128)) / 2.0 > 1.7);
  }
}

TEST(TwistSprings, BondedNeverSlips) {
  TwistSprings springs = springs_of(64);
  const TwistSpringState& s = springs.step(contact.press, kInfinity, kInfinity, 1e6);
  DOUBLES_EQUAL(1e6, s.gel_rad, 1e-6);
  DOUBLES_EQUAL(0.0, s.slip_fraction, 1e-12);
  const TwistDiscs discs = springs.discs();
  DOUBLES_EQUAL(1e6 * turned(2.0 * a, a), motion_of(discs, 2.0 * a), 1e-6 * a);
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
              CHECK(std::isfinite(motion_of(springs.discs(), 2.0)));
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
