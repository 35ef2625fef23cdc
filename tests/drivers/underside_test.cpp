// SPDX-License-Identifier: Apache-2.0
// The gel's surface over an object, against the object's own height, finite differences, and what a relief of that
// height and pitch is.
#include "drivers/sim/scene/picture/underside.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "drivers/sim/scene/math/random.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;

namespace {

using std::numbers::pi;
using Surface = Underside::Surface;
using Pose = Underside::Pose;

// Rims of at least 0.3 mm: sharper ones are rounded on purpose.
const std::vector<Shape> kShapes{
    {.kind = ShapeKind::kEllipsoid, .radius_mm = 18.0, .radius_y_mm = 9.0, .yaw_rad = 0.4},
    {.kind = ShapeKind::kCylinder, .radius_mm = 7.0, .yaw_rad = -0.3},
    {.kind = ShapeKind::kCone, .flank_deg = 12.0},
    {.kind = ShapeKind::kDisc, .radius_mm = 4.0, .rim_mm = 1.0},
    {.kind = ShapeKind::kDisc, .radius_mm = 4.0, .rim_mm = 0.5, .yaw_rad = 1.0, .tilt_rad = 0.04},
    {.kind = ShapeKind::kBox, .half_x_mm = 5.0, .half_y_mm = 3.0, .rim_mm = 0.6, .yaw_rad = 0.2},
    {.kind = ShapeKind::kBox, .half_x_mm = 5.0, .half_y_mm = 3.0, .rim_mm = 0.6, .tilt_rad = -0.05},
    {.kind = ShapeKind::kEdge, .radius_mm = 1.0, .yaw_rad = 0.7},
    {.kind = ShapeKind::kSphere,
     .radius_mm = 15.0,
     .texture = TextureKind::kRidges,
     .texture_height_mm = 0.1,
     .texture_pitch_mm = 2.0},
    {.kind = ShapeKind::kEllipsoid,
     .radius_mm = 20.0,
     .radius_y_mm = 15.0,
     .texture = TextureKind::kBumps,
     .texture_height_mm = 0.15,
     .texture_pitch_mm = 2.2},
};
constexpr Shape kBall{};

Pose pressed(Vec2 at_mm = {0.7, -0.4}, double turn_rad = 0.5) {
  return {.at_mm = at_mm, .turn_rad = turn_rad, .depth_mm = 0.6, .radius_mm = 3.0};
}

double height_below(const Shape& shape, const Pose& press, Vec2 at) {
  const Vec2 from = at - press.at_mm;
  const double c = std::cos(press.turn_rad);
  const double s = std::sin(press.turn_rad);
  return height_mm(shape, {c * from.x + s * from.y, c * from.y - s * from.x});
}

template <typename Visit>
void for_each_place(double half_mm, double step_mm, const Pose& press, Visit visit) {
  for (double y = -half_mm; y < half_mm; y += step_mm) {
    for (double x = -half_mm; x < half_mm; x += step_mm) visit(press.at_mm + Vec2{x, y});
  }
}

// The relief alone: a ball adds nothing else, and within 10 mm this contact has all of it.
struct Probe {
  Underside underside;
  Pose press{.depth_mm = 1.0, .radius_mm = 20.0};

  explicit Probe(const Relief& relief, std::uint64_t seed = 1, double lens_mm = 0.0)
      : underside(kBall, relief, seed, lens_mm) {}
  [[nodiscard]] Surface at(Vec2 place) const { return underside.surface(press, place); }
};

struct Spread {
  double rms = 0.0, x = 0.0, y = 0.0, up = 0.0, down = 0.0;  // of heights; of slopes along four directions
};

Spread spread(const Probe& probe) {
  Spread sum;
  int n = 0;
  for_each_place(10.0, 0.083, probe.press, [&](Vec2 at) {
    const Surface s = probe.at(at);
    sum.rms += s.rise_mm * s.rise_mm;
    sum.x += s.slope.x * s.slope.x;
    sum.y += s.slope.y * s.slope.y;
    sum.up += 0.5 * (s.slope.x + s.slope.y) * (s.slope.x + s.slope.y);
    sum.down += 0.5 * (s.slope.x - s.slope.y) * (s.slope.x - s.slope.y);
    ++n;
  });
  for (double* value : {&sum.rms, &sum.x, &sum.y, &sum.up, &sum.down}) *value = std::sqrt(*value / n);
  return sum;
}

double skin(double pitch_mm) {
  return pitch_mm * pitch_mm / (pitch_mm * pitch_mm + 0.0625);
}

}  // namespace

TEST_GROUP(Underside){};

TEST(Underside, InContactTheGelIsWhereTheObjectIs) {
  for (const Shape& shape : kShapes) {
    const Underside underside(shape, {}, 1);
    CHECK_FALSE(underside.round());
    const Pose press = pressed();
    const double level = std::clamp(underside.level_mm(pi * 9.0), 0.1 * 0.6, 2.0 * 0.6);
    int inside = 0;
    for_each_place(8.0, 0.37, press, [&](Vec2 at) {
      const double height = height_below(shape, press, at);
      const double rise = underside.surface(press, at).rise_mm;
      if (height < level) {
        DOUBLES_EQUAL(height, rise, 2e-6);  // floats of some tenths of a millimetre
        ++inside;
      } else {
        CHECK(rise > level - 1e-6 && rise < height + 1e-6);  // the gel is below the object, where it has let go
      }
    });
    CHECK(inside > 100);
  }
}

TEST(Underside, TheContactHasTheAreaThatTheModelSays) {
  for (const Shape& shape : kShapes) {
    const Underside underside(shape, {}, 1);
    for (const double area : {15.0, 28.0}) {
      const double level = underside.level_mm(area);
      int below = 0;
      // The pad as it lies under an object at rest: a line contact ends with it.
      for (double y = -10.375; y < 10.375; y += 0.05) {
        for (double x = -12.625; x < 12.625; x += 0.05) below += height_mm(shape, {x, y}) <= level ? 1 : 0;
      }
      // The flat part of a flat is all at one height: its contact is no smaller.
      const bool flat = shape.kind == ShapeKind::kDisc || shape.kind == ShapeKind::kBox;
      if (flat && below * 0.0025 > area) continue;
      DOUBLES_EQUAL(area, below * 0.0025, 0.03 * area);  // cells of 0.1 mm, and steps of 0.25 mm^2
    }
  }
}

TEST(Underside, SlopesAreTheSurfaces) {
  const std::vector<Relief> reliefs{
      {}, {ReliefKind::kRidges, 40.0, 0.9}, {ReliefKind::kBumps, 40.0, 0.9}, {ReliefKind::kGrain, 40.0, 0.9}};
  constexpr double kStep_mm = 1e-3;
  std::vector<Shape> shapes = kShapes;
  shapes.push_back(kBall);
  for (const Shape& shape : shapes) {
    for (const Relief& relief : reliefs) {
      const Underside underside(shape, relief, 3);
      const Pose press = pressed();
      int checked = 0;
      int kinks = 0;
      for_each_place(8.0, 0.219, press, [&](Vec2 at) {
        const Surface s = underside.surface(press, at);
        const auto along = [&](Vec2 way) {
          const Surface a = underside.surface(press, at - way);
          const Surface b = underside.surface(press, at + way);
          if (length(b.slope - a.slope) > 0.01) {  // a tip, or the mitre of a box
            ++kinks;
            return;
          }
          // Where gel or relief let go the curvature jumps: by a quarter of what the slope changes at most. Elsewhere
          // 40 um (2 pi / 0.9)^3 step^2 / 6: 2e-6; a float's last bits over 2 um: 3e-4.
          DOUBLES_EQUAL((b.rise_mm - a.rise_mm) / (2.0 * kStep_mm), dot(s.slope, way) / kStep_mm,
                        4e-4 + 0.25 * length(b.slope - a.slope));
          ++checked;
        };
        along({kStep_mm, 0.0});
        along({0.0, kStep_mm});
      });
      CHECK(checked > 40 * kinks);
    }
  }
}

TEST(Underside, AParaboloidLetsGoOfTheGelUpToTwiceTheRadius) {
  // R = 15 mm in a half-space: depth a^2 / R.
  const Underside bowl({.kind = ShapeKind::kEllipsoid, .radius_mm = 15.0, .radius_y_mm = 15.0}, {}, 1);
  const double a = 3.0;
  const Pose press{.depth_mm = a * a / 15.0, .radius_mm = a};
  for (const double r : {0.5, 1.5, 2.9}) {
    DOUBLES_EQUAL(r / 15.0, bowl.surface(press, {r, 0.0}).slope.x, 1e-5);
    DOUBLES_EQUAL(r / 15.0, bowl.surface(press, {0.0, -r}).slope.y * -1.0, 1e-5);
  }
  CHECK(bowl.surface(press, {3.5, 0.0}).slope.x < a / 15.0);
  CHECK(bowl.surface(press, {5.8, 0.0}).slope.x > 0.0);
  DOUBLES_EQUAL(0.0, bowl.surface(press, {6.2, 0.0}).slope.x, 0.0);
  // Back at rest: the depth above its lowest point, to the 1 % of the level's table.
  DOUBLES_EQUAL(press.depth_mm, bowl.surface(press, {8.0, 0.0}).rise_mm, 0.01 * press.depth_mm);
  // Harder pressed, deeper and wider.
  const Pose harder{.depth_mm = 1.2 * press.depth_mm, .radius_mm = std::sqrt(1.2) * a};
  CHECK(bowl.surface(harder, {6.2, 0.0}).slope.x > 0.0);
  CHECK(bowl.surface(harder, {3.5, 0.0}).slope.x > 1.05 * bowl.surface(press, {3.5, 0.0}).slope.x);
}

TEST(Underside, ReliefIsWholeInContactAndGoneBesideIt) {
  const Relief grain{ReliefKind::kGrain, 30.0, 0.5};
  const Underside ball(kBall, grain, 5);
  const Probe whole(grain, 5);
  const Pose press{.depth_mm = 0.6, .radius_mm = 3.0};
  for_each_place(5.0, 0.17, press, [&](Vec2 at) {
    const Surface here = ball.surface(press, at);
    const double r = length(at);
    // Fades from 0.7 to 1.3 of the radius squared.
    if (r < 3.0 * std::sqrt(0.7)) DOUBLES_EQUAL(whole.at(at).rise_mm, here.rise_mm, 1e-8);
    if (r > 3.0 * std::sqrt(1.3)) {
      DOUBLES_EQUAL(0.0, here.rise_mm, 0.0);
      CHECK(here.slope == Vec2{});
    }
    CHECK(std::abs(here.rise_mm) <= std::abs(whole.at(at).rise_mm) + 1e-9);
  });
  CHECK(ball.surface({.depth_mm = 0.6}, {0.1, 0.1}).slope == Vec2{});  // no contact
}

TEST(Underside, RidgesAndBumpsHaveTheirHeightAndPitch) {
  for (const double pitch : {0.25, 0.5, 1.5}) {
    const double height_mm = 0.04 * skin(pitch);
    const Probe ridges({ReliefKind::kRidges, 40.0, pitch});
    const Probe bumps({ReliefKind::kBumps, 40.0, pitch});
    // A series that errs by 4e-6; 12 periods in floats.
    for_each_place(3.0, 0.173, ridges.press, [&](Vec2 at) {
      const double x = -0.5 * std::cos(2.0 * pi * at.x / pitch);
      const double y = -0.5 * std::cos(2.0 * pi * at.y / pitch);
      DOUBLES_EQUAL(height_mm * x, ridges.at(at).rise_mm, 1.5e-5 * height_mm + 1e-7);
      DOUBLES_EQUAL(height_mm * 0.5 * (x + y), bumps.at(at).rise_mm, 1.5e-5 * height_mm + 1e-7);
    });
  }
  // The lens takes exp(-2 pi^2 s^2 / p^2): at s = p / 8 the gain of a Gaussian at one cycle in eight sigmas.
  const Probe sharp({ReliefKind::kRidges, 40.0, 0.8});
  const Probe blurred({ReliefKind::kRidges, 40.0, 0.8}, 1, 0.1);
  DOUBLES_EQUAL(std::exp(-pi * pi / 32.0) * sharp.at({0.4, 0.0}).rise_mm, blurred.at({0.4, 0.0}).rise_mm, 1e-7);
}

TEST(Underside, GrainHasItsHeightAndPitchFromAllSides) {
  for (const double pitch : {0.5, 1.0}) {
    double rms = 0.0;
    Spread mean;
    constexpr int kSeeds = 4;
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const Spread s = spread(Probe({ReliefKind::kGrain, 40.0, pitch}, seed));
      rms += s.rms / kSeeds;
      mean.x += s.x / kSeeds;
      mean.y += s.y / kSeeds;
      mean.up += s.up / kSeeds;
      mean.down += s.down / kSeeds;
    }
    // 4 x 400 mm^2 hold 1600 independent places at a pitch of 1 mm: 2.5 %, twice over.
    DOUBLES_EQUAL(0.01 * skin(pitch), rms, 0.05 * 0.01 * skin(pitch));
    const double slope = std::sqrt(mean.x * mean.x + mean.y * mean.y);
    DOUBLES_EQUAL(1.0 / pitch, slope / (2.0 * pi * rms), 0.03 / pitch);
    for (const double one : {mean.x, mean.y, mean.up, mean.down}) {
      DOUBLES_EQUAL(slope / std::numbers::sqrt2, one, 0.04 * one);
    }
  }
}

TEST(Underside, NothingToSeeIsSaidSo) {
  CHECK(Underside(kBall, {}, 1).plain());
  CHECK(Underside(kBall, {ReliefKind::kGrain, 0.0, 0.7}, 1).plain());
  CHECK(Underside(kBall, {ReliefKind::kNone, 40.0, 0.7}, 1).plain());
  const Underside ball(kBall, {ReliefKind::kGrain, 40.0, 0.7}, 1);
  CHECK(ball.round() && !ball.plain());
  CHECK_FALSE(Underside(kShapes[0], {}, 1).plain());
}
