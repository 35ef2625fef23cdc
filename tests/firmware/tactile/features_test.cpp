// SPDX-License-Identifier: Apache-2.0
// The four features against the double reference (tests/support/reference.*). The same integer displacements go to
// both: the histogram must be equal, E within its Q16 rounding, V and dE/dt within one rounding of their formats.
#include "tactile/features.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "tests/support/draw.hpp"
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
  const auto held = [](double um_s) {
    return std::clamp<double>(um_s, MicrometresPerSec::kMin, MicrometresPerSec::kMax);
  };
  DOUBLES_EQUAL(held(want.vx_um_s), got.vx.raw(), 0.5 + 1e-3);
  DOUBLES_EQUAL(held(want.vy_um_s), got.vy.raw(), 0.5 + 1e-3);
  const double entropies = want.rates_valid ? 2.0 * kQ24 / dt_s : 0.0;
  DOUBLES_EQUAL(want.entropy_rate_nat_s, got.entropy_rate.raw() / 256.0, 0.5 / 256.0 + entropies + 1e-6);
}

}  // namespace

TEST_GROUP(Features) {
  features::State state;
  features::Config config;
  DisplacementField field;
  Saturations saturations;
  void setup() override {
    field.grid = {7, 9};
  }

  void all(std::int32_t dx_um, std::int32_t dy_um) {
    for (int i = 0; i < field.grid.count(); ++i) field.markers[static_cast<std::size_t>(i)] = moved(dx_um, dy_um);
  }
  Features update(Micros now) {
    return features::update(state, config, field, now, saturations);
  }
};

// Any lattice, field, range of the histogram, hour and time between frames: a frame whose rates do not count is still
// the one that the next step is measured from.
TEST(Features, EqualTheReferenceOnRandomFields) {
  test::Draw draw(50);
  for (int round = 0; round < 3000; ++round) {
    const GridSize grid = draw.grid();
    const std::int32_t range_um = draw.one_in(4) ? 1'900 : draw.of32(500, 10'000);
    config = {};
    if (range_um != 1'900) config.histogram_range_um = range_um;
    state = {};
    reference_model::Model model({.range_um = static_cast<double>(range_um)});
    constexpr std::int64_t kEnd = std::int64_t{1} << 61;
    Micros now{draw.of(-kEnd, kEnd)};
    for (int frame = 0; frame < 5; ++frame) {
      const Micros dt =
          draw.one_in(2) ? Micros{draw.of(1'000, 250'000)}
                         : draw.one_of(std::array<Micros, 9>{0us, -40ms, -24h, 1us, 999us, 1ms, 250ms, 250'001us, 10s});
      now += dt;
      field = draw.field(grid);
      const Features got = update(now);
      check_same(model.update(as_reference(field), now.count()), got, static_cast<double>(dt.count()) * 1e-6);
      CHECK_EQUAL(frame > 0 && dt > 250ms, got.gap);  // backwards and twice are not gaps
    }
  }
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
