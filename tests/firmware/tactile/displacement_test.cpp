// SPDX-License-Identifier: Apache-2.0
// Against (now - rest) * pitch_um / pitch_px in double. Rounding to the nearest um: at most 0.5 um off.
#include "tactile/displacement.hpp"

#include <cmath>
#include <cstdint>
#include <random>

#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

PixelsQ8 raw(std::int32_t q8) {
  return PixelsQ8::from_raw(q8);
}

}  // namespace

TEST_GROUP(Displacement) {
  MarkerField now;
  MarkerField rest;
  DisplacementField out;
  Saturations saturations;
  void setup() override {
    now.grid = rest.grid = {7, 9};
  }
};

TEST(Displacement, IsWithinHalfAMicrometreOfTheReference) {
  std::mt19937_64 random(40);
  for (int round = 0; round < 400; ++round) {
    // Pitches of all picture sizes (10 px at 96 columns, 163 px at 1640) and all printed ones.
    const std::int32_t pitch_q8 = 2'000 + static_cast<std::int32_t>(random() % 42'000);
    const displacement::Config config{1000 + static_cast<std::int32_t>(random() % 4001)};
    reference_model::Positions want_now(63), want_rest(63);
    for (std::size_t i = 0; i < 63; ++i) {
      const auto draw = [&] { return static_cast<std::int32_t>(random() % (1640 * 256)); };
      rest.markers[i] = {raw(draw()), raw(draw()), random() % 8 != 0};
      // Up to 3 pitches away, most less: 15 mm at the largest printed pitch.
      const auto step = [&] {
        return static_cast<std::int32_t>(random() % static_cast<unsigned>(6 * pitch_q8)) - 3 * pitch_q8;
      };
      now.markers[i] = {raw(rest.markers[i].x.raw() + step()), raw(rest.markers[i].y.raw() + step()),
                        random() % 8 != 0};
      if (rest.markers[i].valid) want_rest[i] = {rest.markers[i].x.raw() / 256.0, rest.markers[i].y.raw() / 256.0};
      if (now.markers[i].valid) want_now[i] = {now.markers[i].x.raw() / 256.0, now.markers[i].y.raw() / 256.0};
    }
    displacement::update(config, now, rest, raw(pitch_q8), saturations, out);
    const auto want = reference_model::displacement_um(want_now, want_rest, pitch_q8 / 256.0, config.pitch_um);
    CHECK_TRUE(out.grid == now.grid);
    for (std::size_t i = 0; i < 63; ++i) {
      CHECK_EQUAL(want[i].has_value(), out.markers[i].valid);
      DOUBLES_EQUAL(want[i] ? want[i]->x : 0.0, out.markers[i].dx.raw(), 0.5 + 1e-6);
      DOUBLES_EQUAL(want[i] ? want[i]->y : 0.0, out.markers[i].dy.raw(), 0.5 + 1e-6);
    }
  }
  LONGS_EQUAL(0, saturations.count);
}

TEST(Displacement, IsZeroAtRestAndOnePitchAtOnePitch) {
  for (std::size_t i = 0; i < 63; ++i) {
    rest.markers[i] = {raw(5000), raw(6000), true};
    now.markers[i] = {raw(5000 + 8166), raw(6000 - 8166), true};
  }
  displacement::update({}, now, rest, raw(8166), saturations, out);
  LONGS_EQUAL(2020, out.markers[0].dx.raw());
  LONGS_EQUAL(-2020, out.markers[62].dy.raw());
  displacement::update({}, rest, rest, raw(8166), saturations, out);
  LONGS_EQUAL(0, out.markers[0].dx.raw());
}

TEST(Displacement, IsTheSameAtEveryScale) {
  rest.markers[0] = {raw(10'000), raw(10'000), true};
  for (const std::int32_t scale : {1, 2, 4, 5}) {
    now.markers[0] = {raw(10'000 + 1'633 * scale), raw(10'000 - 817 * scale), true};
    displacement::update({}, now, rest, raw(8'166 * scale), saturations, out);
    LONGS_EQUAL(404, out.markers[0].dx.raw());   // 1633 / 8166 * 2020 = 403.95
    LONGS_EQUAL(-202, out.markers[0].dy.raw());  // 817 / 8166 * 2020 = 202.1
  }
}

TEST(Displacement, CountsWhatItClamps) {
  rest.markers[0] = {raw(PixelsQ8::kMin), raw(0), true};
  now.markers[0] = {raw(PixelsQ8::kMax), raw(0), true};
  displacement::update({5000}, now, rest, raw(256), saturations, out);
  LONGS_EQUAL(Micrometres::kMax, out.markers[0].dx.raw());
  LONGS_EQUAL(0, out.markers[0].dy.raw());
  LONGS_EQUAL(1, saturations.count);
  displacement::update({5000}, rest, now, raw(1), saturations, out);
  LONGS_EQUAL(Micrometres::kMin, out.markers[0].dx.raw());
  LONGS_EQUAL(2, saturations.count);
}

// What an earlier frame left in `out` must not shine through.
TEST(Displacement, OfALostMarkerIsNothing) {
  rest.markers[3] = now.markers[3] = {raw(700), raw(800), true};
  rest.markers[4] = {raw(700), raw(800), false};
  now.markers[4] = {raw(900), raw(800), true};
  out.markers[3] = out.markers[4] = {Micrometres::from_raw(7), Micrometres::from_raw(8), true};
  now.markers[3].valid = false;
  displacement::update({}, now, rest, raw(8166), saturations, out);
  CHECK_FALSE(out.markers[3].valid);
  CHECK_FALSE(out.markers[4].valid);
  LONGS_EQUAL(0, out.markers[3].dx.raw());
  LONGS_EQUAL(0, out.markers[4].dx.raw());
}

// Behind the last marker of a lattice stands what a larger one left there.
TEST(Displacement, IsOfTheLatticeOnly) {
  rest.markers[63] = {raw(700), raw(800), true};
  now.markers[63] = {raw(900), raw(800), true};
  displacement::update({}, now, rest, raw(8166), saturations, out);
  CHECK_FALSE(out.markers[63].valid);
}
