// SPDX-License-Identifier: Apache-2.0
// The simulator and the features at the ends of their ranges: one test per row of the numerical-limits table that the
// project set itself, each with its expected answer. What only one module can do wrong is tested beside that module.
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <vector>

#include "drivers/sim/scene/contact/layer.hpp"
#include "drivers/sim/scene/contact/springs.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "tactile/features.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using namespace holdfast::scene;
using std::numbers::pi;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::array kLevels{ContactLevel::kSprings, ContactLevel::kGrid};

std::vector<Vec2> markers() {
  std::vector<Vec2> places;
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 9; ++col) places.push_back({2.02 * (col - 4), 2.02 * (row - 3)});
  }
  return places;
}

Scene scene_of(ContactLevel level) {
  Scene scene;
  scene.level.contact = level;
  scene.level.cell_mm = 1.4;
  scene.trajectory = {{.t_s = 0.0, .force_n = 3.0}};
  return scene;
}

bool finite(const ContactState& s) {
  for (const double value : {s.depth_mm, s.normal_n, s.contact_radius_mm, s.stick_radius_mm, s.slip_fraction,
                             s.shear_n.x, s.shear_n.y, s.moment_nmm, s.slid_mm.x, s.slid_mm.y, s.slid_rad}) {
    if (!std::isfinite(value)) return false;
  }
  return s.slip_fraction >= 0.0 && s.slip_fraction <= 1.0;
}

// Largest motion; NaN if any is.
double largest(Contact& contact) {
  std::vector<Vec2> u(markers().size());
  contact.field(u);
  double most = 0.0;
  for (const Vec2& v : u) {
    const double length = std::sqrt(v.x * v.x + v.y * v.y);
    if (std::isnan(length)) return length;
    most = std::max(most, length);
  }
  return most;
}

}  // namespace

TEST_GROUP(Limits){};

// Q = mu P and beyond: sliding; no root of a negative number.
TEST(Limits, AllOfTheFriction) {
  for (const ContactLevel level : kLevels) {
    const auto c = make_contact(scene_of(level), markers());
    (void)c->press_to(3.0, {}, 0.0);
    const ContactState& s = c->press_to(3.0, {6.0, -4.0}, 0.0);
    CHECK(finite(s));
    CHECK(s.gross);
    CHECK(std::isfinite(largest(*c)));
  }
}

// mu = 0, P = 0, a = 0: nothing moves sideways, nothing is NaN.
TEST(Limits, NothingToHold) {
  for (const ContactLevel level : kLevels) {
    Scene slippery = scene_of(level);
    slippery.object.friction = 0.0;
    const auto c = make_contact(slippery, markers());
    (void)c->press_to(3.0, {}, 0.0);
    const double pressed = largest(*c);
    CHECK(finite(c->press_to(3.0, {1.0, 0.0}, 0.5)));
    CHECK(largest(*c) < pressed + 0.1);
    for (const double none : {0.0, -1.0, 5e-324}) {
      const auto air = make_contact(scene_of(level), markers());
      CHECK(finite(air->press_to(none, {1.0, 2.0}, 1.0)));
      CHECK(largest(*air) < 1e-6);
      CHECK(finite(air->move_to({none, {1.0, 2.0}, 1.0})));
      CHECK(largest(*air) < 1e-6);
    }
  }
}

// G from 1e-6 to 1e6 MPa: motion under a force goes as 1/G exactly; what no longer fits an integer is clamped and
// counted.
TEST(Limits, StiffAndSoftGels) {
  std::array<double, kLevels.size()> before{};
  const double at_one = gross_displacement_mm({{.shear_modulus_mpa = 1.0}, {3.0, 4.0, 1.0, 0.1}, 0.5});
  for (double g = 1e-6; g < 2e6; g *= 10.0) {
    const FrictionContact contact{{.shear_modulus_mpa = g}, {3.0, 4.0, 1.0, 0.1}, 0.5};
    DOUBLES_EQUAL(1.0, gross_displacement_mm(contact) * g / at_one, 1e-15);
    for (const ContactLevel level : kLevels) {
      Scene scene = scene_of(level);
      scene.gel.shear_modulus_mpa = g;
      scene.trajectory = {{.t_s = 0.0, .depth_mm = 1.0}};
      const auto c = make_contact(scene, markers());
      (void)c->move_to({1.0, {}, 0.0});
      CHECK(finite(c->move_to({1.0, {0.3, 0.1}, 0.05})));
      // Depth and place are given: the motion is the same for every modulus, to the grid's tolerance.
      double& motion = before[static_cast<std::size_t>(level)];
      if (motion > 0.0) DOUBLES_EQUAL(motion, largest(*c), 1e-4);
      motion = largest(*c);
      CHECK(motion > 0.3 && motion < 1.0);
    }
  }
  Saturations saturations;
  CHECK(Micrometres::saturate(std::int64_t{1} << 40, saturations).raw() > 0);
  LONGS_EQUAL(1, saturations.count);
}

// nu = 1/2: a half-space pressed moves nothing sideways; a layer presses the gel out from under the object.
TEST(Limits, IncompressibleGel) {
  const Layer half_space({.shear_modulus_mpa = 0.1, .poisson = 0.5});
  for (const double r : {0.5, 3.0, 5.0, 20.0}) DOUBLES_EQUAL(0.0, half_space.press_outward(4.0, r), 0.0);
  const Layer layer({.shear_modulus_mpa = 0.1, .poisson = 0.5, .thickness_mm = 4.25});
  CHECK(layer.press_outward(4.0, 4.0) > 0.0);
}

// theta = 0, +-pi, huge: no turn moves nothing (cos(theta) - 1 and not cos(theta - 1)), any other is finite.
TEST(Limits, AnyTurn) {
  for (const ContactLevel level : kLevels) {
    const auto c = make_contact(scene_of(level), markers());
    (void)c->press_to(3.0, {}, 0.3);
    const double pressed = largest(*c);
    (void)c->press_to(3.0, {}, 0.3);
    DOUBLES_EQUAL(pressed, largest(*c), 1e-9);
    for (const double turn : {1e-300, 1e-9, pi, -pi, 1e6}) {
      CHECK(finite(c->press_to(3.0, {}, 0.3 + turn)));
      CHECK(largest(*c) < 10.0);
    }
  }
}

// K = kh -> 0: h/G, simple shear; K > 350, where cosh overflows: the half-space.
TEST(Limits, LongAndShortWaves) {
  const Gel gel{.shear_modulus_mpa = 0.05, .poisson = 0.5, .thickness_mm = 4.25};
  for (const double k : {0.0, 5e-324, 1e-200, 1e-9}) {
    DOUBLES_EQUAL(4.25 / 0.05, layer_compliance(gel, k).along, 1e-9);
    DOUBLES_EQUAL(4.25 / 0.05, layer_compliance(gel, k).across, 1e-9);
  }
  for (const double k : {100.0, 1e4, 1e100}) {
    DOUBLES_EQUAL(1.0, layer_compliance(gel, k).along * 2.0 * 0.05 * k, 1e-12);
    DOUBLES_EQUAL(1.0, layer_compliance(gel, k).across * 0.05 * k, 1e-12);
  }
}

// Steps tiny and huge, reversal, changing force: a straight way at constant force does not depend on the step, and
// friction never gives energy.
TEST(Limits, StepsOfAnySize) {
  const SpringSetup setup{.gel = {.shear_modulus_mpa = 0.1}, .indenter = sphere_indenter(15.0), .extent_mm = 5.0};
  SpringContact once(setup);
  SpringContact often(setup);
  const double depth = once.depth_for_force_mm(3.0);
  (void)once.move_to(depth, {});
  (void)often.move_to(depth, {});
  const double force = once.move_to(depth, {0.7, 0.0}).force_n.x;
  for (int k = 1; k <= 100'000; ++k) (void)often.move_to(depth, {0.7 * k / 100'000, 0.0});
  DOUBLES_EQUAL(force, often.state().force_n.x, 1e-9);
  double lost = once.state().dissipated_mj;
  for (const double to : {-1e30, 1e30, 0.1, 5e-324, -0.3, 1e3}) {
    (void)once.move_to(depth * (to < 0.0 ? 0.5 : 1.0), {to, 0.0});
    CHECK(once.state().dissipated_mj >= lost);
    lost = once.state().dissipated_mj;
    CHECK(std::isfinite(once.state().force_n.x));
  }
}

// All markers lost, one left, none in the frame: E = 0, V = 0, nothing divided by 0.
TEST(Limits, FewMarkers) {
  for (const int left : {0, 1}) {
    features::State state;
    Saturations saturations;
    DisplacementField field;
    field.grid = {7, 9};
    for (int k = 0; k < 3; ++k) {
      for (int i = 0; i < left; ++i)
        field.markers[static_cast<std::size_t>(i)] = {Micrometres::from_raw(300 * k), {}, true};
      const Features f = features::update(state, {}, field, Micros(40'000 * k), saturations);
      LONGS_EQUAL(left, f.markers);
      LONGS_EQUAL(0, f.entropy.raw());
      LONGS_EQUAL(0, f.entropy_rate.raw());
      LONGS_EQUAL(left == 1 && k > 0 ? 7500 : 0, f.vx.raw());
    }
  }
}

// On a bin's edge a displacement counts to the upper bin; beyond the range, to the largest integer, to the last.
TEST(Limits, EdgesOfTheHistogram) {
  DisplacementField field;
  field.grid = {1, 1};
  const auto bin_of = [&](std::int32_t dx, std::int32_t dy) {
    field.markers[0] = {Micrometres::from_raw(dx), Micrometres::from_raw(dy), true};
    const auto histogram = features::histogram_of(field, 1500);
    for (int bin = 0; bin < kHistogramBins; ++bin) {
      if (histogram[static_cast<std::size_t>(bin)] != 0) return bin;
    }
    return -1;
  };
  for (int bin = 1; bin < kHistogramBins; ++bin) {
    LONGS_EQUAL(bin - 1, bin_of(100 * bin - 1, 0));
    LONGS_EQUAL(bin, bin_of(100 * bin, 0));
    LONGS_EQUAL(bin, bin_of(0, -100 * bin));
  }
  LONGS_EQUAL(14, bin_of(1500, 0));
  LONGS_EQUAL(14, bin_of(-65'535, 65'535));
}
