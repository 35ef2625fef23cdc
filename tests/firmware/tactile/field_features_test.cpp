// SPDX-License-Identifier: Apache-2.0
// Oracle: the formulas of the header in double, and fields whose answers are known.
#include "tactile/field_features.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/draw.hpp"
#include "tests/support/reference.hpp"

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

// --- Definitions; in um unless a name says otherwise ---

using Field = std::vector<std::optional<Vec>>;

Field in_double(const DisplacementField& field) {
  Field out(idx(field.grid.count()));
  for (std::size_t i = 0; i < out.size(); ++i) {
    const MarkerDisplacement& d = field.markers[i];
    if (d.valid) out[i] = Vec{double(d.dx.raw()), double(d.dy.raw())};
  }
  return out;
}

Field difference(const Field& now, const Field& before) {
  Field out(now.size());
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (now[i] && before[i]) out[i] = Vec{now[i]->x - before[i]->x, now[i]->y - before[i]->y};
  }
  return out;
}

struct Shape {
  double n = 0;
  double shift = 0, reach = 0, spread = 0, residual = 0;
  double dilation = 0;              // per half pitch, of um
  double turn = 0;                  // um per half pitch
  double lengths = 0, squares = 0;  // sums
  std::array<int, kHistogramBins> octaves{};
};

Shape shape_of(GridSize grid, const Field& field) {
  struct Row {
    double gx, gy, dx, dy;  // places in half pitches
  };
  std::vector<Row> rows;
  std::vector<double> lengths;
  Shape out;
  for (int i = 0; i < grid.count(); ++i) {
    const std::optional<Vec>& d = field[idx(i)];
    if (!d) continue;
    const int row = i / grid.cols, col = i % grid.cols;
    rows.push_back({2.0 * col, 2.0 * row, d->x, d->y});
    const double length = std::hypot(d->x, d->y);
    const double octave = length < 8.0 ? 0.0 : 1.0 + std::floor(2.0 * std::log2(length / 8.0) + 1e-12);
    ++out.octaves[static_cast<std::size_t>(std::min(octave, kHistogramBins - 1.0))];
    out.lengths += length;
    out.squares += length * length;
    lengths.push_back(length);
  }
  if (rows.empty()) return out;
  out.n = static_cast<double>(rows.size());
  Row mean{};
  for (const Row& row : rows) {
    mean = {mean.gx + row.gx / out.n, mean.gy + row.gy / out.n, mean.dx + row.dx / out.n, mean.dy + row.dy / out.n};
  }
  double twist = 0, opening = 0, arm = 0;
  for (Row& row : rows) {
    row = {row.gx - mean.gx, row.gy - mean.gy, row.dx - mean.dx, row.dy - mean.dy};
    twist += row.gx * row.dy - row.gy * row.dx;
    opening += row.gx * row.dx + row.gy * row.dy;
    arm += row.gx * row.gx + row.gy * row.gy;
  }
  if (rows.size() > 1) {
    out.turn = twist / arm;
    out.dilation = opening / arm;
  }
  double spread = 0, residual = 0;
  for (const Row& row : rows) {
    spread += (row.dx * row.dx + row.dy * row.dy) / out.n;
    residual += (std::pow(row.dx + out.turn * row.gy, 2) + std::pow(row.dy - out.turn * row.gx, 2)) / out.n;
  }
  out.spread = std::sqrt(spread);
  out.residual = std::sqrt(residual);
  out.shift = std::hypot(mean.dx, mean.dy);
  std::sort(lengths.rbegin(), lengths.rend());
  if (lengths.size() > 2) out.reach = lengths[2];
  return out;
}

// --- Bounds, in LSB of the result's format ---

// 1e-6 LSB: what double itself may be off.
void within(const char* what, double want, std::int32_t got, double below, double above) {
  if (got >= want - below - 1e-6 && got <= want + above + 1e-6) return;
  FAIL(StringFromFormat("%s: want %.9g -%.9g +%.9g, got %d", what, want, below, above, int{got}).asCharString());
}
void within(const char* what, double want, std::int32_t got, double bound) {
  within(what, want, got, bound, bound);
}

// Roots of D are cut at 1/16 um each, so the sum is short by up to n/16; the quotient is cut as well.
void check_evenness(const char* what, const Shape& shape, ShareQ10 got) {
  if (shape.squares == 0.0) {
    within(what, 1024.0, got.raw(), 0.0);
    return;
  }
  const double want = 1024.0 * shape.lengths * shape.lengths / (shape.n * shape.squares);
  const double left = std::max(1.0 - shape.n / (16.0 * shape.lengths), 0.0);
  within(what, want, got.raw(), want * (1.0 - left * left) + 1.0, 0.0);
}

// Of a residual in 1/16 um. Each marker's vector from the best rotation is off, in both axes, by 1/2 of the rounded
// mean, 1 of the shift's floor, turn / 2 of the rounded centre and |g| / 32 of the rounded turn: with |g| <= 254 half
// pitches. The root of the mean square is off by no more than the largest of those (triangle inequality), and cut off
// once.
double residual_bound_q4(GridSize grid, const Shape& shape) {
  const double reach = 2.0 * std::max(grid.cols, grid.rows);
  return shape.n > 0 ? 1.0 + std::sqrt(2.0) * (1.5 + std::abs(shape.turn) / 2.0 + reach / 32.0) : 0.0;
}

// Of one, in 1/16 um: the root of the sums is cut before it is divided by n, the mean rounded.
double shift_bound_q4(const Shape& shape) {
  return 0.5 + 1.0 / std::max(shape.n, 1.0);
}

// Norms are cut at 1/16 um, which makes the quotient larger by that share.
void check_cosine(const char* what, const Field& a, const Field& b, ShareQ10 got) {
  double dot = 0, aa = 0, bb = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!a[i] || !b[i]) continue;
    dot += a[i]->x * b[i]->x + a[i]->y * b[i]->y;
    aa += a[i]->x * a[i]->x + a[i]->y * a[i]->y;
    bb += b[i]->x * b[i]->x + b[i]->y * b[i]->y;
  }
  if (aa == 0.0 || bb == 0.0) {
    within(what, 0.0, got.raw(), 0.0);
    return;
  }
  const double want = 1024.0 * dot / std::sqrt(aa * bb);
  const double more = 1.0 / ((1.0 - 1.0 / (16.0 * std::sqrt(aa))) * (1.0 - 1.0 / (16.0 * std::sqrt(bb)))) - 1.0;
  within(what, want, got.raw(), 0.5 + std::abs(want) * more);
}

template <typename Unit>
double held(double value) {
  return std::clamp<double>(value, Unit::kMin, Unit::kMax);
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

TEST(FieldFeatures, shape_and_flow_are_those_of_double) {
  test::Draw draw(7);
  for (int round = 0; round < 1000; ++round) {
    const GridSize grid = draw.grid();
    Bench bench;
    bench.config.pitch_um = draw.of32(1'000, 5'000);
    struct Past {
      std::int64_t at_us;
      Field field;
      double residual, residual_q4;
    };
    std::vector<Past> kept;
    double easing = 0.0, easing_below = 0.0;
    const auto lag_before = [&](std::int64_t than_us) -> const Past* {
      const auto at =
          std::find_if(kept.rbegin(), kept.rend(), [=](const Past& past) { return than_us - past.at_us >= 100'000; });
      return at == kept.rend() ? nullptr : &*at;
    };
    for (int frame = 0; frame < 7; ++frame) {
      const DisplacementField drawn = draw.field(grid);
      const std::int64_t step_us = draw.of(12'000, 120'000);
      const FieldFeatures got = bench.next(drawn, step_us);
      const Field field = in_double(drawn);
      const Shape shape = shape_of(grid, field);

      const double shift_q4 = shift_bound_q4(shape), residual_q4 = residual_bound_q4(grid, shape);
      within("shift", held<Micrometres>(shape.shift), got.shift.raw(), 0.5 + shift_q4 / 16.0);
      within("reach", held<Micrometres>(shape.reach), got.reach.raw(), 0.5 + 1.0 / 16.0);
      within("residual", shape.residual * 16.0, got.residual.raw(), residual_q4);
      // Two logarithms, each cut off; what comes in is off by its own bound.
      const auto log_off = [](double value, double bound) {
        return 256.0 * std::log2((value + bound) / std::max(value - bound, 32.0));
      };
      const double top = shape.residual * 16.0 + 32.0, bottom = shape.shift * 16.0 + 32.0;
      within("unevenness", 256.0 * std::log2(top / bottom), got.unevenness.raw(),
             1.0 + log_off(top, residual_q4) + log_off(bottom, shift_q4));
      check_evenness("evenness", shape, got.evenness);
      // 1.12 LSB of Q24: entropy_test.cpp.
      within("octave entropy", static_cast<double>(reference_model::entropy_long_double(shape.octaves)) * 65'536.0,
             got.octave_entropy.raw(), 0.5 + 1.12 / 256.0);

      // Each frame's fading is cut off once, and what was cut fades as well.
      const double fading = frame > 0 ? 300'000.0 / static_cast<double>(300'000 + step_us) : 1.0;
      easing *= fading;
      easing_below = easing_below * fading + 1.0;
      if (const Past* const earlier = lag_before(bench.now_us)) {
        const double lag_s = static_cast<double>(bench.now_us - earlier->at_us) * 1e-6;
        const double per_q4 = 1.0 / (16.0 * lag_s);
        const Field flow = difference(field, earlier->field);
        const Shape moved = shape_of(grid, flow);
        within("residual rate", (shape.residual - earlier->residual) / lag_s, got.residual_rate.raw(),
               0.5 + (residual_q4 + earlier->residual_q4) * per_q4);
        within("flow shift", moved.shift / lag_s, got.flow_shift.raw(), 0.5 + shift_bound_q4(moved) * per_q4);
        within("flow spread", moved.spread / lag_s, got.flow_spread.raw(), 0.5 + (1.0 + std::sqrt(0.5)) * per_q4);
        within("flow residual", moved.residual / lag_s, got.flow_residual.raw(),
               0.5 + residual_bound_q4(grid, moved) * per_q4);
        check_evenness("flow evenness", moved, got.flow_evenness);
        check_cosine("flow along", flow, field, got.flow_along);
        // Whole ppm before the division by the lag.
        const double strain_ppm_s = moved.dilation * 2e6 / bench.config.pitch_um / lag_s;
        within("dilation rate", held<StrainPpmPerSec>(strain_ppm_s), got.dilation_rate.raw(), 0.5 + 1.001 / lag_s);
        const double closing = -got.dilation_rate.raw();
        if (easing <= closing) easing_below = 0.0;
        easing = std::max(easing, closing);
        easing_below = std::min(easing_below, easing - closing);
        if (const Past* const before = lag_before(earlier->at_us)) {
          check_cosine("flow steady", flow, difference(earlier->field, before->field), got.flow_steady);
        }
      }
      within("easing", easing, got.easing.raw(), easing_below, 0.0);
      kept.push_back({bench.now_us, field, shape.residual, residual_q4});
    }
  }
}

// Whatever the clock shows by then.
TEST(FieldFeatures, there_is_no_flow_until_a_field_is_a_tenth_of_a_second_old) {
  std::mt19937 rng(9);
  std::normal_distribution<double> normal(0.0, 300.0);
  Bench bench;
  for (const bool flows : {false, false, false, true}) {
    const FieldFeatures got = bench.next(field_of([&](Vec) { return Vec{normal(rng), normal(rng)}; }));
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
    const Shape want = shape_of(kGrid, in_double(field_of([](Vec g) {
                                  return Vec{3000.0 * std::exp(-std::hypot(g.x, g.y) / 4e3), 0};
                                })));
    DOUBLES_EQUAL(want.spread, got.flow_spread.raw(), 6.0);
    CHECK_TRUE(got.flow_steady.raw() > 1000);
  }
}
