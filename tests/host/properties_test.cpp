// SPDX-License-Identifier: Apache-2.0
// The integer stages against their definitions in long double, over inputs that rapidcheck draws from all of their
// ranges and shrinks to the smallest one that fails. Bounds are in LSB of the result's format, and argued where they
// stand. Every run draws the same inputs: the seed is here and not in the environment; a failure names it and shows its
// input.
#include <rapidcheck.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "base/math.hpp"
#include "base/units.hpp"
#include "tactile/displacement.hpp"
#include "tactile/entropy.hpp"
#include "tactile/features.hpp"
#include "tactile/field_features.hpp"
#include "tactile/reference.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using Real = long double;

constexpr std::uint64_t kSeed = 20'221'106;
constexpr int kCases = 1500;

class Silent final : public rc::detail::TestListener {
 public:
  void onTestCaseFinished(const rc::detail::CaseDescription& /*description*/) override {}
  void onShrinkTried(const rc::detail::CaseDescription& /*shrink*/, bool /*accepted*/) override {}
  void onTestFinished(const rc::detail::TestMetadata& /*metadata*/, const rc::detail::TestResult& /*result*/) override {
  }
};

template <typename Property>
void holds(Property property, int cases = kCases) {
  rc::detail::TestParams params;
  params.seed = kSeed;
  params.maxSuccess = cases;
  Silent nobody;
  const rc::detail::TestResult result =
      rc::detail::checkProperty(rc::detail::toProperty(std::move(property)), {}, params, nobody, {});
  if (result.is<rc::detail::SuccessResult>()) return;
  std::ostringstream text;
  text << "seed " << kSeed << ": ";
  rc::detail::printResultMessage(result, text);
  FAIL(text.str().c_str());
}

// 1e-6 LSB: what long double itself may be off.
void within(const std::string& what, Real want, Real got, Real below, Real above) {
  if (got >= want - below - 1e-6L && got <= want + above + 1e-6L) return;
  std::ostringstream text;
  text.precision(15);
  text << what << ": want " << want << " -" << below << " +" << above << ", got " << got;
  RC_FAIL(text.str());
}
void within(const std::string& what, Real want, Real got, Real bound) {
  within(what, want, got, bound, bound);
}

// --- What is drawn ---

// All of a range alike, whatever rapidcheck's size is; and every fourth time one of its ends or the middle.
template <typename Int>
rc::Gen<Int> any_of(Int least, Int most) {
  if (least == most) return rc::gen::just(least);
  return rc::gen::oneOf(rc::gen::element(least, most, static_cast<Int>(least / 2 + most / 2)),
                        rc::gen::resize(rc::kNominalSize, rc::gen::inRange(least, most)),
                        rc::gen::resize(rc::kNominalSize, rc::gen::inRange(least, most)),
                        rc::gen::resize(rc::kNominalSize, rc::gen::inRange(least, most)));
}

struct Vec {
  std::int32_t x = 0, y = 0;
  bool valid = true;
};
std::ostream& operator<<(std::ostream& out, const Vec& v) {
  return v.valid ? out << '(' << v.x << ", " << v.y << ')' : out << '-';
}

// Within +-size; one in eight is lost.
rc::Gen<Vec> vec_within(std::int32_t size) {
  return rc::gen::apply(
      [](std::int32_t x, std::int32_t y, int lost) {
        return Vec{x, y, lost != 0};
      },
      any_of(-size, size), any_of(-size, size), rc::gen::inRange(0, 8));
}

constexpr std::array<GridSize, 8> kGrids{{{7, 9}, {8, 16}, {16, 8}, {8, 10}, {3, 3}, {1, 128}, {1, 2}, {1, 1}}};

// From the tracker's noise to the ends of the format.
constexpr std::array<std::int32_t, 7> kSizes_um{0, 3, 60, 400, 1'900, 9'000, Micrometres::kMax};

using Field = std::vector<Vec>;

rc::Gen<Field> field_of(GridSize grid) {
  const auto count = static_cast<std::size_t>(grid.count());
  return rc::gen::mapcat(rc::gen::elementOf(kSizes_um),
                         [=](std::int32_t size) { return rc::gen::container<Field>(count, vec_within(size)); });
}

DisplacementField as_firmware(GridSize grid, const Field& field) {
  DisplacementField out;
  out.grid = grid;
  for (std::size_t i = 0; i < field.size(); ++i) {
    if (field[i].valid) {
      out.markers[i] = {Micrometres::from_raw(field[i].x), Micrometres::from_raw(field[i].y), true};
    }
  }
  return out;
}

PixelsQ8 px(std::int32_t raw) {
  return PixelsQ8::from_raw(raw);
}

// --- Definitions ---

Real entropy_of(const std::vector<int>& counts) {
  Real n = 0.0L;
  for (const int k : counts) n += static_cast<Real>(k);
  Real sum = 0.0L;
  for (const int k : counts) {
    const Real p = static_cast<Real>(k) / n;
    if (k > 0) sum -= p * std::log(p);
  }
  return sum;
}

// A table entry is off by 1/2 LSB, so E by 1/2 of ln n, 1/2 of the division and the mean of the bins' 1/2 over n;
// measured 1.1 up to 63 markers (entropy_test.cpp), 1.12 up to 128.
constexpr Real kEntropyQ24 = 1.12L;

struct FieldShape {
  int n = 0;
  Real shift = 0, reach = 0, spread = 0, residual = 0, dilation = 0, turn = 0;  // um; turn: um per half pitch
  Real lengths = 0, squares = 0;
  std::vector<int> octaves = std::vector<int>(kHistogramBins);
};

FieldShape shape_of(GridSize grid, const Field& field, int pitch_um) {
  struct Row {
    Real gx, gy, dx, dy;
  };
  std::vector<Row> rows;
  std::vector<Real> lengths;
  FieldShape out;
  for (std::size_t i = 0; i < field.size(); ++i) {
    if (!field[i].valid) continue;
    const std::size_t row = i / grid.cols;
    const std::size_t col = i % grid.cols;
    rows.push_back({2.0L * static_cast<Real>(col), 2.0L * static_cast<Real>(row), static_cast<Real>(field[i].x),
                    static_cast<Real>(field[i].y)});
    lengths.push_back(std::hypot(rows.back().dx, rows.back().dy));
    const Real octave =
        lengths.back() < 8.0L ? 0.0L : 1.0L + std::floor(2.0L * std::log2(lengths.back() / 8.0L) + 1e-12L);
    ++out.octaves[static_cast<std::size_t>(std::min(octave, kHistogramBins - 1.0L))];
  }
  out.n = static_cast<int>(rows.size());
  if (out.n == 0) return out;
  const Real n = static_cast<Real>(out.n);
  Row mean{0, 0, 0, 0};
  for (const Row& row : rows) {
    mean = {mean.gx + row.gx / n, mean.gy + row.gy / n, mean.dx + row.dx / n, mean.dy + row.dy / n};
  }
  Real twist = 0, opening = 0, arm = 0;
  for (const Row& row : rows) {
    const Real gx = row.gx - mean.gx, gy = row.gy - mean.gy, dx = row.dx - mean.dx, dy = row.dy - mean.dy;
    twist += gx * dy - gy * dx;
    opening += gx * dx + gy * dy;
    arm += gx * gx + gy * gy;
  }
  if (out.n > 1) {
    out.turn = twist / arm;
    out.dilation = opening / arm * 2.0L / static_cast<Real>(pitch_um);
  }
  for (const Row& row : rows) {
    const Real gx = row.gx - mean.gx, gy = row.gy - mean.gy, dx = row.dx - mean.dx, dy = row.dy - mean.dy;
    out.spread += (dx * dx + dy * dy) / n;
    out.residual += (std::pow(dx + out.turn * gy, 2.0L) + std::pow(dy - out.turn * gx, 2.0L)) / n;
  }
  out.spread = std::sqrt(out.spread);
  out.residual = std::sqrt(std::max(out.residual, 0.0L));
  out.shift = std::hypot(mean.dx, mean.dy);
  std::sort(lengths.rbegin(), lengths.rend());
  out.reach = out.n > 2 ? lengths[2] : 0.0L;
  for (const Real length : lengths) {
    out.lengths += length;
    out.squares += length * length;
  }
  return out;
}

// Roots of D are cut at 1/16 um each, so the sum is short by up to n/16; the quotient is cut as well.
void check_evenness(const std::string& what, const FieldShape& shape, ShareQ10 got) {
  if (shape.squares == 0.0L) {
    within(what, 1024.0L, got.raw(), 0.0L);
    return;
  }
  const Real n = static_cast<Real>(shape.n);
  const Real want = 1024.0L * shape.lengths * shape.lengths / (n * shape.squares);
  const Real left = std::max(1.0L - n / (16.0L * shape.lengths), 0.0L);
  within(what, want, got.raw(), want * (1.0L - left * left) + 1.0L, 0.0L);
}

// Of a residual in 1/16 um. Each marker's vector from the best rotation is off, in both axes, by 1/2 of the rounded
// mean, 1 of the shift's floor, turn / 2 of the rounded centre and |g| / 32 of the rounded turn: with |g| <= 254 half
// pitches. The root of the mean square is off by no more than the largest of those (triangle inequality), and cut off
// once.
Real residual_bound_q4(GridSize grid, const FieldShape& shape) {
  const Real reach = 2.0L * static_cast<Real>(std::max(grid.cols, grid.rows));
  return 1.0L + std::sqrt(2.0L) * (1.5L + std::abs(shape.turn) / 2.0L + reach / 32.0L);
}

struct Cosine {
  Real want_q10 = 0.0L;
  Real bound = 0.0L;
};
// Norms are cut at 1/16 um, which makes the quotient larger by that share.
Cosine cosine_of(const Field& a, const Field& b) {
  Real dot = 0, aa = 0, bb = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!a[i].valid || !b[i].valid) continue;
    const Real ax = static_cast<Real>(a[i].x), ay = static_cast<Real>(a[i].y);
    const Real bx = static_cast<Real>(b[i].x), by = static_cast<Real>(b[i].y);
    dot += ax * bx + ay * by;
    aa += ax * ax + ay * ay;
    bb += bx * bx + by * by;
  }
  if (aa == 0.0L || bb == 0.0L) return {};
  const Real want = 1024.0L * dot / std::sqrt(aa * bb);
  const Real more = 1.0L / ((1.0L - 1.0L / (16.0L * std::sqrt(aa))) * (1.0L - 1.0L / (16.0L * std::sqrt(bb)))) - 1.0L;
  return {want, 0.5L + std::abs(want) * more};
}

Field difference(const Field& now, const Field& before) {
  Field out(now.size());
  for (std::size_t i = 0; i < now.size(); ++i) {
    out[i] = {now[i].x - before[i].x, now[i].y - before[i].y, now[i].valid && before[i].valid};
  }
  return out;
}

template <typename Unit>
Real clamped_to(Real value) {
  return std::clamp(value, static_cast<Real>(Unit::kMin), static_cast<Real>(Unit::kMax));
}

}  // namespace

// clang-format off
TEST_GROUP(Properties) {};
// clang-format on

// --- base ---

TEST(Properties, QuotientsAreRoundedToNearestHalvesAway) {
  holds(
      [] {
        constexpr std::int64_t kEnd = std::int64_t{1} << 62;
        const auto numerator = *any_of<std::int64_t>(-kEnd, kEnd);
        const auto denominator = *any_of<std::int64_t>(1, std::int64_t{1} << *any_of(0, 61));
        const std::int64_t quotient = div_round(numerator, denominator);
        // The rest fits even where the product is rounded away from a numerator of 2^62.
        const std::int64_t rest = numerator - quotient * denominator;
        RC_ASSERT(rest <= denominator / 2 && -rest <= denominator / 2);
        if (denominator % 2 == 0 && (rest == denominator / 2 || -rest == denominator / 2)) {
          RC_ASSERT((rest < 0) == (numerator > 0));
        }
      },
      20'000);
}

TEST(Properties, RootsAreTheLargestWhoseSquareFits) {
  holds(
      [] {
        const auto value = *rc::gen::arbitrary<std::uint64_t>() >> *any_of(0, 63);
        for (const std::uint64_t near :
             {value - (value > 0 ? 1U : 0U), value, value + (value < UINT64_MAX ? 1U : 0U)}) {
          const std::uint64_t root = isqrt(near);
          RC_ASSERT(root * root <= near);
          RC_ASSERT(near - root * root <= 2 * root);
        }
      },
      20'000);
}

// Cut off, by less than one LSB and 2^-22 (math.hpp).
TEST(Properties, LogarithmsAreCutOff) {
  holds(
      [] {
        const auto value = std::max<std::uint64_t>(*rc::gen::arbitrary<std::uint64_t>() >> *any_of(0, 63), 1);
        within("log2", 256.0L * std::log2(static_cast<Real>(value)), log2_q8(value), 1.0L, 0.0L);
      },
      20'000);
}

template <typename Quantity>
void saturates() {
  holds([] {
    const auto raw =
        *rc::gen::oneOf(any_of<std::int64_t>(INT64_MIN, INT64_MAX),
                        any_of<std::int64_t>(Quantity::kMin - std::int64_t{2}, Quantity::kMin + std::int64_t{2}),
                        any_of<std::int64_t>(Quantity::kMax - std::int64_t{2}, Quantity::kMax + std::int64_t{2}));
    const auto before = *any_of<std::uint32_t>(0, UINT32_MAX);
    Saturations saturations{before};
    const std::int32_t got = Quantity::saturate(raw, saturations).raw();
    RC_ASSERT(std::int64_t{got} == std::clamp<std::int64_t>(raw, Quantity::kMin, Quantity::kMax));
    const bool cut = std::int64_t{got} != raw && before < UINT32_MAX;
    RC_ASSERT(saturations.count == before + (cut ? 1U : 0U));
  });
}

TEST(Properties, EveryUnitIsCutAtItsEndsAndCounts) {
  saturates<PixelsQ8>();
  saturates<Micrometres>();
  saturates<MicrometresPerSec>();
  saturates<MicrometresQ4>();
  saturates<StrainPpmPerSec>();
  saturates<ShareQ10>();
  saturates<Log2Q8>();
  saturates<Count>();
  saturates<NatsQ16>();
  saturates<NatsPerSecQ8>();
}

// --- tactile ---

// Any two places, any pitch: rounded once, 1/2 LSB.
TEST(Properties, DisplacementIsWithinHalfALsb) {
  holds(
      [] {
        MarkerField now;
        MarkerField rest;
        now.grid = rest.grid = {1, 1};
        const auto place = [] { return px(*any_of<std::int32_t>(PixelsQ8::kMin, PixelsQ8::kMax)); };
        now.markers[0] = {place(), place(), true};
        rest.markers[0] = {place(), place(), true};
        const auto pitch =
            *rc::gen::oneOf(any_of<std::int32_t>(1, PixelsQ8::kMax), any_of<std::int32_t>(1'000, 60'000));
        const displacement::Config config{*any_of<std::int32_t>(1'000, 5'000)};
        Saturations saturations;
        DisplacementField out;
        displacement::update(config, now, rest, px(pitch), saturations, out);
        std::uint32_t cut = 0;
        const auto check = [&](const char* what, PixelsQ8 at, PixelsQ8 home, Micrometres got) {
          const Real want =
              static_cast<Real>(at.raw() - home.raw()) * static_cast<Real>(config.pitch_um) / static_cast<Real>(pitch);
          within(what, clamped_to<Micrometres>(want), got.raw(), 0.5L);
          cut += std::abs(want) >= Micrometres::kMax + 0.5L ? 1U : 0U;
        };
        check("dx", now.markers[0].x, rest.markers[0].x, out.markers[0].dx);
        check("dy", now.markers[0].y, rest.markers[0].y, out.markers[0].dy);
        RC_ASSERT(saturations.count == cut);
      },
      20'000);
}

TEST(Properties, EntropyIsWithinItsBoundInAnyOrder) {
  holds(
      [] {
        // Counts of 15 bins, even or lumpy: what is drawn is where each marker lies.
        const auto markers = *rc::gen::oneOf(any_of(1, 20), any_of(21, 63), any_of(64, kMaxMarkers));
        const auto bins = *any_of(1, kHistogramBins);
        std::vector<int> counts(kHistogramBins);
        for (const int bin :
             *rc::gen::container<std::vector<int>>(static_cast<std::size_t>(markers), any_of(0, bins - 1))) {
          ++counts[static_cast<std::size_t>(bin)];
        }
        std::vector<std::uint8_t> bytes(counts.begin(), counts.end());
        const std::int32_t got = entropy::of_counts_q24(bytes);
        within("entropy", entropy_of(counts) * 16'777'216.0L, got, markers <= 63 ? 1.1L : kEntropyQ24);
        std::sort(bytes.begin(), bytes.end());
        RC_ASSERT(entropy::of_counts_q24(bytes) == got);
      },
      20'000);
}

TEST(Properties, FeaturesAreWithinTheirBounds) {
  holds([] {
    const GridSize grid = *rc::gen::elementOf(kGrids);
    features::Config config;
    config.histogram_range_um = *any_of<std::int32_t>(500, 10'000);
    features::State state;
    Field before;
    Real entropy_before = 0.0L;
    std::int64_t now_us = *any_of<std::int64_t>(-(std::int64_t{1} << 61), std::int64_t{1} << 61);
    for (int frame = 0; frame < 4; ++frame) {
      const Field field = *field_of(grid);
      const auto step_us =
          *rc::gen::oneOf(rc::gen::element<std::int64_t>(0, -40'000, 1, 999, 1'000, 250'000, 250'001, 10'000'000),
                          any_of<std::int64_t>(1'000, 250'000));
      now_us += step_us;
      Saturations saturations;
      const Features got = features::update(state, config, as_firmware(grid, field), Micros{now_us}, saturations);

      std::vector<int> histogram(kHistogramBins);
      int seen = 0;
      int common = 0;
      Real sum_x = 0, sum_y = 0;
      for (std::size_t i = 0; i < field.size(); ++i) {
        if (!field[i].valid) continue;
        ++seen;
        const Real length = std::sqrt(static_cast<Real>(square(field[i].x) + square(field[i].y)));
        const Real bin = std::floor(length * 15.0L / static_cast<Real>(config.histogram_range_um));
        ++histogram[static_cast<std::size_t>(std::min(bin, kHistogramBins - 1.0L))];
        if (before.empty() || !before[i].valid) continue;
        ++common;
        sum_x += static_cast<Real>(field[i].x - before[i].x);
        sum_y += static_cast<Real>(field[i].y - before[i].y);
      }
      for (std::size_t bin = 0; bin < kHistogramBins; ++bin) RC_ASSERT(int{got.histogram[bin]} == histogram[bin]);
      RC_ASSERT(got.markers == seen);
      const Real entropy = seen > 0 ? entropy_of(histogram) : 0.0L;
      within("E", entropy * 65'536.0L, got.entropy.raw(), 0.5L + kEntropyQ24 / 256.0L);
      const bool rates = frame > 0 && step_us >= 1'000 && step_us <= 250'000 && common > 0;
      RC_ASSERT(got.rates_valid == rates);
      RC_ASSERT(got.gap == (frame > 0 && step_us > 250'000));
      const Real per_s = rates ? 1e6L / static_cast<Real>(step_us) : 0.0L;
      const Real share = rates ? per_s / static_cast<Real>(common) : 0.0L;
      within("Vx", clamped_to<MicrometresPerSec>(sum_x * share), got.vx.raw(), 0.5L);
      within("Vy", clamped_to<MicrometresPerSec>(sum_y * share), got.vy.raw(), 0.5L);
      // Two entropies in Q24; Q8 of a second.
      within("dE/dt", (entropy - entropy_before) * per_s * 256.0L, got.entropy_rate.raw(),
             0.5L + 2.0L * kEntropyQ24 / 65'536.0L * per_s);
      before = field;
      entropy_before = entropy;
    }
  });
}

TEST(Properties, ShapeAndFlowAreWithinTheirBounds) {
  holds([] {
    const GridSize grid = *rc::gen::elementOf(kGrids);
    const field_features::Config config{.pitch_um = *any_of<std::int32_t>(1'000, 5'000)};
    field_features::State state;
    struct Past {
      std::int64_t at_us;
      Field field;
      FieldShape shape;
    };
    std::vector<Past> kept;
    std::int64_t now_us = 0;
    Real easing = 0.0L;
    Real easing_below = 0.0L;
    const auto lag_before = [&](std::int64_t than) -> const Past* {
      const auto at =
          std::find_if(kept.rbegin(), kept.rend(), [=](const Past& past) { return than - past.at_us >= 100'000; });
      return at == kept.rend() ? nullptr : &*at;
    };
    for (int frame = 0; frame < 7; ++frame) {
      const Field field = *field_of(grid);
      const auto step_us = *any_of<std::int64_t>(12'000, 120'000);
      now_us += step_us;
      Saturations saturations;
      const FieldFeatures got =
          field_features::update(state, config, as_firmware(grid, field), Micros{now_us}, saturations);
      const FieldShape shape = shape_of(grid, field, config.pitch_um);
      const Real n = std::max<Real>(static_cast<Real>(shape.n), 1.0L);

      // In 1/16 um: the root of the sums is cut before it is divided by n, the mean rounded.
      const Real shift_q4 = 0.5L + 1.0L / n;
      const Real residual_q4 = shape.n > 0 ? residual_bound_q4(grid, shape) : 0.0L;
      within("shift", clamped_to<Micrometres>(shape.shift), got.shift.raw(), 0.5L + shift_q4 / 16.0L);
      within("reach", clamped_to<Micrometres>(shape.reach), got.reach.raw(), 0.5L + 1.0L / 16.0L);
      within("residual", shape.residual * 16.0L, got.residual.raw(), residual_q4);
      // Two logarithms, each cut off; what comes in is off by its own bound.
      const auto log_off = [](Real value, Real bound) {
        return 256.0L * std::log2((value + bound) / std::max(value - bound, 32.0L));
      };
      const Real top = shape.residual * 16.0L + 32.0L, bottom = shape.shift * 16.0L + 32.0L;
      within("unevenness", 256.0L * std::log2(top / bottom), got.unevenness.raw(),
             1.0L + log_off(top, residual_q4) + log_off(bottom, shift_q4));
      check_evenness("evenness", shape, got.evenness);
      within("octave entropy", shape.n > 0 ? entropy_of(shape.octaves) * 65'536.0L : 0.0L, got.octave_entropy.raw(),
             0.5L + kEntropyQ24 / 256.0L);

      // Each frame's fading is cut off once, and what was cut fades as well.
      const Real fading = frame > 0 ? 300'000.0L / static_cast<Real>(300'000 + step_us) : 1.0L;
      easing *= fading;
      easing_below = easing_below * fading + 1.0L;
      if (const Past* const earlier = lag_before(now_us)) {
        const Real lag_s = static_cast<Real>(now_us - earlier->at_us) * 1e-6L;
        const Field flow = difference(field, earlier->field);
        const FieldShape moved = shape_of(grid, flow, config.pitch_um);
        const Real per_q4 = 1.0L / (16.0L * lag_s);
        const Real before_q4 = earlier->shape.n > 0 ? residual_bound_q4(grid, earlier->shape) : 0.0L;
        within("residual rate", (shape.residual - earlier->shape.residual) / lag_s, got.residual_rate.raw(),
               0.5L + (residual_q4 + before_q4) * per_q4);
        within("flow shift", moved.shift / lag_s, got.flow_shift.raw(),
               0.5L + (0.5L + 1.0L / std::max<Real>(static_cast<Real>(moved.n), 1.0L)) * per_q4);
        within("flow spread", moved.spread / lag_s, got.flow_spread.raw(), 0.5L + (1.0L + std::sqrt(0.5L)) * per_q4);
        within("flow residual", moved.residual / lag_s, got.flow_residual.raw(),
               0.5L + residual_bound_q4(grid, moved) * per_q4);
        check_evenness("flow evenness", moved, got.flow_evenness);
        const Cosine along = cosine_of(flow, field);
        within("flow along", along.want_q10, got.flow_along.raw(), along.bound);
        // Whole ppm before the division by the lag.
        const Real strain = moved.dilation * 1e6L / lag_s;
        within("dilation rate", clamped_to<StrainPpmPerSec>(strain), got.dilation_rate.raw(), 0.5L + 1.001L / lag_s);
        if (easing <= static_cast<Real>(-got.dilation_rate.raw())) {
          easing = static_cast<Real>(-got.dilation_rate.raw());
          easing_below = 0.0L;
        } else {
          easing_below = std::min(easing_below, easing + static_cast<Real>(got.dilation_rate.raw()));
        }
        if (const Past* const before = lag_before(earlier->at_us)) {
          const Cosine steady = cosine_of(flow, difference(earlier->field, before->field));
          within("flow steady", steady.want_q10, got.flow_steady.raw(), steady.bound);
        }
      }
      within("easing", easing, got.easing.raw(), easing_below, 0.0L);
      kept.push_back({now_us, field, shape});
    }
  });
}

// Sums are exact, so a place is rounded once. The roots of the links' lengths are cut off, their mean is rounded.
TEST(Properties, RestPositionAndPitchAreWithinTheirBounds) {
  holds([] {
    const GridSize grid = *rc::gen::element(GridSize{7, 9}, GridSize{3, 3}, GridSize{1, 2});
    const auto count = static_cast<std::size_t>(grid.count());
    const auto spread = *rc::gen::element<std::int32_t>(1, 96, 20'000, PixelsQ8::kMax / 2);
    reference::Config config;
    config.frames = *any_of(1, 12);
    config.still = px(PixelsQ8::kMax);
    config.most_bend_permille = 0;  // no gel has these places
    const auto home = *rc::gen::container<Field>(count, vec_within(PixelsQ8::kMax / 2));
    reference::State state;
    std::vector<Real> sum_x(count), sum_y(count);
    std::vector<int> seen(count);
    for (int frame = 0; frame < config.frames; ++frame) {
      const auto offsets = *rc::gen::container<Field>(count, vec_within(spread));
      MarkerField field;
      field.grid = grid;
      for (std::size_t i = 0; i < count; ++i) {
        field.markers[i] = {px(home[i].x + offsets[i].x), px(home[i].y + offsets[i].y), offsets[i].valid};
        if (!offsets[i].valid) continue;
        sum_x[i] += static_cast<Real>(field.markers[i].x.raw());
        sum_y[i] += static_cast<Real>(field.markers[i].y.raw());
        ++seen[i];
      }
      (void)reference::update(state, config, field);
    }
    std::vector<std::optional<std::pair<Real, Real>>> rest(count);
    for (std::size_t i = 0; i < count; ++i) {
      const Marker& got = state.rest.markers[i];
      RC_ASSERT(got.valid == (seen[i] > 0 && 2 * seen[i] >= config.frames));
      if (!got.valid) continue;
      within("x", sum_x[i] / static_cast<Real>(seen[i]), got.x.raw(), 0.5L);
      within("y", sum_y[i] / static_cast<Real>(seen[i]), got.y.raw(), 0.5L);
      rest[i] = {static_cast<Real>(got.x.raw()), static_cast<Real>(got.y.raw())};
    }
    Real links = 0.0L;
    Real length = 0.0L;
    const auto add = [&](std::size_t a, std::size_t b) {
      if (!rest[a] || !rest[b]) return;
      links += 1.0L;
      length += std::hypot(rest[a]->first - rest[b]->first, rest[a]->second - rest[b]->second);
    };
    for (std::size_t i = 0; i < count; ++i) {
      if (i % grid.cols + 1 < grid.cols) add(i, i + 1);
      if (i + grid.cols < count) add(i, i + grid.cols);
    }
    const Real pitch = links > 0.0L ? length / links : 0.0L;
    const Real got = reference::pitch_of(state.rest).raw();
    within("pitch", clamped_to<PixelsQ8>(pitch), got, links > 0.0L ? 1.5L : 0.0L, links > 0.0L ? 0.5L : 0.0L);
    RC_ASSERT(state.known == (got > 0.0L));
  });
}
