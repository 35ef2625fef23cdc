// SPDX-License-Identifier: Apache-2.0
// The four features against the double reference (tests/support/reference.*).
//
// Two comparisons:
//  * the same integer displacements go to both: the histogram must be equal, E within its Q16 rounding, V and
//  dE/dt
//    within one rounding of their formats;
//  * pixel positions go to both, so that the firmware also rounds to um: bounds argued at the test.
#include "tactile/features.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>

#include "tactile/displacement.hpp"
#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

MarkerDisplacement moved(std::int32_t dx_um, std::int32_t dy_um) {
  return {Micrometres::from_raw(dx_um), Micrometres::from_raw(dy_um), true};
}

reference_model::Displacements as_reference(const DisplacementField& field) {
  reference_model::Displacements out(static_cast<std::size_t>(field.grid.count()));
  for (std::size_t i = 0; i < out.size(); ++i) {
    const MarkerDisplacement& d = field.markers[i];
    if (d.valid) out[i] = reference_model::Point{static_cast<double>(d.dx.raw()), static_cast<double>(d.dy.raw())};
  }
  return out;
}

// Roundings of the formats: 0.5 um/s; E 0.5 / 65536 plus the 1.1 LSB of Q24 (1.12 with n up to 128);
// dE/dt 0.5 / 256 plus twice that entropy error over dt.
void check_same(const reference_model::Features& want, const Features& got, double dt_s) {
  LONGS_EQUAL(want.markers, got.markers);
  CHECK_EQUAL(want.rates_valid, got.rates_valid);
  for (std::size_t b = 0; b < kHistogramBins; ++b) LONGS_EQUAL(want.histogram[b], got.histogram[b]);
  constexpr double kQ24 = 1.12 / 16777216.0;
  DOUBLES_EQUAL(want.entropy_nat, got.entropy.raw() / 65536.0, 0.5 / 65536.0 + kQ24);
  DOUBLES_EQUAL(want.vx_um_s, got.vx.raw(), 0.5 + 1e-3);
  DOUBLES_EQUAL(want.vy_um_s, got.vy.raw(), 0.5 + 1e-3);
  DOUBLES_EQUAL(want.entropy_rate_nat_s, got.entropy_rate.raw() / 256.0, 0.5 / 256.0 + 2.0 * kQ24 / dt_s + 1e-6);
}

}  // namespace

TEST_GROUP(Features) {
  features::State state;
  features::Config config;
  DisplacementField field;
  Saturations saturations;
  std::mt19937_64 random{50};
  void setup() override {
    field.grid = {7, 9};
  }

  void all(std::int32_t dx_um, std::int32_t dy_um) {
    for (int i = 0; i < field.grid.count(); ++i) field.markers[static_cast<std::size_t>(i)] = moved(dx_um, dy_um);
  }
  Features update(Micros now) {
    return features::update(state, config, field, now, saturations);
  }
  std::int32_t draw(std::int32_t span) {
    return static_cast<std::int32_t>(random() % static_cast<unsigned>(2 * span + 1)) - span;
  }
};

TEST(Features, EqualTheReferenceOnRandomFields) {
  reference_model::Model model;
  Micros now{1'000'000};
  const std::array<std::int32_t, 4> spans{5, 200, 1900, 9000};  // rest noise .. beyond the histogram's range
  for (int frame = 0; frame < 3000; ++frame) {
    const std::int32_t span = spans[static_cast<std::size_t>(frame / 20 % 4)];
    const unsigned lost_of_16 = frame / 100 % 5 == 4 ? 12 : 1;
    for (std::size_t i = 0; i < 63; ++i) {
      field.markers[i] = random() % 16 < lost_of_16 ? MarkerDisplacement{} : moved(draw(span), draw(span));
    }
    const Micros dt{30'000 + static_cast<std::int64_t>(random() % 40'000)};
    now += dt;
    const Features got = update(now);
    const auto want = model.update(as_reference(field), now.count());
    check_same(want, got, static_cast<double>(dt.count()) * 1e-6);
  }
  LONGS_EQUAL(0, saturations.count);
}

TEST(Features, EqualTheReferenceWith128Markers) {
  field.grid = {8, 16};
  reference_model::Model model;
  for (int frame = 1; frame <= 200; ++frame) {
    for (std::size_t i = 0; i < 128; ++i) field.markers[i] = moved(draw(1500), draw(1500));
    const Micros now{frame * 40'000};
    check_same(model.update(as_reference(field), now.count()), update(now), 0.040);
  }
}

// Bin edges are at k * 1900 / 15 um: whole numbers at every third k only. |D| = 380 is the lower edge of bin 3.
TEST(Features, PutsEachLengthIntoItsBinExactly) {
  field.grid = {1, 1};
  for (std::int32_t length = 0; length <= 4000; ++length) {
    // The bin in integers: floor(15 * length / 1900), at most 14.
    const std::size_t want = static_cast<std::size_t>(std::min(14, length * 15 / 1900));
    for (const auto& d : {moved(length, 0), moved(0, -length), moved(-length, 0)}) {
      field.markers[0] = d;
      LONGS_EQUAL(1, features::histogram_of(field, 1900)[want]);
    }
  }
  field.markers[0] = moved(228, 304);  // 3-4-5: exactly 380
  LONGS_EQUAL(1, features::histogram_of(field, 1900)[3]);
  field.markers[0] = moved(228, 303);
  LONGS_EQUAL(1, features::histogram_of(field, 1900)[2]);
}

TEST(Features, HistogramHoldsAtTheEndsOfItsRanges) {
  field.grid = {1, 1};
  for (const std::int32_t range : {500, 10'000}) {
    for (const std::int32_t end : {Micrometres::kMin, Micrometres::kMax}) {
      field.markers[0] = moved(end, end);
      LONGS_EQUAL(1, features::histogram_of(field, range)[14]);
    }
    field.markers[0] = moved(0, 0);
    LONGS_EQUAL(1, features::histogram_of(field, range)[0]);
  }
}

// From pixels: both get the same positions (multiples of 1/256 px), only the firmware rounds to um. So
//  * each displacement component is 0.5 um off at most, a length 0.71 um: a marker may change its bin only
//  when its
//    true length is within 0.71 um of an edge;
//  * V: the mean of n differences of two roundings, 2 * 0.5 um / dt at worst. For independent roundings of
//  variance
//    1/12 um^2 its sigma is sqrt(2 / 12 / n) / dt = 0.051 um / dt for n = 63: 6 sigma = 0.31 um / dt,
//    asserted beside the bound. Plus 0.5 um/s of V's own format.
TEST(Features, FollowPixelPositionsWithinTheirBounds) {
  constexpr std::int32_t kPitchQ8 = 8166;  // 31.9 px: 320x240
  reference_model::Model model;
  MarkerField rest, now_field;
  rest.grid = now_field.grid = {7, 9};
  reference_model::Positions want_rest(63);
  for (std::size_t i = 0; i < 63; ++i) {
    rest.markers[i] = {PixelsQ8::from_raw(static_cast<std::int32_t>(random() % 80'000)),
                       PixelsQ8::from_raw(static_cast<std::int32_t>(random() % 60'000)), true};
    want_rest[i] = {rest.markers[i].x.raw() / 256.0, rest.markers[i].y.raw() / 256.0};
  }
  Micros now{};
  double worst_v_um = 0.0;
  for (int frame = 0; frame < 1000; ++frame) {
    reference_model::Positions want_now(63);
    for (std::size_t i = 0; i < 63; ++i) {
      const auto place = [&](PixelsQ8 home) { return PixelsQ8::from_raw(home.raw() + draw(7'000)); };
      now_field.markers[i] = {place(rest.markers[i].x), place(rest.markers[i].y), random() % 10 != 0};
      if (now_field.markers[i].valid) {
        want_now[i] = {now_field.markers[i].x.raw() / 256.0, now_field.markers[i].y.raw() / 256.0};
      }
    }
    now += 53ms;
    displacement::update({}, now_field, rest, PixelsQ8::from_raw(kPitchQ8), saturations, field);
    const Features got = update(now);
    const auto want = model.update(want_now, want_rest, kPitchQ8 / 256.0, now.count());
    LONGS_EQUAL(want.markers, got.markers);

    // Markers whose true length lies within 0.71 um of an edge may be in the bin below or above that edge.
    const auto lengths = reference_model::displacement_um(want_now, want_rest, kPitchQ8 / 256.0, 2020.0);
    std::array<int, kHistogramBins> loose{};
    for (const auto& d : lengths) {
      if (!d) continue;
      const double length = std::hypot(d->x, d->y);
      for (std::size_t edge = 1; edge < kHistogramBins; ++edge) {
        if (std::abs(length - static_cast<double>(edge) * 1900.0 / 15.0) > 0.71) continue;
        ++loose[edge - 1];
        ++loose[edge];
      }
    }
    for (std::size_t b = 0; b < kHistogramBins; ++b) {
      CHECK_TRUE(std::abs(want.histogram[b] - static_cast<int>(got.histogram[b])) <= loose[b]);
    }
    if (frame == 0) continue;
    const double dt_s = 0.053;
    const double off_um = std::max(std::abs(want.vx_um_s - got.vx.raw()), std::abs(want.vy_um_s - got.vy.raw())) * dt_s;
    worst_v_um = std::max(worst_v_um, off_um);
  }
  CHECK_TRUE(worst_v_um <= 1.0 + 0.5 * 0.053);
  CHECK_TRUE(worst_v_um <= 0.33 + 0.5 * 0.053);  // 6 sigma with 57 of 63 seen
}

TEST(Features, HasNoRatesOnTheFirstFrameAndAfterForget) {
  all(100, 0);
  const Features first = update(100h);
  CHECK_FALSE(first.rates_valid);
  CHECK_FALSE(first.gap);
  all(140, 0);
  const Features second = update(100h + 40ms);
  CHECK_TRUE(second.rates_valid);
  LONGS_EQUAL(1000, second.vx.raw());
  features::forget(state);
  all(0, 0);
  const Features third = update(100h + 80ms);
  CHECK_FALSE(third.rates_valid);
  CHECK_FALSE(third.gap);
  LONGS_EQUAL(0, third.vx.raw());
  LONGS_EQUAL(0, third.entropy_rate.raw());
}

// The time base decides, never the frame count: the same 1 um step over each dt.
// Marker 5 of another lattice is another marker.
TEST(Features, HasNoRatesBetweenTwoLattices) {
  field.grid = {7, 9};
  for (MarkerDisplacement& d : field.markers) d = moved(100, 0);
  (void)features::update(state, config, field, 40ms, saturations);
  field.grid = {8, 16};
  for (MarkerDisplacement& d : field.markers) d = moved(200, 0);
  const Features other = features::update(state, config, field, 80ms, saturations);
  CHECK_FALSE(other.rates_valid);
  LONGS_EQUAL(0, other.vx.raw());
  const Features next = features::update(state, config, field, 120ms, saturations);
  CHECK_TRUE(next.rates_valid);
}

TEST(Features, UseTheTimeThatPassed) {
  struct Case {
    Micros dt;
    bool valid;
  };
  const std::array<Case, 13> cases{{{0us, false},
                                    {-40ms, false},
                                    {1us, false},
                                    {999us, false},
                                    {1ms, true},
                                    {40ms, true},
                                    {53ms, true},
                                    {133ms, true},
                                    {250ms, true},
                                    {250'001us, false},
                                    {251ms, false},
                                    {10s, false},
                                    {-24h, false}}};
  for (const Case& c : cases) {
    state = {};
    all(0, 0);
    (void)update(100h);
    for (std::size_t i = 0; i < 63; i += 2) field.markers[i] = moved(300, -600);
    const Features got = update(100h + c.dt);
    CHECK_EQUAL(c.valid, got.rates_valid);
    CHECK_EQUAL(c.dt > 250ms, got.gap);  // backwards and twice are not gaps
    const double dt_s = static_cast<double>(c.dt.count()) * 1e-6;
    // 32 of 63 markers moved: mean 300 * 32 / 63.
    DOUBLES_EQUAL(c.valid ? 300.0 * 32 / 63 / dt_s : 0.0, got.vx.raw(), 0.51);
    DOUBLES_EQUAL(c.valid ? -600.0 * 32 / 63 / dt_s : 0.0, got.vy.raw(), 0.51);
    if (!c.valid) LONGS_EQUAL(0, got.entropy_rate.raw());
    // E stands on this frame alone.
    DOUBLES_EQUAL(0.69302, got.entropy.raw() / 65536.0, 1e-4);  // ln 2 nearly: 32 and 31
  }
}

// A frame whose rates do not count is still the one that the next step is measured from.
TEST(Features, StartAgainBehindAGap) {
  all(0, 0);
  (void)update(0ms);
  all(1000, 0);
  CHECK_FALSE(update(10s).rates_valid);
  all(1040, 0);
  const Features got = update(10s + 40ms);
  CHECK_TRUE(got.rates_valid);
  LONGS_EQUAL(1000, got.vx.raw());
}

// The HAL's clock counts in 64 bits; drivers that pass on 32-bit microseconds or milliseconds have nothing
// special here.
TEST(Features, AreNotTroubledByTheWrapOf32BitCounters) {
  for (const std::int64_t wrap : {std::int64_t{1} << 31, std::int64_t{1} << 32, std::int64_t{1} << 53}) {
    state = {};
    all(0, 0);
    (void)update(Micros{wrap - 20'000});
    all(40, 80);
    const Features got = update(Micros{wrap + 20'000});
    CHECK_TRUE(got.rates_valid);
    LONGS_EQUAL(1000, got.vx.raw());
    LONGS_EQUAL(2000, got.vy.raw());
  }
}

// Fastest of all: the ends of the displacement's range within 1 ms is 131 m/s; V clamps at 10 m/s and says so.
TEST(Features, CountsWhatItClamps) {
  all(Micrometres::kMin, Micrometres::kMin);
  (void)update(0ms);
  all(Micrometres::kMax, Micrometres::kMin);
  const Features got = update(1ms);
  LONGS_EQUAL(MicrometresPerSec::kMax, got.vx.raw());
  LONGS_EQUAL(0, got.vy.raw());
  LONGS_EQUAL(1, saturations.count);
}

// E from 0 to ln 15 within 1 ms, the steepest rise there is, with 120 markers: inside the format, nothing clamped.
TEST(Features, HoldTheSteepestRiseOfEntropy) {
  field.grid = {8, 15};
  all(0, 0);
  (void)update(0ms);
  for (std::size_t i = 0; i < 120; ++i) field.markers[i] = moved(static_cast<std::int32_t>(i % 15) * 130, 0);
  const Features got = update(1ms);
  DOUBLES_EQUAL(std::log(15.0) * 1000.0, got.entropy_rate.raw() / 256.0, 0.01);
  LONGS_EQUAL(0, saturations.count);
}

TEST(Features, AreEmptyWithoutMarkersAndSpeakOfOne) {
  Features got = update(0ms);
  LONGS_EQUAL(0, got.markers);
  LONGS_EQUAL(0, got.entropy.raw());
  got = update(40ms);
  CHECK_FALSE(got.rates_valid);  // no marker moved: nobody knows
  field.markers[17] = moved(0, 0);
  (void)update(80ms);
  field.markers[17] = moved(4000, -8);
  got = update(120ms);
  LONGS_EQUAL(1, got.markers);
  CHECK_TRUE(got.rates_valid);
  LONGS_EQUAL(100'000, got.vx.raw());
  LONGS_EQUAL(-200, got.vy.raw());
  LONGS_EQUAL(0, got.entropy.raw());
}

// A lost marker lowers n; a zero in its place would pull the mean down and fill bin 0.
TEST(Features, LeaveLostMarkersOut) {
  all(0, 0);
  (void)update(0ms);
  all(400, 0);
  for (std::size_t i = 0; i < 30; ++i) field.markers[i] = {};
  Features got = update(40ms);
  LONGS_EQUAL(10'000, got.vx.raw());
  LONGS_EQUAL(33, got.markers);
  LONGS_EQUAL(0, got.histogram[0]);
  // Back, far from where it was: it has no speed until it was seen twice.
  field.markers[0] = moved(3000, 0);
  got = update(80ms);
  LONGS_EQUAL(0, got.vx.raw());
}
