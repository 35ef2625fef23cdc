// SPDX-License-Identifier: Apache-2.0
// Oracles: the closed forms of support/closed_forms.hpp (tested on their own),
// Ciavarella's and Jaeger's rule for any round body, energy balance, symmetry, and point springs by the thousand.
#include "drivers/sim/scene/contact/springs.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <vector>

#include "tests/support/closed_forms.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using namespace holdfast::test::sphere_example;
using namespace holdfast::test;
using std::numbers::pi;

namespace {

constexpr double kLimit_n = kFriction * kPress_n;

// The springs stand on the contact of `extent_n`.
SpringSetup setup_of(int springs, double friction = kFriction, double extent_n = kPress_n) {
  return {kGel,
          sphere_indenter(kSphere_mm),
          press_sphere(kGel, kSphere_mm, extent_n).contact_radius_mm,
          friction,
          friction,
          springs};
}

double depth_of(double press_n) {
  return press_sphere(kGel, kSphere_mm, press_n).depth_mm;
}

// By a field that remembers nothing yet.
Vec2 field_at(const Traction& traction, Vec2 at_mm) {
  Vec2 motion_mm;
  SpringField(Layer(kGel), {&at_mm, 1}).evaluate(traction, {&motion_mm, 1});
  return motion_mm;
}

double norm(Vec2 v) {
  return std::hypot(v.x, v.y);
}

double order(double coarse, double fine) {
  return std::log2(coarse / fine);
}

// 9 x 7 around the contact.
Vec2 marker(int index) {
  const int row = index / 9;
  const int column = index % 9;
  return {(column - 4) * 1.976, (row - 3) * 1.907};
}

void check_finite(const SpringState& s) {
  for (const double value : {s.depth_mm, s.normal_force_n, s.contact_radius_mm, s.force_n.x, s.force_n.y,
                             s.displacement_mm.x, s.displacement_mm.y, s.gel_mm.x, s.gel_mm.y, s.slid_mm.x, s.slid_mm.y,
                             s.stick_radius_mm, s.stick_fraction, s.slip_fraction, s.stored_mj}) {
    CHECK(std::isfinite(value));
  }
  CHECK(s.dissipated_mj >= 0.0);
  CHECK(s.stick_fraction >= 0.0 && s.slip_fraction >= 0.0 && s.stick_radius_mm <= s.contact_radius_mm);
}

constexpr std::array<Vec2, 8> kPoints{{{0, 0}, {1, 0.5}, {2, -1.5}, {3.6, 0.2}, {0.4, 4.3}, {5, 2}, {-7, 1}, {1, 11}}};

}  // namespace

TEST_GROUP(ContactSprings){};

TEST(ContactSprings, HertzHoldsForAnyNumberOfSprings) {
  for (const int springs : {1, 2, 7, 64, kMostSprings}) {
    SpringContact contact(setup_of(springs, kFriction, 20.0));
    for (const double press_n : {1e-9, 0.3, 8.0, 20.0}) {
      const Press press = press_sphere(kGel, kSphere_mm, press_n);
      DOUBLES_EQUAL(press.depth_mm, contact.depth_for_force_mm(press_n), 1e-14 * press.depth_mm);
      const SpringState& state = contact.move_to(press.depth_mm, {});
      DOUBLES_EQUAL(press_n, state.normal_force_n, 1e-13 * press_n);
      DOUBLES_EQUAL(press.contact_radius_mm, state.contact_radius_mm, 1e-14 * press.contact_radius_mm);
      DOUBLES_EQUAL(1.0, state.stick_fraction, 1e-13);
      CHECK_FALSE(state.sliding);
    }
    // Deeper than the springs stand: the depth stops.
    DOUBLES_EQUAL(20.0, contact.move_to(1e3, {}).normal_force_n, 1e-12);
    DOUBLES_EQUAL(depth_of(20.0), contact.depth_for_force_mm(1e3), 1e-13);
  }
}

TEST(ContactSprings, MonotoneShearMeetsTheClosedFormAtSecondOrder) {
  const FrictionContact exact = contact_of();
  const double gross = gross_displacement_mm(exact);
  double force_before = 0.0;
  double gross_before = 0.0;
  for (const int springs : {8, 16, 32, 64, 128}) {
    double force_error = 0.0;
    for (int i = 0; i <= 1200; ++i) {
      const double way = gross * i / 1000.0;
      SpringContact contact(setup_of(springs));
      const SpringState& state = contact.move_to(depth_of(kPress_n), {way, 0.0});
      const Shear shear = shear_by_displacement(exact, way);
      force_error = std::max(force_error, std::abs(state.force_n.x - shear.force_n) / kLimit_n);
      DOUBLES_EQUAL(0.0, state.force_n.y, 0.0);
      // Where the outermost stuck spring is right the rest of the stick disc is: no error of its own.
      if (i < 900) DOUBLES_EQUAL(shear.stick_radius_mm, state.stick_radius_mm, 1e-7);
    }
    // The innermost spring holds the mean of its cell: (1 - 1 / 3N^2) of the peak pressure.
    SpringContact contact(setup_of(springs));
    const double lets_go = gross * (1.0 - 1.0 / (3.0 * springs * springs));
    CHECK_FALSE(contact.move_to(depth_of(kPress_n), {lets_go * (1.0 - 1e-9), 0.0}).sliding);
    CHECK_TRUE(contact.move_to(depth_of(kPress_n), {lets_go * (1.0 + 1e-9), 0.0}).sliding);
    DOUBLES_EQUAL(kLimit_n, contact.state().force_n.x, 1e-13 * kLimit_n);
    if (force_before > 0.0) DOUBLES_EQUAL(2.0, order(force_before, force_error), 0.2);
    CHECK(force_error < 0.4 / (springs * springs));  // 3/8: a chord over a spring of the parabola mu q
    force_before = force_error;
    gross_before = lets_go;
  }
  CHECK(gross_before < gross);
}

TEST(ContactSprings, AnyRoundBodyFollowsItsOwnIndentationCurve) {
  // Ciavarella 1998, Jaeger 1998: Q = mu (P(d) - P(d_c)), delta = mu (E* / G*) (d - d_c), with d_c what the stick
  // disc would sink alone. P(d) from the textbooks: cone (2/pi) E* d^2 / A, sphere (4/3) E* sqrt(R) d^1.5,
  // r^4: d = (8/3) A a^4 and P = (8/5) E* a d.
  const double modulus = effective_modulus_mpa(kGel);
  const double ratio = modulus * (2.0 - kGel.poisson) / (4.0 * kGel.shear_modulus_mpa);
  struct Case {
    Indenter body;
    double (*press)(double depth);
  };
  const std::array<Case, 3> cases{
      {{{0.3, 1}, [](double d) { return 2.0 / pi * d * d / 0.3; }},
       {{0.05, 2}, [](double d) { return 4.0 / 3.0 * std::sqrt(10.0) * std::pow(d, 1.5); }},
       {{0.002, 4}, [](double d) { return 1.6 * d * std::pow(d * 3.0 / (8.0 * 0.002), 0.25); }}}};
  for (const Case& c : cases) {
    SpringContact contact({kGel, c.body, 6.0, 0.5, 0.5, kMostSprings});
    for (const double depth : {0.3, 0.9}) {
      const double press = modulus * c.press(depth);
      DOUBLES_EQUAL(depth, contact.depth_for_force_mm(press), 1e-12);
      DOUBLES_EQUAL(press, contact.move_to(depth, {}).normal_force_n, 1e-12 * press);
      for (const double share : {0.2, 0.5, 0.9}) {
        SpringContact fresh({kGel, c.body, 6.0, 0.5, 0.5, kMostSprings});
        const SpringState& state = fresh.move_to(depth, {0.5 * ratio * share * depth, 0.0});
        const double expected = 0.5 * (press - modulus * c.press(depth * (1.0 - share)));
        DOUBLES_EQUAL(expected, state.force_n.x, 3e-4 * press);  // 0.4 N^-2 with the 27 or more in contact
      }
    }
  }
}

TEST(ContactSprings, AnyPathAgreesWithThousandsOfPointSprings) {
  constexpr int kMany = 3000;
  const SpringSetup setup = setup_of(64);
  const double dx = setup.extent_mm / kMany;
  const double modulus = effective_modulus_mpa(kGel);
  const double along = 4.0 * kGel.shear_modulus_mpa / (2.0 - kGel.poisson);
  std::vector<Vec2> stretch(kMany);
  SpringContact contact(setup);
  const double gross = gross_displacement_mm(contact_of());
  Dice dice;
  Vec2 at;
  double depth = 0.0;
  double worst = 0.0;
  for (int leg = 0; leg < 12; ++leg) {
    const Vec2 to{gross * (2.0 * dice.next() - 1.0), gross * (2.0 * dice.next() - 1.0)};
    const double deeper = depth_of(kPress_n) * (0.2 + 0.8 * dice.next());
    const Vec2 from = at;
    const double shallow = depth;
    for (int i = 1; i <= 10; ++i) {
      const Vec2 next{from.x + (to.x - from.x) * i / 10.0, from.y + (to.y - from.y) * i / 10.0};
      depth = shallow + (deeper - shallow) * i / 10.0;
      Vec2 sum;
      for (int k = 0; k < kMany; ++k) {
        const double x = (k + 0.5) * dx;
        const double load = std::max(0.0, modulus * (depth - x * x / kSphere_mm));
        Vec2& u = stretch[static_cast<std::size_t>(k)];
        for (const Vec2 move : {Vec2{}, Vec2{next.x - at.x, next.y - at.y}}) {
          u = {u.x + move.x, u.y + move.y};
          const double force = along * norm(u);
          if (force > kFriction * load) u = {u.x * kFriction * load / force, u.y * kFriction * load / force};
        }
        sum = {sum.x + 2.0 * dx * along * u.x, sum.y + 2.0 * dx * along * u.y};
      }
      at = next;
      const SpringState& state = contact.move_to(depth, at);
      worst = std::max(worst, norm({state.force_n.x - sum.x, state.force_n.y - sum.y}) / kLimit_n);
      check_finite(state);
    }
  }
  CHECK(worst < 1e-3);  // of mu P: some times N^-2 = 2.4e-4
}

TEST(ContactSprings, WithoutFrictionNothingWithEndlessFrictionNoSlip) {
  SpringContact smooth(setup_of(64, 0.0));
  for (const double way : {0.0, 0.1, -4.0}) {
    CHECK(smooth.move_to(depth_of(kPress_n), {way, way}).force_n == Vec2{});
    DOUBLES_EQUAL(0.0, smooth.state().dissipated_mj, 0.0);
  }
  CHECK_TRUE(smooth.state().sliding);

  const FrictionContact exact = contact_of(kInfinity);
  SpringContact bonded(setup_of(64, kInfinity));
  for (const double way : {0.1, 2.0, -7.0}) {
    const SpringState& state = bonded.move_to(depth_of(kPress_n), {0.0, way});
    const double force = shear_by_displacement(exact, way).force_n;
    DOUBLES_EQUAL(force, state.force_n.y, 1e-13 * std::abs(force));
    DOUBLES_EQUAL(1.0, state.stick_fraction, 1e-14);
    DOUBLES_EQUAL(0.0, state.dissipated_mj, 0.0);
    for (const Vec2 at : kPoints) {
      const Vec2 u = field_at(bonded.traction(), at);
      const Vec2 v = stuck_field_mm(kGel, bonded.state().contact_radius_mm, force, {at.y, -at.x});
      DOUBLES_EQUAL(v.x, u.y, 1e-10 * std::abs(way));
      DOUBLES_EQUAL(-v.y, u.x, 1e-10 * std::abs(way));
    }
  }
  // What is peeled off forgets: the rest is the punch of its own radius.
  SpringContact peeled(setup_of(64, kInfinity));
  peeled.move_to(depth_of(kPress_n), {0.0, 2.0});
  const double left = shear_by_displacement(contact_of(kInfinity, 3.0), 2.0).force_n;
  DOUBLES_EQUAL(left, peeled.move_to(depth_of(3.0), {0.0, 2.0}).force_n.y, 1e-12 * left);
  // Peeled off whole, nothing comes back.
  bonded.move_to(0.0, {0.0, 1.0});
  CHECK(bonded.move_to(depth_of(kPress_n), {0.0, 1.0}).force_n == Vec2{});
}

TEST(ContactSprings, KineticFrictionDropsTheForceUntilItSticksAgain) {
  SpringSetup setup = setup_of(64);
  setup.kinetic_friction = 0.4;
  SpringContact contact(setup);
  const double depth = depth_of(kPress_n);
  const double gross = gross_displacement_mm(contact_of());
  double peak = 0.0;
  for (int i = 0; i <= 300; ++i) peak = std::max(peak, contact.move_to(depth, {gross * i / 200.0, 0.0}).force_n.x);
  CHECK_TRUE(contact.state().sliding);
  DOUBLES_EQUAL(0.4 * kPress_n, contact.state().force_n.x, 1e-12);
  CHECK(peak > 0.4 * kPress_n && peak < kLimit_n);
  // Backed off by a hair it sticks, and takes more than mu_k before the outer springs let go again.
  contact.move_to(depth, {1.49 * gross, 0.0});
  DOUBLES_EQUAL(1.0, contact.state().stick_fraction, 1e-12);
  contact.move_to(depth, {1.51 * gross, 0.0});
  CHECK(contact.state().force_n.x > 0.401 * kPress_n);
  // Energy: the work is stored or lost, whatever the drop.
  SpringContact slow(setup);
  double work = 0.0;
  double force = slow.move_to(depth, {}).force_n.x;
  for (int i = 1; i <= 20000; ++i) {
    const double next = slow.move_to(depth, {1.5 * gross * i / 20000.0, 0.0}).force_n.x;
    work += 0.5 * (force + next) * 1.5 * gross / 20000.0;
    force = next;
  }
  DOUBLES_EQUAL(work, slow.state().dissipated_mj + slow.state().stored_mj, 1e-4 * work);
}

TEST(ContactSprings, FieldMeetsTheClosedFormAtSecondOrder) {
  const FrictionContact exact = contact_of();
  const double gross = gross_displacement_mm(exact);
  double before = 0.0;
  for (const int springs : {16, 64, 256}) {
    double worst = 0.0;
    double squares = 0.0;
    int count = 0;
    for (int i = 1; i <= 60; ++i) {
      const double way = gross * i / 50.0;
      SpringContact contact(setup_of(springs));
      contact.move_to(depth_of(kPress_n), {way, 0.0});
      const Traction traction = contact.traction();
      const Shear shear = shear_by_displacement(exact, way);
      for (int p = 0; p < 63; ++p) {
        const Vec2 at = marker(p);
        const Vec2 u = field_at(traction, at);
        const Vec2 v = shear_field_mm(exact, shear, at);
        const double error = norm({u.x - v.x, u.y - v.y}) / gross;
        worst = std::max(worst, error);
        squares += error * error;
        ++count;
      }
    }
    const double rms = std::sqrt(squares / count);
    // Beside the rim of the stick disc a kink rounded over one spring counts with the root of its width.
    CHECK(worst < 0.3 * std::pow(springs, -1.5));
    CHECK(rms < 0.2 / (springs * springs));
    if (before > 0.0) DOUBLES_EQUAL(2.0, 0.5 * order(before, rms), 0.2);
    before = rms;
  }
}

TEST(ContactSprings, NoNumberBreaksIt) {
  constexpr std::array<double, 9> kValues{0.0, 5e-324, 1e-300, 1e-9, 1.0, 1e9, 1e40, 1e300, 1.7e308};
  for (const double modulus : kValues) {
    for (const double radius : kValues) {
      for (const double friction : {0.0, 5e-324, 0.5, 1e300, kInfinity}) {
        for (const int springs : {1, 5}) {
          SpringSetup setup{{modulus, 0.5}, sphere_indenter(radius), radius, friction, 0.7 * friction, springs};
          SpringContact contact(setup);
          double lost = 0.0;
          for (const double value : kValues) {
            for (const double sign : {1.0, -1.0}) {
              check_finite(contact.move_to(contact.depth_for_force_mm(value), {sign * value, 0.5 * value}));
              check_finite(contact.move_to(sign * value, {-value, value}));
              CHECK(contact.state().dissipated_mj >= lost);
              lost = contact.state().dissipated_mj;
              const Vec2 u = field_at(contact.traction(), {1.0, 2.0});
              CHECK_FALSE(std::isnan(u.x) || std::isnan(u.y));
            }
          }
        }
      }
    }
  }
  // No body, no springs' room, no gel: no contact.
  for (const SpringSetup& setup :
       {SpringSetup{kGel, sphere_indenter(0.0), 5.0, 0.5, 0.5, 8}, SpringSetup{kGel, {1.0, 2}, 0.0, 0.5, 0.5, 8},
        SpringSetup{{0.0, 0.49}, {1.0, 2}, 5.0, 0.5, 0.5, 8}}) {
    SpringContact contact(setup);
    CHECK(contact.move_to(1.0, {1.0, 0.0}).force_n == Vec2{});
    DOUBLES_EQUAL(0.0, contact.state().normal_force_n, 0.0);
    DOUBLES_EQUAL(0.0, contact.depth_for_force_mm(1.0), 0.0);
    LONGS_EQUAL(0, contact.traction().count);
  }
}

TEST(ContactSprings, TheSameBitsOnEveryMachine) {
  SpringSetup setup = setup_of(64);
  setup.extent_mm = 5.0;
  setup.kinetic_friction = 0.5;
  SpringContact contact(setup);
  Dice dice;
  std::uint64_t hash = 14695981039346656037ULL;
  for (int i = 0; i < 2000; ++i) {
    const double depth = 2.0 * dice.next();
    const Vec2 value{3.0 * dice.next() - 1.5, 3.0 * dice.next() - 1.5};
    const SpringState& s = contact.move_to(depth, value);
    for (const double v : {s.force_n.x, s.force_n.y, s.displacement_mm.x, s.slid_mm.y, s.stick_radius_mm,
                           s.normal_force_n, s.dissipated_mj, s.stored_mj}) {
      hash = (hash ^ std::bit_cast<std::uint64_t>(v)) * 1099511628211ULL;
    }
  }
  UNSIGNED_LONGLONGS_EQUAL(0x7bf98e23253b34d1ULL, hash);  // x86-64 and aarch64, gcc 12
}
