// SPDX-License-Identifier: Apache-2.0
// Oracles: closed forms of Hertz, Cattaneo and Mindlin, Lubkin and of the rigid punches on the half-space (press and
// shear uncoupled and nu = 0, where Cattaneo's and Mindlin's neglect of sideways slip is none), springs under a load
// that changes, the layer's exact sphere and a Fourier solution of it, Masing's rule, balance of force and energy, and
// refinement.
#include "drivers/sim/scene/contact/grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "drivers/sim/scene/contact/layer.hpp"
#include "drivers/sim/scene/contact/springs.hpp"
#include "tests/support/closed_forms.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using namespace holdfast::test;
using std::numbers::pi;

namespace {

constexpr double kPress_n = 1.5;
constexpr double kFriction = 0.5;
constexpr double kLimit_n = kFriction * kPress_n;
constexpr Vec2 kAt{0.13, -0.21};  // off the grid's symmetry

Gel half_space(double nu, double shear_modulus_mpa = 0.1) {
  return {shear_modulus_mpa, nu};
}

// Where the closed forms hold.
GridSetup classic(double cell_mm, double nu = 0.0) {
  GridSetup setup;
  setup.gel = half_space(nu);
  setup.coupled = false;
  setup.cell_mm = cell_mm;
  setup.pad_mm = {10.4, 10.4};
  setup.tolerance = 1e-6;
  return setup;
}

GridSetup sensor(double cell_mm = 0.7) {
  GridSetup setup;
  setup.gel = {0.035, 0.49, 4.25};
  setup.cell_mm = cell_mm;
  return setup;
}

std::vector<Vec2> markers() {
  std::vector<Vec2> at;
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 9; ++col) at.push_back({(col - 4) * 2.02, (row - 3) * 2.02});
  }
  return at;
}

double norm(Vec2 v) {
  return std::hypot(v.x, v.y);
}

Vec2 shifted(double x) {
  return {kAt.x + x, kAt.y};
}

void check_sane(GridContact& contact, const ContactState& s, std::size_t points) {
  for (const double v :
       {s.depth_mm, s.normal_n, s.contact_radius_mm, s.stick_radius_mm, s.slip_fraction, s.shear_n.x, s.shear_n.y,
        s.moment_nmm, s.slid_mm.x, s.slid_mm.y, s.slid_rad, s.center_mm.x, s.center_mm.y, contact.stats().dissipated_mj,
        contact.stats().press_residual, contact.stats().shear_residual}) {
    CHECK(std::isfinite(v));
  }
  CHECK(s.slip_fraction >= 0.0 && s.slip_fraction <= 1.0);
  CHECK(s.stick_radius_mm <= s.contact_radius_mm);
  CHECK(s.normal_n >= 0.0 && contact.stats().dissipated_mj >= 0.0);
  std::vector<Vec2> motion(points);
  contact.field(motion);
  for (const Vec2 u : motion) CHECK(std::isfinite(u.x) && std::isfinite(u.y));
}

constexpr std::array<double, 3> kCells{0.6, 0.3, 0.15};

// Errors that fall by `factor` or more from the first cell to the last (order 1 is 4), and stay below `most` there.
void check_falls(const std::array<double, 3>& error, double factor, double most) {
  CHECK(error[2] * factor <= error[0]);
  CHECK(error[2] <= most);
}

}  // namespace

// Fine grids take seconds: the sanitizers and the emulator leave this group out (tests/run.sh).
TEST_GROUP(ContactGridFine){};
TEST_GROUP(ContactGrid){};

TEST(ContactGridFine, PressMeetsHertzAndRefines) {
  std::array<double, 3> depth{}, radius{}, peak{};
  for (std::size_t k = 0; k < kCells.size(); ++k) {
    const GridSetup setup = classic(kCells[k], 0.5);
    const Press exact = press_sphere(setup.gel, 15.0, kPress_n);
    GridContact contact(setup, {});
    const ContactState state = contact.press_to(kPress_n, kAt, 0.0);
    DOUBLES_EQUAL(kPress_n, state.normal_n, 1e-12 * kPress_n);
    depth[k] = std::abs(state.depth_mm / exact.depth_mm - 1.0);
    radius[k] = std::abs(state.contact_radius_mm / exact.contact_radius_mm - 1.0);
    peak[k] = std::abs(contact.traction_at(kAt).pressure_mpa / exact.peak_pressure_mpa - 1.0);
    // By depth the same contact comes back.
    GridContact by_depth(setup, {});
    DOUBLES_EQUAL(kPress_n, by_depth.move_to({state.depth_mm, kAt, 0.0}).normal_n, 1e-5 * kPress_n);
    CHECK_EQUAL(0, contact.stats().unsettled);
  }
  check_falls(depth, 8.0, 1e-4);                        // order 2
  check_falls(radius, 2.0, 5e-3);                       // cells that count whole or not at all
  for (const double error : peak) CHECK(error < 1e-3);  // where in its cell the middle lies
}

TEST(ContactGridFine, DragMeetsCattaneoAndMindlin) {
  std::array<double, 3> force{}, stick{}, field{};
  const std::vector<Vec2> at = markers();
  for (std::size_t k = 0; k < kCells.size(); ++k) {
    const GridSetup setup = classic(kCells[k]);
    const FrictionContact exact{setup.gel, press_sphere(setup.gel, 15.0, kPress_n), kFriction};
    const double gross = gross_displacement_mm(exact);
    GridContact contact(setup, at);
    contact.press_to(kPress_n, kAt, 0.0);
    for (int i = 1; i <= 10; ++i) {
      const double way = 0.098 * i * gross;
      const ContactState state = contact.press_to(kPress_n, shifted(way), 0.0);
      const Shear shear = shear_by_displacement(exact, way);
      force[k] = std::max(force[k], std::abs(state.shear_n.x - shear.force_n) / kLimit_n);
      stick[k] = std::max(stick[k], std::abs(state.stick_radius_mm - shear.stick_radius_mm));
      DOUBLES_EQUAL(0.0, state.shear_n.y, 1e-6 * kLimit_n);
      CHECK_FALSE(state.gross);
      std::vector<Vec2> motion(at.size());
      contact.field(motion);
      double square = 0.0;
      for (std::size_t m = 0; m < at.size(); ++m) {
        const Vec2 u = shear_field_mm(exact, shear, {at[m].x - kAt.x, at[m].y - kAt.y});
        square += std::pow(norm({motion[m].x - u.x, motion[m].y - u.y}) / gross, 2.0);
      }
      field[k] = std::max(field[k], std::sqrt(square / static_cast<double>(at.size())));
    }
    // The middle of the contact stuck; beyond gross displacement all slips and the middle is left behind.
    DOUBLES_EQUAL(0.0, contact.press_to(kPress_n, shifted(0.8 * gross), 0.0).slid_mm.x, 0.01 * gross);
    const ContactState state = contact.press_to(kPress_n, shifted(1.5 * gross), 0.0);
    CHECK_TRUE(state.gross);
    DOUBLES_EQUAL(1.0, state.slip_fraction, 0.0);
    DOUBLES_EQUAL(kLimit_n, state.shear_n.x, 1e-3 * kLimit_n);
    DOUBLES_EQUAL(0.5 * gross, state.slid_mm.x, 0.03 * gross);  // seen over a third of the radius
    CHECK_EQUAL(0, contact.stats().unsettled);
  }
  check_falls(force, 4.0, 2e-4);
  check_falls(stick, 2.0, 0.08);  // mm: cells that count whole or not at all
  check_falls(field, 3.0, 5e-4);  // RMS over the markers, of the gross displacement
}

TEST(ContactGridFine, TwistMeetsLubkin) {
  // c/a; M / mu P a; G a^2 beta / mu P: elliptic integrals, computed for this project. A stiff gel: small turns.
  struct Case {
    double stick, moment, turn;
  };
  constexpr std::array<Case, 7> kTable{{{0.98, 0.03901, 0.00754},
                                        {0.9, 0.17635, 0.03851},
                                        {0.8, 0.31053, 0.07942},
                                        {0.6, 0.48048, 0.17164},
                                        {0.4, 0.55919, 0.28853},
                                        {0.2, 0.58554, 0.46925},
                                        {1e-3, 0.58905, 1.74133}}};
  std::array<double, 3> moment{};
  for (std::size_t k = 0; k < kCells.size(); ++k) {
    GridSetup setup = classic(kCells[k]);
    setup.gel = half_space(0.0, 10.0);
    setup.shape.radius_mm = 1500.0;
    const double a = press_sphere(setup.gel, 1500.0, kPress_n).contact_radius_mm;
    GridContact contact(setup, {});
    contact.press_to(kPress_n, kAt, 0.3);
    for (const Case& c : kTable) {
      const double turn = c.turn * kLimit_n / (10.0 * a * a);
      const ContactState state = contact.press_to(kPress_n, kAt, 0.3 + turn);
      moment[k] = std::max(moment[k], std::abs(state.moment_nmm / (kLimit_n * a) - c.moment));
      DOUBLES_EQUAL(c.stick * a, state.stick_radius_mm, 0.6 * kCells[k]);  // a single cell in the middle
      DOUBLES_EQUAL(0.0, norm(state.shear_n), 4e-3 * kLimit_n);            // the cells are not round
      if (c.stick > 0.35) DOUBLES_EQUAL(0.0, state.slid_rad, 0.02 * turn);
    }
  }
  check_falls(moment, 4.0, 5e-4);
}

TEST(ContactGridFine, FlatPunchesCarryWhatTheyShould) {
  std::array<double, 3> press{};
  for (std::size_t k = 0; k < kCells.size(); ++k) {
    GridSetup setup = classic(kCells[k]);
    setup.shape.kind = ShapeKind::kDisc;
    setup.shape.radius_mm = 5.0;
    setup.shape.rim_mm = 0.0;
    GridContact contact(setup, {});
    press[k] = std::abs(contact.move_to({0.5, kAt, 0.0}).normal_n / (2.0 * 5.0 * 0.2 * 0.5) - 1.0);  // 2 a E* d
  }
  check_falls(press, 2.0, 0.02);
  for (const ShapeKind kind : {ShapeKind::kDisc, ShapeKind::kBox}) {
    GridSetup setup = sensor();
    setup.shape.kind = kind;
    setup.shape.radius_mm = 5.0;
    GridContact contact(setup, {});
    contact.press_to(3.0, {-2.0, 0.0}, 0.0);
    const ContactState stuck = contact.press_to(3.0, {-1.7, 0.0}, 0.0);
    CHECK(stuck.slip_fraction < 0.6 && stuck.shear_n.x > 0.0);
    const ContactState slides = contact.press_to(3.0, {2.0, 0.0}, 0.0);
    CHECK_TRUE(slides.gross);
    DOUBLES_EQUAL(1.5, slides.shear_n.x, 0.01 * 1.5);
    DOUBLES_EQUAL(3.0, slides.normal_n, 1e-9);
    // Off the normal it touches on one side.
    setup.shape.tilt_rad = 0.1;
    GridContact tilted(setup, {});
    const ContactState lean = tilted.press_to(1.0, {}, 0.0);
    CHECK(lean.center_mm.y > 1.5);
    DOUBLES_EQUAL(0.0, lean.center_mm.x, 1e-6);
  }
}

TEST(ContactGrid, CylinderIsALineContact) {
  GridSetup setup = classic(0.25, 0.5);
  setup.shape.kind = ShapeKind::kCylinder;
  setup.pad_mm = {40.0, 10.0};
  setup.tolerance = 1e-4;
  GridContact contact(setup, {});
  const ContactState state = contact.press_to(12.0, {}, 0.0);
  // Johnson 4.43 with the load per length in the middle.
  double line = 0.0;
  int wide = 0;
  for (int i = 0; i < 40; ++i) {
    const double p = contact.traction_at({0.05, (i - 19.5) * 0.25}).pressure_mpa;
    line += 0.25 * p;
    if (p > 0.0) ++wide;
  }
  const double modulus = effective_modulus_mpa(setup.gel);
  const double b = std::sqrt(4.0 * line * 15.0 / (pi * modulus));
  DOUBLES_EQUAL(b, 0.125 * wide, 0.13);  // half a cell
  DOUBLES_EQUAL(2.0 * line / (pi * b), contact.traction_at({0.05, 0.1}).pressure_mpa, 0.02 * 2.0 * line / (pi * b));
  CHECK(line > 0.2 && line < 12.0 / 40.0);  // the ends carry more
  DOUBLES_EQUAL(12.0, state.normal_n, 1e-9);
}

TEST(ContactGrid, LayerCarriesItsSphere) {
  for (const double press_n : {0.3, 3.0}) {
    GridSetup setup = sensor(0.25);
    setup.static_friction = setup.kinetic_friction = 0.0;
    setup.tolerance = 1e-5;
    const Press exact = Layer(setup.gel).press_by_force(15.0, press_n);
    GridContact contact(setup, {});
    const ContactState state = contact.press_to(press_n, kAt, 0.0);
    DOUBLES_EQUAL(exact.depth_mm, state.depth_mm, 1e-3 * exact.depth_mm);
    DOUBLES_EQUAL(exact.contact_radius_mm, state.contact_radius_mm, 0.1);
    DOUBLES_EQUAL(exact.peak_pressure_mpa, contact.traction_at(kAt).pressure_mpa, 4e-3 * exact.peak_pressure_mpa);
  }
}

TEST(ContactGrid, TheWayBackIsMasings) {
  const GridSetup setup = classic(0.5);
  const FrictionContact exact{setup.gel, press_sphere(setup.gel, 15.0, kPress_n), kFriction};
  const double gross = gross_displacement_mm(exact);
  const double most = 0.8 * gross;
  GridContact contact(setup, {});
  contact.press_to(kPress_n, kAt, 0.0);
  contact.press_to(kPress_n, shifted(most), 0.0);
  const double spent = contact.stats().dissipated_mj;
  CHECK(contact.press_to(kPress_n, shifted(most * (1.0 - 1e-6)), 0.0).slip_fraction < 0.05);
  const auto virgin = [&](double way) { return shear_by_displacement(exact, way).force_n; };
  double area = 0.0;
  double before = virgin(most);
  for (int i = 1; i <= 40; ++i) {
    const double way = most - 2.0 * most * i / 40.0;
    const ContactState state = contact.press_to(kPress_n, shifted(way), 0.0);
    DOUBLES_EQUAL(virgin(most) - 2.0 * virgin(0.5 * (most - way)), state.shear_n.x, 2e-3 * kLimit_n);
    area += 0.5 * (before + state.shear_n.x) * 2.0 * most / 40.0;
    before = state.shear_n.x;
  }
  // Half a loop: the work of the object, all of which friction took (the stored energy is the same at both ends).
  DOUBLES_EQUAL(-area, contact.stats().dissipated_mj - spent, 0.02 * std::abs(area));
}

TEST(ContactGrid, KineticFrictionIsBelowStatic) {
  GridSetup setup = sensor();
  setup.static_friction = 0.6;
  setup.kinetic_friction = 0.4;
  GridContact contact(setup, {});
  contact.press_to(3.0, {-2.0, 0.0}, 0.0);
  double most = 0.0;
  ContactState state;
  for (int i = 1; i <= 60; ++i) {
    state = contact.press_to(3.0, {-2.0 + 0.08 * i, 0.0}, 0.0);
    most = std::max(most, state.shear_n.x);
  }
  // A front that holds more than it carries behind itself is a crack: it runs as soon as it forms, so that the whole
  // never carries much more than mu_k (springs that do not know each other: 0.476).
  CHECK(most > 0.4 * 3.0 && most < 0.43 * 3.0);
  DOUBLES_EQUAL(0.4 * 3.0, state.shear_n.x, 1e-3 * 3.0);
  CHECK_TRUE(state.gross);
  // Backwards it sticks again.
  CHECK(contact.press_to(3.0, {2.7, 0.0}, 0.0).slip_fraction < 0.5);
  // Both the same: no such peak.
  setup.kinetic_friction = 0.6;
  GridContact even(setup, {});
  even.press_to(3.0, {-2.0, 0.0}, 0.0);
  CHECK(even.press_to(3.0, {2.8, 0.0}, 0.0).shear_n.x > 0.6 * 3.0 * 0.99);
}

TEST(ContactGrid, SlidingContactTravelsUnchanged) {
  GridSetup setup = sensor();
  setup.coupled = false;  // one half of the coupling without the other does not conserve energy: 5 % here
  GridContact contact(setup, {});
  contact.press_to(3.0, {-6.0, 0.1}, 0.0);
  ContactState first;
  for (int i = 1; i <= 80; ++i) first = contact.press_to(3.0, {-6.0 + 0.07 * i, 0.1}, 0.0);
  std::vector<GridContact::Traction> before;
  before.reserve(225);
  const auto place = [](const ContactState& s, int i) {
    const int row = i / 15;
    const int col = i % 15;
    return Vec2{-6.0 + s.slid_mm.x + (col - 7) * 0.7, 0.1 + (row - 7) * 0.7};
  };
  for (int i = 0; i < 225; ++i) before.push_back(contact.traction_at(place(first, i)));
  const double spent = contact.stats().dissipated_mj;
  ContactState last;
  for (int i = 81; i <= 150; ++i) last = contact.press_to(3.0, {-6.0 + 0.07 * i, 0.1}, 0.0);  // 7 cells on
  DOUBLES_EQUAL(4.9, last.slid_mm.x - first.slid_mm.x, 0.01);
  DOUBLES_EQUAL(first.shear_n.x, last.shear_n.x, 2e-3);
  DOUBLES_EQUAL(first.depth_mm, last.depth_mm, 1e-3);
  DOUBLES_EQUAL(4.9, last.center_mm.x - first.center_mm.x, 0.02);
  CHECK_TRUE(first.gross && last.gross);
  double worst = 0.0;
  double peak = 0.0;
  for (int i = 0; i < 225; ++i) {
    const GridContact::Traction now = contact.traction_at(place(last, i));
    const auto k = static_cast<std::size_t>(i);
    worst = std::max({worst, std::abs(now.pressure_mpa - before[k].pressure_mpa),
                      norm({now.shear_mpa.x - before[k].shear_mpa.x, now.shear_mpa.y - before[k].shear_mpa.y})});
    peak = std::max(peak, now.pressure_mpa);
  }
  CHECK(worst < 0.03 * peak);
  // Friction takes what the object's drive gives.
  DOUBLES_EQUAL(1.5 * 4.9, contact.stats().dissipated_mj - spent, 0.02 * 1.5 * 4.9);
  // 7 cells of a gel that has no pattern: no force across.
  DOUBLES_EQUAL(0.0, last.shear_n.y, 5e-3);
}

TEST(ContactGrid, EveryShapeAndTextureBalances) {
  const std::vector<Vec2> at = markers();
  for (const ShapeKind kind : {ShapeKind::kSphere, ShapeKind::kEllipsoid, ShapeKind::kCylinder, ShapeKind::kCone,
                               ShapeKind::kDisc, ShapeKind::kBox, ShapeKind::kEdge}) {
    for (const TextureKind texture : {TextureKind::kNone, TextureKind::kRidges, TextureKind::kBumps}) {
      GridSetup setup = sensor();
      setup.shape.kind = kind;
      setup.shape.radius_mm = kind == ShapeKind::kDisc ? 5.0 : 12.0;
      setup.shape.yaw_rad = 0.4;
      setup.shape.texture = texture;
      setup.shape.texture_height_mm = 0.3;
      setup.shape.texture_pitch_mm = 2.5;
      GridContact contact(setup, at);
      double spent = 0.0;
      contact.press_to(2.0, {0.4, -0.3}, 0.0);
      for (int i = 1; i <= 12; ++i) {
        const ContactState state = contact.press_to(2.0, {0.4 + 0.15 * i, -0.3 + 0.05 * i}, 0.03 * i);
        check_sane(contact, state, at.size());
        DOUBLES_EQUAL(2.0, state.normal_n, 1e-9);
        CHECK(norm(state.shear_n) <= 1.0 * (1.0 + 1e-9));
        CHECK(contact.stats().dissipated_mj >= spent);
        spent = contact.stats().dissipated_mj;
        // No shear without pressure, also between the crests.
        double excess = 0.0;
        for (int k = 0; k < 1000; ++k) {
          const int row = k / 40;
          const int col = k % 40;
          const GridContact::Traction cell = contact.traction_at({(col - 20) * 0.6, (row - 12) * 0.7});
          excess = std::max(excess, norm(cell.shear_mpa) - 0.5 * cell.pressure_mpa);
        }
        CHECK(excess <= 1e-12);
      }
      CHECK_EQUAL(0, contact.stats().unsettled);
    }
  }
}

TEST(ContactGrid, NothingStrangeAtTheEnds) {
  const std::vector<Vec2> at = markers();
  for (const double modulus : {1e-6, 0.035, 1e6}) {
    for (const double friction : {0.0, 0.5, 1e6}) {
      GridSetup setup = sensor(1.0);
      setup.gel.shear_modulus_mpa = modulus;
      setup.static_friction = setup.kinetic_friction = friction;
      GridContact contact(setup, at);
      for (const double force : {0.0, -1.0, 1e-300, 1e-9, 3.0, 1e9, 3.0}) {
        check_sane(contact, contact.press_to(force, {}, 0.0), at.size());
      }
      check_sane(contact, contact.press_to(3.0, {1.0, 0.0}, pi), at.size());
      check_sane(contact, contact.press_to(3.0, {1e12, -1e12}, 1e12), at.size());
      for (const double depth : {-1.0, 0.0, 1e-12, 0.5, 1e7, 0.5}) {
        check_sane(contact, contact.move_to({depth, {}, 0.0}), at.size());
      }
    }
  }
  // No contact is nothing.
  GridContact contact(sensor(), at);
  for (const ContactState& state : {contact.move_to({-0.1, {}, 0.0}), contact.press_to(0.0, {1.0, 1.0}, 1.0)}) {
    DOUBLES_EQUAL(0.0, state.normal_n, 0.0);
    DOUBLES_EQUAL(0.0, state.contact_radius_mm, 0.0);
    CHECK_FALSE(state.gross);
  }
  std::vector<Vec2> motion(at.size(), {1.0, 1.0});
  contact.field(motion);
  for (const Vec2 u : motion) DOUBLES_EQUAL(0.0, norm(u), 0.0);
  // A second touch starts afresh.
  contact.press_to(3.0, {}, 0.0);
  contact.press_to(3.0, {1.0, 0.0}, 0.0);
  contact.press_to(0.0, {1.0, 0.0}, 0.0);
  const ContactState again = contact.press_to(3.0, {1.0, 0.0}, 0.0);
  DOUBLES_EQUAL(0.0, norm(again.shear_n), 1e-3);
  DOUBLES_EQUAL(0.0, norm(again.slid_mm), 1e-12);
  // Bare glass and no gel do not touch.
  GridSetup glass = sensor();
  glass.gel.thickness_mm = 0.0;
  DOUBLES_EQUAL(0.0, GridContact(glass, {}).press_to(3.0, {}, 0.0).normal_n, 0.0);
  // Extreme cells.
  for (const double cell : {1e-9, 0.0, 100.0}) {
    GridSetup odd = sensor(cell);
    odd.pad_mm = {0.5, 0.3};
    odd.shape.radius_mm = 0.1;
    GridContact small(odd, {});
    check_sane(small, small.press_to(1e-6, {}, 0.0), 0);
  }
}

TEST(ContactGrid, AFrameIsAFewProducts) {
  // Time is products with 189 x 189 cells: about 16 us of shear, 6 of press. Counts do not depend on the machine.
  const std::vector<Vec2> at = markers();
  GridContact contact(sensor(), at);
  contact.press_to(3.0, {-1.1, -0.3}, 0.0);
  int shear = 0;
  int press = 0;
  for (int i = 1; i <= 12; ++i) {
    contact.press_to(3.0, {-1.1 + 0.32 * i, -0.3}, 0.0);
    shear += contact.stats().shear_products;
    press += contact.stats().press_products;
  }
  CHECK(shear <= 12 * 20 && press <= 12 * 12);
  CHECK_EQUAL(0, contact.stats().unsettled);
  CHECK(contact.stats().shear_residual <= 1e-4 && contact.stats().press_residual <= 1e-4);
}
