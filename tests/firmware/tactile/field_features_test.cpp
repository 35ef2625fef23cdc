// SPDX-License-Identifier: Apache-2.0
// Oracle: the formulas of the header in double, by a different way (2x2 least squares instead of moments), and fields
// whose answers are known.
#include "tactile/field_features.hpp"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

constexpr GridSize kGrid{7, 9};
constexpr double kPitch_um = 2020.0;

struct Vec {
  double x = 0.0;
  double y = 0.0;
};

Vec place(int i) {
  const int row = i / 9;
  return {(i % 9 - 4) * kPitch_um, (row - 3) * kPitch_um};
}

template <typename At>
DisplacementField field_of(At at) {
  DisplacementField field;
  field.grid = kGrid;
  for (int i = 0; i < kGrid.count(); ++i) {
    const Vec d = at(place(i));
    field.markers[idx(i)] = {Micrometres::from_raw(static_cast<int>(std::lround(d.x))),
                             Micrometres::from_raw(static_cast<int>(std::lround(d.y))), true};
  }
  return field;
}

struct Reference {
  double shift = 0.0, spread = 0.0, residual = 0.0, evenness = 0.0, dilation = 0.0;
};

// Least squares for (mx, my, w) by normal equations over what is valid, solved by elimination.
Reference reference_of(const DisplacementField& field) {
  double n = 0, sx = 0, sy = 0, gx = 0, gy = 0;
  std::vector<std::pair<Vec, Vec>> rows;
  for (int i = 0; i < kGrid.count(); ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    if (!d.valid) continue;
    rows.push_back({place(i), {double(d.dx.raw()), double(d.dy.raw())}});
    n += 1;
    sx += d.dx.raw();
    sy += d.dy.raw();
    gx += place(i).x;
    gy += place(i).y;
  }
  double num = 0, opening = 0, den = 0, lengths = 0, squares = 0;
  for (const auto& [g, d] : rows) {
    const Vec c{g.x - gx / n, g.y - gy / n};
    num += c.x * (d.y - sy / n) - c.y * (d.x - sx / n);
    opening += c.x * (d.x - sx / n) + c.y * (d.y - sy / n);
    den += c.x * c.x + c.y * c.y;
    lengths += std::hypot(d.x, d.y);
    squares += d.x * d.x + d.y * d.y;
  }
  const double w = num / den;
  Reference out;
  for (const auto& [g, d] : rows) {
    const Vec c{g.x - gx / n, g.y - gy / n};
    const Vec u{d.x - sx / n, d.y - sy / n};
    out.spread += (u.x * u.x + u.y * u.y) / n;
    out.residual += (std::pow(u.x + w * c.y, 2) + std::pow(u.y - w * c.x, 2)) / n;
  }
  out.spread = std::sqrt(out.spread);
  out.residual = std::sqrt(out.residual);
  out.shift = std::hypot(sx, sy) / n;
  out.evenness = squares > 0 ? lengths * lengths / (n * squares) : 0;
  out.dilation = opening / den * 1e6;
  return out;
}

double cosine_of(const DisplacementField& a, const DisplacementField& b) {
  double dot = 0, aa = 0, bb = 0;
  for (int i = 0; i < kGrid.count(); ++i) {
    const MarkerDisplacement& u = a.markers[idx(i)];
    const MarkerDisplacement& v = b.markers[idx(i)];
    if (!u.valid || !v.valid) continue;
    dot += double(u.dx.raw()) * v.dx.raw() + double(u.dy.raw()) * v.dy.raw();
    aa += std::pow(u.dx.raw(), 2) + std::pow(u.dy.raw(), 2);
    bb += std::pow(v.dx.raw(), 2) + std::pow(v.dy.raw(), 2);
  }
  return dot / std::sqrt(aa * bb);
}

DisplacementField random_field(std::mt19937& rng, double size_um, double lost) {
  std::normal_distribution<double> normal(0.0, size_um);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  DisplacementField field = field_of([&](Vec) { return Vec{normal(rng), normal(rng)}; });
  for (int i = 0; i < kGrid.count(); ++i) {
    if (uniform(rng) < lost) field.markers[idx(i)] = {};
  }
  return field;
}

struct Bench {
  field_features::State state;
  field_features::Config config;
  Saturations saturations;
  std::int64_t now_us = 1'000'000;

  FieldFeatures next(const DisplacementField& field, std::int64_t step_us = 40'000) {
    now_us += step_us;
    return field_features::update(state, config, field, Micros{now_us}, saturations);
  }
};

}  // namespace

TEST_GROUP(FieldFeatures){};

// Tolerances: a sixteenth of a micrometre for what is rounded to Q4 twice, and 0.1 % for sums of rounded terms.
// Evenness sums lengths cut off at 1/16 um: 6 % of one micrometre.
TEST(FieldFeatures, shape_is_that_of_double) {
  std::mt19937 rng(7);
  for (int round = 0; round < 300; ++round) {
    const DisplacementField field = random_field(rng, std::exp(rng() % 9), (round % 4) * 0.2);
    const Reference want = reference_of(field);
    Bench bench;
    const FieldFeatures got = bench.next(field);
    DOUBLES_EQUAL(want.shift, got.shift.raw(), 0.6);
    DOUBLES_EQUAL(want.residual, got.residual.raw() / 16.0, 0.15 + 1e-3 * want.residual);
    DOUBLES_EQUAL(want.evenness, got.evenness.raw() / 1024.0, 2.0 / 1024 + 0.1 / (1.0 + want.spread));
    DOUBLES_EQUAL(std::log2((want.residual + 2) / (want.shift + 2)), got.unevenness.raw() / 256.0, 0.06);
  }
}

TEST(FieldFeatures, flow_is_the_difference_over_the_lag) {
  std::mt19937 rng(8);
  for (int round = 0; round < 100; ++round) {
    Bench bench;
    const DisplacementField first = random_field(rng, 300, 0.1);
    const DisplacementField last = random_field(rng, 300, 0.1);
    (void)bench.next(first);
    (void)bench.next(first);
    (void)bench.next(first);
    const FieldFeatures got = bench.next(last);  // 120 ms after the first
    DisplacementField flow;
    flow.grid = kGrid;
    for (int i = 0; i < kGrid.count(); ++i) {
      const auto& a = last.markers[idx(i)];
      const auto& b = first.markers[idx(i)];
      if (!a.valid || !b.valid) continue;
      flow.markers[idx(i)] = {Micrometres::from_raw(a.dx.raw() - b.dx.raw()),
                              Micrometres::from_raw(a.dy.raw() - b.dy.raw()), true};
    }
    const Reference want = reference_of(flow);
    DOUBLES_EQUAL(want.shift / 0.12, got.flow_shift.raw(), 2.0);
    DOUBLES_EQUAL(want.spread / 0.12, got.flow_spread.raw(), 2.0);
    DOUBLES_EQUAL(want.residual / 0.12, got.flow_residual.raw(), 2.0);
    DOUBLES_EQUAL(want.evenness, got.flow_evenness.raw() / 1024.0, 3.0 / 1024);
    DOUBLES_EQUAL(want.dilation / 0.12, got.dilation_rate.raw(), 10.0 + 1e-3 * std::abs(want.dilation));
    DOUBLES_EQUAL((reference_of(last).residual - reference_of(first).residual) / 0.12, got.residual_rate.raw(), 3.0);
    DOUBLES_EQUAL(cosine_of(flow, last), got.flow_along.raw() / 1024.0, 1.0 / 1024);
  }
}

// Whatever the clock shows by then.
TEST(FieldFeatures, there_is_no_flow_until_a_field_is_a_tenth_of_a_second_old) {
  std::mt19937 rng(9);
  Bench bench;
  for (const bool flows : {false, false, false, true}) {
    const FieldFeatures got = bench.next(random_field(rng, 300, 0.0));
    CHECK_EQUAL(flows, got.flow_evenness.raw() > 0);
    CHECK_EQUAL(flows, got.residual_rate.raw() != 0);
  }
}

TEST(FieldFeatures, a_rigid_motion_leaves_no_residual) {
  for (const double turn : {-0.05, 0.0, 0.002, 0.03}) {
    Bench bench;
    const FieldFeatures got = bench.next(field_of([&](Vec g) { return Vec{700 - turn * g.y, -300 + turn * g.x}; }));
    CHECK_TRUE(got.residual.raw() <= 10);  // rounding of D to micrometres is 0.41 um RMS
    DOUBLES_EQUAL(std::hypot(700, 300), got.shift.raw(), 0.6);
  }
}

TEST(FieldFeatures, an_even_shift_is_even_and_a_single_marker_is_not) {
  Bench bench;
  LONGS_EQUAL(1024, bench.next(field_of([](Vec) { return Vec{200, 0}; })).evenness.raw());
  Bench other;
  const FieldFeatures one = other.next(field_of([](Vec g) { return Vec{g.x == 0 && g.y == 0 ? 500.0 : 0.0, 0}; }));
  LONGS_EQUAL(1024 / 63, one.evenness.raw());
  LONGS_EQUAL(0, one.reach.raw());  // the third largest
}

// One factor on all displacements moves whole bins: between 8 um and 0.7 mm a factor of a power of two keeps E as it
// is.
TEST(FieldFeatures, octave_entropy_does_not_see_size) {
  const auto cone = [](double size) {
    return field_of([size](Vec g) { return Vec{size * (20.0 + 60.0 * std::exp(-std::hypot(g.x, g.y) / 4000.0)), 0}; });
  };
  Bench bench;
  const int at_one = bench.next(cone(1)).octave_entropy.raw();
  CHECK_TRUE(at_one > 50'000);
  Bench two, four;
  // Rounding to micrometres may move a marker that stands on an edge: one of 63 is 0.08 nat.
  DOUBLES_EQUAL(at_one, two.next(cone(2)).octave_entropy.raw(), 0.17 * 65536);
  DOUBLES_EQUAL(at_one, four.next(cone(4)).octave_entropy.raw(), 0.17 * 65536);
}

TEST(FieldFeatures, loading_goes_along_and_unloading_against) {
  Bench bench;
  FieldFeatures got;
  for (int k = 0; k < 10; ++k) got = bench.next(field_of([k](Vec) { return Vec{20.0 * k, 5.0 * k}; }));
  LONGS_EQUAL(1024, got.flow_along.raw());
  LONGS_EQUAL(1024, got.flow_steady.raw());
  for (int k = 9; k > 3; --k) got = bench.next(field_of([k](Vec) { return Vec{20.0 * k, 5.0 * k}; }));
  LONGS_EQUAL(-1024, got.flow_along.raw());
}

TEST(FieldFeatures, easing_keeps_the_largest_closing_and_fades) {
  Bench bench;
  for (int k = 0; k < 6; ++k) (void)bench.next(field_of([](Vec g) { return Vec{0.01 * g.x, 0.01 * g.y}; }));
  FieldFeatures got;
  for (int k = 0; k < 3; ++k) {
    got = bench.next(field_of([k](Vec g) { return Vec{(0.01 - 0.002 * k) * g.x, (0.01 - 0.002 * k) * g.y}; }));
  }
  // 4000 ppm in 120 ms; displacements are whole micrometres, 0.4 of 20 um here.
  DOUBLES_EQUAL(-33'333, got.dilation_rate.raw(), 1000);
  LONGS_EQUAL(-got.dilation_rate.raw(), got.easing.raw());
  const int top = got.easing.raw();
  for (int k = 0; k < 10; ++k) got = bench.next(field_of([](Vec g) { return Vec{0.006 * g.x, 0.006 * g.y}; }));
  CHECK_TRUE(got.easing.raw() > 0 && got.easing.raw() < top / 2);
}

TEST(FieldFeatures, a_gap_and_a_clock_that_runs_back_begin_anew) {
  for (const std::int64_t step : {300'000, -100'000}) {
    Bench bench;
    for (int k = 0; k < 8; ++k) (void)bench.next(field_of([k](Vec) { return Vec{20.0 * k, 0}; }));
    const FieldFeatures got = bench.next(field_of([](Vec) { return Vec{500.0, 0}; }), step);
    LONGS_EQUAL(0, got.flow_spread.raw());
    LONGS_EQUAL(0, got.flow_along.raw());
    LONGS_EQUAL(500, got.shift.raw());
  }
}

// 10 to 240 frames a second: the same steady shear gives the same speeds.
TEST(FieldFeatures, frame_rate_does_not_change_the_flow) {
  for (const double fps : {10.0, 15.0, 18.75, 25.0, 60.0, 240.0}) {
    Bench bench;
    const auto step_us = static_cast<std::int64_t>(1e6 / fps);
    FieldFeatures got;
    for (int k = 0; k * step_us < 1'000'000; ++k) {
      const double t = static_cast<double>(k * step_us) * 1e-6;
      got = bench.next(field_of([t](Vec g) {
                         return Vec{3000.0 * t * std::exp(-std::hypot(g.x, g.y) / 4e3), 0};
                       }),
                       step_us);
    }
    const Reference want = reference_of(field_of([](Vec g) {
      return Vec{3000.0 * std::exp(-std::hypot(g.x, g.y) / 4e3), 0};
    }));
    DOUBLES_EQUAL(want.spread, got.flow_spread.raw(), 6.0);
    CHECK_TRUE(got.flow_steady.raw() > 1000);
  }
}

// Extremes: the largest displacements there are, both signs, on every grid, with none, one and all markers: no
// overflow (the sanitizer build looks), every value in its range.
TEST(FieldFeatures, extremes_stay_in_range) {
  for (const GridSize grid : {GridSize{3, 3}, GridSize{7, 9}, GridSize{8, 16}}) {
    for (const int lost_every : {0, 1, 2}) {
      Bench bench;
      bench.config.pitch_um = 1000;
      for (int k = 0; k < 12; ++k) {
        DisplacementField field;
        field.grid = grid;
        for (int i = 0; i < grid.count(); ++i) {
          const int side = (i + k) % 2 == 0 ? 1 : -1;
          field.markers[idx(i)] = {Micrometres::from_raw(side * 65535), Micrometres::from_raw(-side * 65535),
                                   lost_every == 0 || (lost_every == 1 ? i == 0 : i % 2 == 0)};
        }
        const FieldFeatures got = bench.next(field);
        CHECK_TRUE(got.evenness.raw() >= 0 && got.evenness.raw() <= 1024);
        CHECK_TRUE(got.residual.raw() <= MicrometresQ4::kMax);
      }
    }
  }
  Bench empty;
  DisplacementField none;
  none.grid = kGrid;
  for (int k = 0; k < 8; ++k) {
    const FieldFeatures got = empty.next(none);
    LONGS_EQUAL(0, got.shift.raw());
    LONGS_EQUAL(0, got.octave_entropy.raw());
    LONGS_EQUAL(0, got.flow_spread.raw());
  }
}

TEST(FieldFeatures, log2_is_that_of_double_rounded_down) {
  for (std::uint64_t value = 1; value < 5000; ++value) {
    const double want = std::floor(std::log2(static_cast<double>(value)) * 256.0 + 1e-9);
    CHECK_TRUE(std::abs(want - log2_q8(value)) <= 1.0);
  }
  LONGS_EQUAL(63 * 256, log2_q8(std::uint64_t{1} << 63));
  LONGS_EQUAL(63 * 256 + 255, log2_q8(UINT64_MAX));
  LONGS_EQUAL(0, log2_q8(1));
}
