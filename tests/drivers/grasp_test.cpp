// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/grasp.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;

namespace {

GraspTruth frame(const GraspConfig& config, int k) {
  return at(config, k / config.fps);
}

double largest_mm(const std::vector<MarkerTruth>& markers) {
  double largest = 0.0;
  for (const MarkerTruth& m : markers) {
    largest = std::max(largest, std::hypot(m.displacement_mm.x, m.displacement_mm.y));
  }
  return largest;
}

}  // namespace

TEST_GROUP(Grasp){};

TEST(Grasp, PhasesFollowEachOtherAndBeginAndEndEmpty) {
  const GraspConfig config;
  int phase = 0;
  int changes = 0;
  // The last phase, empty again, wraps to the first.
  const Phase order[] = {Phase::kEmpty, Phase::kPress,   Phase::kHold, Phase::kShear,
                         Phase::kSlide, Phase::kRelease, Phase::kEmpty};
  for (int k = 0; k < frame_count(config); ++k) {
    const GraspTruth truth = frame(config, k);
    if (truth.phase != order[phase]) {
      ++phase;
      ++changes;
      CHECK(truth.phase == order[phase]);
    }
    if (truth.phase == Phase::kEmpty) {
      DOUBLES_EQUAL(0.0, truth.normal_n, 0.0);
      DOUBLES_EQUAL(0.0, truth.contact_radius_mm, 0.0);
      DOUBLES_EQUAL(0.0, largest_mm(markers_at(config, truth, {})), 0.0);
    } else {
      CHECK(truth.normal_n >= 0.0 && truth.normal_n <= config.press_n);
    }
  }
  LONGS_EQUAL(6, changes);
  // 0.48 s at 25 fps.
  for (int k = 0; k < 12; ++k) CHECK(frame(config, k).phase == Phase::kEmpty);
  CHECK(frame(config, 12).phase == Phase::kPress);
  CHECK(at(config, -1.0).phase == Phase::kEmpty);
  CHECK(at(config, 1e9).phase == Phase::kEmpty);
}

TEST(Grasp, SlipGrowsFromAnnulusOverHalfToGross) {
  const GraspConfig config;
  const double annulus = *onset_s(config, SlipLevel::kAnnulus);
  const double half = *onset_s(config, SlipLevel::kHalf);
  const double gross = *onset_s(config, SlipLevel::kGross);
  CHECK(annulus < half);
  CHECK(half < gross);
  // A microsecond on either side; labels are made from frames 40 ms apart.
  constexpr double kStep = 1e-6;
  CHECK(slip_level(at(config, annulus - kStep)) == SlipLevel::kNone);
  CHECK(slip_level(at(config, annulus + kStep)) == SlipLevel::kAnnulus);
  CHECK(slip_level(at(config, half - kStep)) == SlipLevel::kAnnulus);
  CHECK(slip_level(at(config, half + kStep)) == SlipLevel::kHalf);
  CHECK(slip_level(at(config, gross - kStep)) == SlipLevel::kHalf);
  CHECK(slip_level(at(config, gross + kStep)) == SlipLevel::kGross);

  // Half means half of the area still sticks; gross comes when the object has gone delta_gross.
  const GraspTruth halfway = at(config, half);
  DOUBLES_EQUAL(0.5 * halfway.contact_radius_mm * halfway.contact_radius_mm,
                halfway.stick_radius_mm * halfway.stick_radius_mm, 1e-9);
  DOUBLES_EQUAL(at(config, gross).displacement_mm / config.speed_mm_s, gross - annulus, 1e-9);

  double fraction = 0.0;
  for (int k = 0; frame(config, k).phase != Phase::kRelease; ++k) {
    const GraspTruth truth = frame(config, k);
    CHECK(truth.slip_fraction >= fraction);
    fraction = truth.slip_fraction;
    CHECK_EQUAL(truth.gross, fraction == 1.0);
  }
  DOUBLES_EQUAL(1.0, fraction, 0.0);
}

TEST(Grasp, SlidingObjectTravelsAtItsSpeed) {
  const GraspConfig config;
  const double start = *onset_s(config, SlipLevel::kGross);
  DOUBLES_EQUAL(0.0, at(config, start).travel_mm, 1e-9);
  for (const double later : {0.1, 0.5, 1.1}) {
    const GraspTruth truth = at(config, start + later);
    DOUBLES_EQUAL(later * config.speed_mm_s, truth.travel_mm, 1e-9);  // mm
    DOUBLES_EQUAL(config.friction * config.press_n, truth.shear_n, 1e-12);
    // The imprint is carried by the gel and by the slip.
    const double way =
        std::hypot(truth.contact_center_mm.x - config.touch_mm.x, truth.contact_center_mm.y - config.touch_mm.y);
    DOUBLES_EQUAL(truth.displacement_mm + truth.travel_mm, way, 1e-12);
  }
  // Before gross slip the object moves with the gel, whatever slips at the rim.
  DOUBLES_EQUAL(0.0, at(config, start - 0.05).travel_mm, 0.0);
  CHECK(at(config, start - 0.05).slip_fraction > 0.9);
}

TEST(Grasp, LoadsAndMotionHaveNoJumps) {
  for (const GraspConfig& config : {GraspConfig{}, without_slip({}), shaken({})}) {
    // Contact ends when the force does; its radius goes as the cube root of the force.
    constexpr double kStep = 1e-4;
    GraspTruth before = at(config, 0.0);
    for (double t = kStep; t < duration_s(config); t += kStep) {
      const GraspTruth now = at(config, t);
      CHECK(std::abs(now.normal_n - before.normal_n) < 1e-3);  // 7.5 N/s
      CHECK(std::abs(now.shear_n - before.shear_n) < 3e-3);    // 19 N/s in the shake
      CHECK(std::abs(now.displacement_mm - before.displacement_mm) < 5e-3);
      before = now;
    }
  }
}

TEST(Grasp, MatchedPairHasTheSameForcesAndNoSlip) {
  const GraspConfig slips;
  const GraspConfig holds = without_slip(slips);
  LONGS_EQUAL(frame_count(slips), frame_count(holds));
  int gross = 0;
  for (int k = 0; k < frame_count(slips); ++k) {
    const GraspTruth a = frame(slips, k);
    const GraspTruth b = frame(holds, k);
    DOUBLES_EQUAL(a.normal_n, b.normal_n, 0.0);
    DOUBLES_EQUAL(a.shear_n, b.shear_n, 0.0);
    DOUBLES_EQUAL(a.contact_radius_mm, b.contact_radius_mm, 0.0);
    DOUBLES_EQUAL(0.0, b.slip_fraction, 0.0);
    DOUBLES_EQUAL(0.0, b.travel_mm, 0.0);
    CHECK(slip_level(b) == SlipLevel::kNone);
    gross += a.gross ? 1 : 0;
  }
  CHECK(gross > 25);
  CHECK_FALSE(onset_s(holds, SlipLevel::kAnnulus).has_value());
}

TEST(Grasp, ShakeGoesBackAndForthWithoutSlip) {
  const GraspConfig config = shaken({});
  double largest = 0.0;
  int crossings = 0;
  double before = 0.0;
  double first_s = -1.0;
  double last_s = 0.0;
  constexpr double kStep = 1e-3;
  for (double t = 0.0; t < duration_s(config); t += kStep) {
    const GraspTruth truth = at(config, t);
    CHECK(slip_level(truth) == SlipLevel::kNone);
    if (truth.phase != Phase::kShake) continue;
    if (before * truth.shear_n < 0.0) {
      ++crossings;
      if (first_s < 0.0) first_s = t;
      last_s = t;
    }
    if (truth.shear_n != 0.0) before = truth.shear_n;
    largest = std::max(largest, std::abs(truth.shear_n));
  }
  DOUBLES_EQUAL(config.shake_load * config.friction * config.press_n, largest, 1e-3);
  CHECK(crossings >= 8);
  // Two crossings per period, seen to one step at either end.
  DOUBLES_EQUAL(config.shake_hz, (crossings - 1) / (2.0 * (last_s - first_s)), 0.01);
}

TEST(Grasp, MarkersMoveAsFarAsOnARealSensor) {
  const GraspConfig config;
  double largest = 0.0;
  for (int k = 0; k < frame_count(config); ++k) {
    largest = std::max(largest, largest_mm(markers_at(config, frame(config, k), {})));
  }
  CHECK(largest > 0.5);
  CHECK(largest < 1.2);
  // A press alone spreads the markers, by about a pixel of 320 (0.063 mm).
  const GraspTruth hold = at(config, 1.3);
  CHECK(hold.phase == Phase::kHold);
  const double press = largest_mm(markers_at(config, hold, {}));
  CHECK(press > 0.04);
  CHECK(press < 0.10);
}

TEST(Grasp, MarkersInTheStickDiscMoveWithTheObject) {
  GraspConfig config;
  config.press_dilation = 0.0;
  const double angle = config.direction_deg * std::numbers::pi / 180.0;
  const GraspTruth truth = at(config, *onset_s(config, SlipLevel::kHalf));
  int stuck = 0;
  for (const MarkerTruth& m : markers_at(config, truth, {})) {
    const double r = std::hypot(m.rest_mm.x - config.touch_mm.x, m.rest_mm.y - config.touch_mm.y);
    const double ahead = m.displacement_mm.x * std::cos(angle) + m.displacement_mm.y * std::sin(angle);
    if (r < truth.stick_radius_mm) {
      ++stuck;
      DOUBLES_EQUAL(truth.displacement_mm, ahead, 1e-12);
      DOUBLES_EQUAL(truth.displacement_mm * std::sin(angle), m.displacement_mm.y, 1e-12);
    } else {
      CHECK(ahead < truth.displacement_mm);
    }
  }
  CHECK(stuck >= 4);
}

TEST(Grasp, FieldTurnsWithTheDirectionAndTravelsWithTheObject) {
  GraspConfig right;
  right.touch_mm = {};
  right.direction_deg = 0.0;
  GraspConfig down = right;
  down.direction_deg = 90.0;
  const MarkerGrid square{7, 7, 2.0};
  const double t = *onset_s(right, SlipLevel::kGross);
  const auto a = markers_at(right, at(right, t), square);
  const auto b = markers_at(down, at(down, t), square);
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 7; ++col) {
      // A quarter turn takes (x, y) to (-y, x).
      const Vec2 u = a[static_cast<std::size_t>(row * 7 + col)].displacement_mm;
      const Vec2 v = b[static_cast<std::size_t>(col * 7 + (6 - row))].displacement_mm;
      DOUBLES_EQUAL(-u.y, v.x, 1e-12);
      DOUBLES_EQUAL(u.x, v.y, 1e-12);
    }
  }
  // After one pitch of travel every marker does what its left neighbour did.
  right.slide_s = 3.0;
  const auto later = markers_at(right, at(right, t + 2.0 / right.speed_mm_s), square);
  for (int i = 0; i < 49; ++i) {
    if (i % 7 == 0) continue;
    const std::size_t k = static_cast<std::size_t>(i);
    DOUBLES_EQUAL(a[k - 1].displacement_mm.x, later[k].displacement_mm.x, 1e-9);
    DOUBLES_EQUAL(a[k - 1].displacement_mm.y, later[k].displacement_mm.y, 1e-9);
  }
}

TEST(Grasp, LimitsStayFinite) {
  GraspConfig slippery;
  slippery.friction = 0.0;
  GraspConfig air;
  air.press_n = 0.0;
  GraspConfig sudden;
  sudden.press_s = sudden.release_s = sudden.hold_s = 0.0;
  CHECK_FALSE(onset_s(air, SlipLevel::kAnnulus).has_value());
  for (const GraspConfig& base : {slippery, air, sudden}) {
    for (const GraspConfig& config : {base, without_slip(base), shaken(base)}) {
      for (int k = 0; k < frame_count(config); ++k) {
        const GraspTruth truth = frame(config, k);
        CHECK(std::isfinite(truth.normal_n));
        CHECK(std::isfinite(truth.shear_n));
        CHECK(std::isfinite(truth.contact_center_mm.x));
        CHECK(std::isfinite(largest_mm(markers_at(config, truth, {}))));
      }
    }
  }
}
