// SPDX-License-Identifier: Apache-2.0
// Oracles: FOTS's formulas in its own pixels, symmetry, and what a slider on a spring does.
#include "drivers/sim/scene/contact_kinematic.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using std::numbers::pi;

namespace {

constexpr double kPixelsPerMm = 19.58;
constexpr double kDilate = 0.00125;
constexpr double kShear = 0.00021;
constexpr double kTwist = 0.00038;
constexpr double kLimit_mm = 10.0 / kPixelsPerMm;
constexpr double kLimit_rad = 50.0 * pi / 180.0;

std::vector<Vec2> grid(int rows = 7, int cols = 9) {
  std::vector<Vec2> markers;
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      markers.push_back({(col - 0.5 * (cols - 1)) * 2.02, (row - 0.5 * (rows - 1)) * 2.02});
    }
  }
  return markers;
}

struct Drag {
  double depth_mm;
  Vec2 from_mm;
  Vec2 by_mm;
  double turn_rad;
};

// utils/marker_motion.py, without int(): pixels all the way, a sphere's depth at each marker.
std::vector<Vec2> fots(const std::vector<Vec2>& markers, double radius_mm, const Drag& drag) {
  const double k = kPixelsPerMm;
  std::vector<Vec2> result;
  const Vec2 center{(drag.from_mm.x + drag.by_mm.x) * k, (drag.from_mm.y + drag.by_mm.y) * k};
  for (const Vec2 marker : markers) {
    double x = marker.x * k;
    double y = marker.y * k;
    double dx = 0.0;
    double dy = 0.0;
    for (const Vec2 other : markers) {
      const double away = std::hypot(other.x * k - center.x, other.y * k - center.y) / k;
      const double h = drag.depth_mm - away * away / (2.0 * radius_mm);
      if (h <= 0.0) continue;
      const double g = std::exp(-(std::pow(x - other.x * k, 2) + std::pow(y - other.y * k, 2)) * kDilate);
      dx += h * (x - other.x * k) * g;
      dy += h * (y - other.y * k) * g;
    }
    x += dx;
    y += dy;
    const Vec2 g0{drag.from_mm.x * k, drag.from_mm.y * k};
    const double shear = std::exp(-(std::pow(x - g0.x, 2) + std::pow(y - g0.y, 2)) * kShear);
    x += drag.by_mm.x * k * shear;
    y += drag.by_mm.y * k * shear;
    const double theta = std::clamp(drag.turn_rad, -kLimit_rad, kLimit_rad);
    const double ox = x - center.x;
    const double oy = y - center.y;
    const double twist = std::exp(-(ox * ox + oy * oy) * kTwist);
    x += (ox * std::cos(theta) - oy * std::sin(theta) - ox) * twist;
    y += (ox * std::sin(theta) + oy * std::cos(theta) - oy) * twist;
    result.push_back({x / k - marker.x, y / k - marker.y});
  }
  return result;
}

void check_finite(const ContactState& s, const std::vector<Vec2>& motion) {
  for (const double value :
       {s.depth_mm, s.normal_n, s.contact_radius_mm, s.stick_radius_mm, s.slip_fraction, s.shear_n.x, s.moment_nmm,
        s.slid_mm.x, s.slid_mm.y, s.slid_rad, s.center_mm.x, s.center_mm.y}) {
    CHECK(std::isfinite(value));
  }
  for (const Vec2 u : motion) CHECK(std::isfinite(u.x) && std::isfinite(u.y));
}

}  // namespace

TEST_GROUP(ContactKinematic) {
  std::vector<Vec2> markers = grid();
  std::vector<Vec2> motion = std::vector<Vec2>(markers.size());
  KinematicSetup setup;
  double most() const {
    double result = 0.0;
    for (const Vec2 u : motion) result = std::max(result, std::hypot(u.x, u.y));
    return result;
  }
};

TEST(ContactKinematic, DoesWhatFotsDoes) {
  for (const Drag& drag : {Drag{0.3, {0.4, -0.3}, {}, 0.0}, Drag{0.8, {0, 0}, {0.3, -0.2}, 0.0},
                           Drag{0.8, {1, 2}, {}, 0.2}, Drag{0.5, {-2, 1}, {-0.4, 0.1}, -0.5},
                           Drag{0.5, {-2, 1}, {-0.4, 0.1}, 2.0}, Drag{1e-6, {0, 0}, {0.001, 0}, 1e-4}}) {
    KinematicContact contact(setup, markers);
    contact.move_to({drag.depth_mm, drag.from_mm, 0.0});
    contact.move_to({drag.depth_mm, {drag.from_mm.x + drag.by_mm.x, drag.from_mm.y + drag.by_mm.y}, drag.turn_rad});
    contact.field(motion);
    const std::vector<Vec2> wanted = fots(markers, setup.shape.radius_mm, drag);
    for (std::size_t m = 0; m < markers.size(); ++m) {
      DOUBLES_EQUAL(wanted[m].x, motion[m].x, 1e-5 * most());  // the radii have seven digits
      DOUBLES_EQUAL(wanted[m].y, motion[m].y, 1e-5 * most());
    }
  }
}

TEST(ContactKinematic, RadiiAreThoseOfFots) {
  DOUBLES_EQUAL(1.0 / std::sqrt(kDilate) / kPixelsPerMm, setup.dilate_radius_mm, 1e-6);
  DOUBLES_EQUAL(1.0 / std::sqrt(kShear) / kPixelsPerMm, setup.shear_radius_mm, 1e-6);
  DOUBLES_EQUAL(1.0 / std::sqrt(kTwist) / kPixelsPerMm, setup.twist_radius_mm, 1e-6);
  DOUBLES_EQUAL(kLimit_mm, setup.most_shear_mm, 1e-6);
}

TEST(ContactKinematic, PressAloneMovesOutwardAndMirrors) {
  KinematicContact contact(setup, markers);
  contact.move_to({0.5, {}, 0.0});
  contact.field(motion);
  CHECK(most() > 0.0);
  for (std::size_t m = 0; m < markers.size(); ++m) {
    CHECK(motion[m].x * markers[m].x + motion[m].y * markers[m].y >= -1e-12);
    const std::size_t mirror = markers.size() - 1 - m;
    DOUBLES_EQUAL(-motion[m].x, motion[mirror].x, 1e-13);
    DOUBLES_EQUAL(-motion[m].y, motion[mirror].y, 1e-13);
  }
}

// Below a 50 um pixel FOTS itself does not move at all; and no rounding of cos(theta) - 1.
TEST(ContactKinematic, SmallMotionsAreLinear) {
  setup.dilate_per_mm = 0.0;
  KinematicContact contact(setup, markers);
  contact.move_to({0.5, {}, 0.0});
  for (const double small : {1e-3, 1e-9, 1e-200, 1e-310}) {
    contact.move_to({0.5, {small, 0.0}, 0.0});
    contact.field(motion);
    DOUBLES_EQUAL(1.0, motion[31].x / small, 1e-6);  // marker 31 is the middle; its own motion is 1e-3 of a radius
    contact.move_to({0.5, {}, small});
    contact.field(motion);
    const double arm = 2.02 * std::exp(-std::pow(2.02 / setup.twist_radius_mm, 2));
    DOUBLES_EQUAL(arm, motion[32].y / small, 1e-5);
    contact.move_to({0.5, {}, 0.0});
    contact.field(motion);
    DOUBLES_EQUAL(0.0, most(), 0.0);
  }
}

TEST(ContactKinematic, SlidesBeyondTheLimitAndComesBack) {
  setup.dilate_per_mm = 0.0;
  KinematicContact contact(setup, markers);
  contact.move_to({0.5, {-2.0, 0.0}, 0.0});
  const auto at = [&](double x) -> const ContactState& { return contact.move_to({0.5, {-2.0 + x, 0.0}, 0.0}); };
  CHECK_FALSE(at(0.5).gross);
  DOUBLES_EQUAL(0.0, at(0.5).slid_mm.x, 0.0);
  for (int i = 0; i < 100; ++i) at(0.5 + i * 0.035);
  const ContactState& s = at(4.0);
  CHECK(s.gross);
  DOUBLES_EQUAL(4.0 - kLimit_mm, s.slid_mm.x, 1e-6);
  DOUBLES_EQUAL(0.0, s.stick_radius_mm, 0.0);
  DOUBLES_EQUAL(1.0, s.slip_fraction, 0.0);
  DOUBLES_EQUAL(2.0, s.center_mm.x, 1e-12);
  CHECK(at(4.0).gross);  // held at its limit
  contact.field(motion);
  CHECK(most() <= kLimit_mm * (1.0 + 1e-4));
  // Back: it sticks at once, has no motion left after the limit, and slides again after twice the limit.
  CHECK_FALSE(at(4.0 - 0.01).gross);
  at(4.0 - setup.most_shear_mm);
  contact.field(motion);
  DOUBLES_EQUAL(0.0, most(), 1e-14);
  CHECK_FALSE(at(4.0 - 1.999 * setup.most_shear_mm).gross);
  CHECK(at(4.0 - 2.001 * setup.most_shear_mm).gross);
  // One step or many.
  KinematicContact one(setup, markers);
  one.move_to({0.5, {-2.0, 0.0}, 0.0});
  DOUBLES_EQUAL(4.0 - kLimit_mm, one.move_to({0.5, {2.0, 0.0}, 0.0}).slid_mm.x, 1e-6);
}

TEST(ContactKinematic, TurnsBeyondTheLimitAndComesBack) {
  KinematicContact contact(setup, markers);
  contact.move_to({0.5, {}, 1.0});
  CHECK_FALSE(contact.move_to({0.5, {}, 1.0 + 0.99 * kLimit_rad}).gross);
  const ContactState& s = contact.move_to({0.5, {}, 1.0 + pi});
  CHECK(s.gross);
  DOUBLES_EQUAL(pi - kLimit_rad, s.slid_rad, 1e-12);
  CHECK(contact.move_to({0.5, {}, 1.0 + pi}).gross);
  CHECK_FALSE(contact.move_to({0.5, {}, 1.0 + pi - 1.9 * kLimit_rad}).gross);
  DOUBLES_EQUAL(pi - kLimit_rad, s.slid_rad, 1e-12);
}

TEST(ContactKinematic, LettingGoForgets) {
  KinematicContact contact(setup, markers);
  contact.move_to({0.5, {}, 0.0});
  contact.move_to({0.5, {3.0, 0.0}, 0.3});
  const ContactState& gone = contact.move_to({0.0, {3.0, 0.0}, 0.3});
  DOUBLES_EQUAL(0.0, gone.contact_radius_mm, 0.0);
  DOUBLES_EQUAL(0.0, gone.slid_mm.x, 0.0);
  CHECK_FALSE(gone.gross);
  contact.field(motion);
  DOUBLES_EQUAL(0.0, most(), 0.0);
  setup.dilate_per_mm = 0.0;
  KinematicContact again(setup, markers);
  again.move_to({0.5, {}, 0.0});
  again.move_to({-1.0, {3.0, 0.0}, 0.3});
  CHECK_FALSE(again.move_to({0.5, {3.0, 0.0}, 0.3}).gross);
  again.field(motion);
  DOUBLES_EQUAL(0.0, most(), 0.0);
}

TEST(ContactKinematic, ForceAndDepthAreInverse) {
  for (const ShapeKind kind : {ShapeKind::kSphere, ShapeKind::kEllipsoid, ShapeKind::kCylinder, ShapeKind::kCone,
                               ShapeKind::kDisc, ShapeKind::kBox, ShapeKind::kEdge}) {
    setup.shape = {};
    setup.shape.kind = kind;
    KinematicContact contact(setup, markers);
    for (const double force : {1e-9, 0.1, 8.0, 1e6}) {
      const ContactState& s = contact.press_to(force, {}, 0.0);
      CHECK(s.depth_mm > 0.0 && s.contact_radius_mm > 0.0);
      DOUBLES_EQUAL(force, s.normal_n, 1e-13 * force);
    }
    DOUBLES_EQUAL(0.0, contact.press_to(0.0, {}, 0.0).contact_radius_mm, 0.0);
  }
  setup.shape = {};
  const Press press = press_sphere(setup.gel, setup.shape.radius_mm, 8.0);
  KinematicContact sphere(setup, markers);
  const ContactState& s = sphere.press_to(8.0, {}, 0.0);
  DOUBLES_EQUAL(press.depth_mm, s.depth_mm, 1e-12);
  // The disc that the undeformed surface cuts out: sqrt(2) of Hertz's.
  DOUBLES_EQUAL(std::sqrt(2.0) * press.contact_radius_mm, s.contact_radius_mm, 1e-12);
}

// A turned box presses the markers under its turned outline.
TEST(ContactKinematic, ShapeTurnsWithTheObject) {
  setup.shape.kind = ShapeKind::kBox;
  setup.shape.half_x_mm = 6.5;
  setup.shape.half_y_mm = 0.5;
  setup.shape.rim_mm = 0.0;
  KinematicContact along(setup, markers);
  along.move_to({0.3, {}, 0.0});
  along.field(motion);
  const std::vector<Vec2> flat = motion;
  KinematicContact across(setup, markers);
  across.move_to({0.3, {}, pi / 2.0});
  across.field(motion);
  // Seven markers under it both ways; a quarter turn of the pattern.
  for (int row = 0; row < 7; ++row) {
    for (int col = 1; col < 8; ++col) {
      const Vec2 u = flat[static_cast<std::size_t>(row * 9 + col)];
      const Vec2 v = motion[static_cast<std::size_t>((col - 1) * 9 + 7 - row)];
      DOUBLES_EQUAL(-u.y, v.x, 1e-12);
      DOUBLES_EQUAL(u.x, v.y, 1e-12);
    }
  }
}

TEST(ContactKinematic, AnyNumberOfMarkers) {
  for (const auto& some : {std::vector<Vec2>{}, std::vector<Vec2>{{0.1, 0.1}}, grid(8, 16)}) {
    KinematicContact contact(setup, some);
    contact.move_to({0.5, {}, 0.0});
    contact.move_to({0.5, {0.2, 0.1}, 0.1});
    std::vector<Vec2> out(some.size() + 1, Vec2{7.0, 7.0});
    contact.field(out);
    CHECK((out.back() == Vec2{7.0, 7.0}));
    for (std::size_t m = 0; m < some.size(); ++m) CHECK(std::isfinite(out[m].x) && out[m].x != 7.0);
  }
}

TEST(ContactKinematic, ExtremesAreFinite) {
  for (const double scale : {0.0, 1e-300, 1.0, 1e300}) {
    for (const ShapeKind kind :
         {ShapeKind::kSphere, ShapeKind::kEllipsoid, ShapeKind::kCone, ShapeKind::kDisc, ShapeKind::kEdge}) {
      setup = {};
      setup.shape.kind = kind;
      setup.shape.radius_mm *= scale;
      setup.shape.radius_y_mm *= scale;
      setup.most_shear_mm *= scale;
      setup.most_twist_deg *= scale;
      setup.shear_radius_mm *= scale;
      setup.twist_radius_mm *= scale;
      setup.dilate_radius_mm *= scale;
      if (scale > 0.0) setup.gel.shear_modulus_mpa *= scale;
      KinematicContact contact(setup, markers);
      for (const double depth : {0.3, 1e-320, 1e300, -1e300, 0.0, 0.2}) {
        for (const double x : {0.0, 1e-320, 1.0, -1e300, 1e300}) {
          for (const double turn : {0.0, 1e-320, pi, -1e300, 1e300}) {
            const ContactState& s = contact.move_to({depth, {x, -x}, turn});
            contact.field(motion);
            check_finite(s, motion);
            contact.press_to(std::abs(depth), {x, x}, turn);
            contact.field(motion);
            check_finite(s, motion);
          }
        }
      }
    }
  }
}
