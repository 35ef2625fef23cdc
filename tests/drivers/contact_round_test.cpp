// SPDX-License-Identifier: Apache-2.0
// Springs on a gel of finite thickness against level `grid`.
#include "drivers/sim/scene/contact/round.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/sim/scene/contact/grid.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast::scene;

constexpr Gel kGel{.shear_modulus_mpa = 0.035, .poisson = 0.49, .thickness_mm = 4.25};

std::vector<Vec2> markers() {
  std::vector<Vec2> places;
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 9; ++col) places.push_back({2.02 * (col - 4) - 0.4, 2.02 * (row - 3) + 0.3});
  }
  return places;
}

RoundSetup round_of(const Gel& gel, double radius_mm = 15.0, double friction = 0.5) {
  RoundSetup setup;
  setup.gel = gel;
  setup.round = {0.5 / radius_mm, 2};
  setup.static_friction = setup.kinetic_friction = friction;
  setup.extent_mm = 7.0;
  return setup;
}

GridSetup grid_of(const Gel& gel, double radius_mm = 15.0, double friction = 0.5, double cell_mm = 0.7) {
  GridSetup setup;
  setup.gel = gel;
  setup.shape.radius_mm = radius_mm;
  setup.static_friction = setup.kinetic_friction = friction;
  setup.cell_mm = cell_mm;
  return setup;
}

std::vector<Vec2> field(Contact& contact) {
  std::vector<Vec2> u(markers().size());
  contact.field(u);
  return u;
}

double rms(const std::vector<Vec2>& u) {
  double sum = 0.0;
  for (const Vec2& v : u) sum += v.x * v.x + v.y * v.y;
  return std::sqrt(sum / static_cast<double>(u.size()));
}

std::vector<Vec2> difference(const std::vector<Vec2>& a, const std::vector<Vec2>& b) {
  std::vector<Vec2> out(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) out[i] = {a[i].x - b[i].x, a[i].y - b[i].y};
  return out;
}

}  // namespace

TEST_GROUP(ContactRound){};

// The share that friction holds back was read off one grid contact (R 15, 3 N, 35 kPa); others have to agree.
TEST(ContactRound, PressSpreadsTheMarkersAsTheGridDoes) {
  struct Case {
    double g_mpa, radius_mm, friction, press_n, error;  // error as a share of the motion
  };
  const auto cases = std::to_array<Case>({{0.035, 15, 0.5, 3, 0.03},
                                          {0.035, 15, 0.0, 3, 0.03},
                                          {0.035, 8, 0.5, 1.5, 0.03},
                                          {0.035, 30, 1.0, 3, 0.04},
                                          {0.1, 8, 0.5, 6, 0.03},
                                          {0.1, 30, 0.5, 1.5, 0.03},
                                          {0.035, 15, 0.2, 3, 0.08},
                                          {0.1, 15, 0.2, 6, 0.08}});
  for (const Case& c : cases) {
    Gel gel = kGel;
    gel.shear_modulus_mpa = c.g_mpa;
    GridContact grid(grid_of(gel, c.radius_mm, c.friction), markers());
    for (int k = 1; k <= 20; ++k) (void)grid.press_to(c.press_n * k / 20, {}, 0.0);
    SpringsContact springs(round_of(gel, c.radius_mm, c.friction), markers());
    (void)springs.press_to(c.press_n, {}, 0.0);
    const double error = rms(difference(field(springs), field(grid))) / rms(field(grid));
    CHECK_TEXT(error < c.error, std::to_string(error).c_str());
  }
}

// A drag into gross slip: forces to 4 % of mu P, markers to 5 % of the object's way and the 3 % of the press.
TEST(ContactRound, DragOnALayerIsNearTheGrids) {
  GridContact grid(grid_of(kGel), markers());
  SpringsContact springs(round_of(kGel), markers());
  constexpr double kPress_n = 2.0;
  for (Contact* c : {static_cast<Contact*>(&grid), static_cast<Contact*>(&springs)}) {
    for (int k = 1; k <= 10; ++k) (void)c->press_to(kPress_n * k / 10, {}, 0.0);
  }
  for (int k = 1; k <= 25; ++k) {
    const Vec2 at{0.06 * k, 0.02 * k};
    const ContactState& g = grid.press_to(kPress_n, at, 0.0);
    const ContactState& s = springs.press_to(kPress_n, at, 0.0);
    DOUBLES_EQUAL(g.shear_n.x, s.shear_n.x, 0.04 * 0.5 * kPress_n);
    DOUBLES_EQUAL(g.slip_fraction, s.slip_fraction, 0.15);
    CHECK(rms(difference(field(springs), field(grid))) < 0.05 * length(at) + 0.004);
  }
}

// The middle of the contact moves with the object as long as it sticks, whatever the layer.
TEST(ContactRound, TheMiddleSticksToTheObject) {
  const std::vector<Vec2> middle{{0.0, 0.0}};
  for (const double thickness_mm : {1.0, 4.25, 100.0}) {
    Gel gel = kGel;
    gel.thickness_mm = thickness_mm;
    SpringsContact springs(round_of(gel), middle);
    (void)springs.press_to(2.0, {}, 0.0);
    for (double x = 0.01; x < 3.0; x += 0.01) {
      if (springs.press_to(2.0, {x, 0.0}, 0.0).gross) break;
      std::vector<Vec2> u(1);
      springs.field(u);
      DOUBLES_EQUAL(x, u[0].x, 1e-2 * x);  // the springs' steps and cells
    }
  }
}

// A slide whose limit falls: eased to a hundredth, or by kinetic friction below the static one. What the object has
// slid is its way less what the gel holds back; without friction all of it. To 2 % of the way by the grid.
TEST(ContactRound, WhatAFallingLimitLetsGoOfIsSlidByTheLayersMeasure) {
  constexpr double kWay_mm = 3.0;
  for (const double kinetic : {0.0, 0.25, 0.5}) {
    RoundSetup round = round_of(kGel, 12.0, 0.5);
    GridSetup cells = grid_of(kGel, 12.0, 0.5);
    round.kinetic_friction = cells.kinetic_friction = kinetic;
    GridContact grid(cells, markers());
    SpringsContact springs(round, markers());
    const auto both_slid_mm = [&](double force_n, double x_mm) {
      const ContactState& of_grid = grid.press_to(force_n, {x_mm, 0.0}, 0.0);
      const ContactState& of_springs = springs.press_to(force_n, {x_mm, 0.0}, 0.0);
      if (of_grid.gross && of_springs.gross) DOUBLES_EQUAL(of_grid.slid_mm.x, of_springs.slid_mm.x, 0.02 * kWay_mm);
      CHECK_TEXT(of_springs.slid_mm.x < x_mm + 1e-9, std::to_string(of_springs.slid_mm.x - x_mm).c_str());
      return of_springs.slid_mm.x;
    };
    for (int k = 1; k <= 10; ++k) (void)both_slid_mm(0.3 * k, 0.0);
    for (int k = 1; k <= 30; ++k) (void)both_slid_mm(3.0, 0.1 * k);
    double slid_mm = 0.0;
    for (int k = 1; k <= 30; ++k) slid_mm = both_slid_mm(3.0 * std::pow(0.01, k / 30.0), kWay_mm);
    CHECK_TEXT(slid_mm > 0.95 * kWay_mm, std::to_string(slid_mm).c_str());
    if (kinetic == 0.0) DOUBLES_EQUAL(kWay_mm, slid_mm, 1e-9);
  }
}

// An object that does not turn does not slide about its middle, whatever presses on it.
TEST(ContactRound, ATurnThatHasSlidStaysWhenTheForceChanges) {
  SpringsContact springs(round_of(kGel, 15.0, 0.2), markers());
  (void)springs.press_to(2.0, {}, 0.0);
  constexpr double kTurn = 0.7;
  double slid = 0.0;
  for (int k = 1; k <= 40; ++k) {
    const double before = slid;
    slid = springs.press_to(2.0, {}, kTurn * k / 40).slid_rad;
    CHECK(slid >= before);
  }
  CHECK_TEXT(slid > 0.2 && slid < kTurn, std::to_string(slid).c_str());
  for (int k = 1; k <= 20; ++k) {
    const double before = slid;
    slid = springs.press_to(2.0 - 0.095 * k, {}, kTurn).slid_rad;
    CHECK(slid >= before - 1e-9 && slid < kTurn);
  }
  for (int k = 1; k <= 20; ++k) DOUBLES_EQUAL(slid, springs.press_to(0.1 + 0.3 * k, {}, kTurn).slid_rad, 1e-9);
}

// What a layer adds to a twist, by two radii for all discs, against the layer's own motion of every disc.
TEST(ContactRound, LayerTurnsByTwoRadii) {
  const Layer layer(kGel);
  const Press press = layer.press_by_force(15.0, 3.0);
  for (const double angle : {0.02, 0.06, 0.15}) {
    TwistSprings springs({kGel.shear_modulus_mpa, press.contact_radius_mm, 64});
    (void)springs.step(press, 0.5, 0.5, angle);
    const TwistDiscs discs = springs.discs();
    RoundField round(round_of(kGel), markers());
    std::vector<Vec2> u(markers().size());
    round.add_discs(press.contact_radius_mm, discs, u);
    const double rim = angle * press.contact_radius_mm;
    for (std::size_t i = 0; i < u.size(); ++i) {
      const Vec2 at = markers()[i];
      const double r = length(at);
      // Beyond the rim the discs themselves are exact.
      if (r < 1.05 * press.contact_radius_mm) continue;
      double motion = 0.0;
      for (int k = 0; k < discs.count; ++k) {
        const TwistDiscs::Disc& disc = discs.discs[static_cast<std::size_t>(k)];
        motion += disc_moment_nmm(kGel, disc) * layer.torque(disc.radius_mm, r);
      }
      DOUBLES_EQUAL(motion, (at.x * u[i].y - at.y * u[i].x) / r, 1e-3 * rim);
    }
  }
}

// Shear and twist together: their loads are inside the ellipse of the limits - at light loads nothing slips -, and end
// on it in any proportion.
TEST(ContactRound, LoadsOfBothKindsStayInsideTheEllipseAndEndOnIt) {
  const auto used = [](const ContactState& s) {
    const double q = length(s.shear_n) / 1.5;
    const double m = s.moment_nmm / (3.0 * 3.14159265 / 16.0 * 1.5 * s.contact_radius_mm);
    return q * q + m * m;
  };
  SpringsContact light(round_of(kGel), markers());
  (void)light.press_to(3.0, {}, 0.0);
  double most = 0.0;
  for (int k = 0; k < 200; ++k) {
    const double phase = 0.1 * k;
    const ContactState& s =
        light.press_to(3.0, {0.35 * std::sin(phase), 0.2 * std::sin(1.3 * phase)}, 0.03 * std::sin(1.7 * phase));
    CHECK(!s.gross);
    most = std::max(most, used(s));
  }
  CHECK(most > 0.1 && most < 0.8);
  for (const double mix : {0.0, 0.02, 0.1, 0.3, 1.0, 10.0}) {
    SpringsContact heavy(round_of(kGel), markers());
    (void)heavy.press_to(3.0, {}, 0.0);
    double end = 0.0;
    for (double way = 0.01; way < 10.0; way *= 1.1) {
      end = used(heavy.press_to(3.0, {way, 0.0}, way * mix));
      CHECK_TEXT(end < 1.001, std::to_string(end).c_str());
    }
    CHECK_TEXT(end > 0.99, (std::to_string(mix) + " " + std::to_string(end)).c_str());
  }
}
