// SPDX-License-Identifier: Apache-2.0
// Against (now - rest) * pitch_um / pitch_px in double. Rounding to the nearest um: at most 0.5 um off.
#include "tactile/displacement.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tests/support/draw.hpp"
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

// In even rounds on pictures of all sizes (a pitch of 10 px at 96 columns, 163 px at 1640), up to 3 pitches away: 15 mm
// at the largest printed pitch. In odd ones any two places and any pitch: what the format does not hold is cut and
// counted.
TEST(Displacement, IsWithinHalfAMicrometreOfTheReference) {
  test::Draw draw(40);
  for (int round = 0; round < 1000; ++round) {
    const bool usual = round % 2 == 0;
    const std::int32_t pitch_q8 = usual ? draw.of32(2'000, 44'000) : draw.of32(1, PixelsQ8::kMax);
    const displacement::Config config{draw.of32(1'000, 5'000)};
    reference_model::Positions want_now(63), want_rest(63);
    for (std::size_t i = 0; i < 63; ++i) {
      const auto place = [&] {
        return raw(usual ? draw.of32(0, 1640 * 256) : draw.of32(PixelsQ8::kMin, PixelsQ8::kMax));
      };
      const auto away = [&](PixelsQ8 from) {
        return usual ? raw(from.raw() + draw.of32(-3 * pitch_q8, 3 * pitch_q8)) : place();
      };
      rest.markers[i] = {place(), place(), !draw.one_in(8)};
      now.markers[i] = {away(rest.markers[i].x), away(rest.markers[i].y), !draw.one_in(8)};
      if (rest.markers[i].valid) want_rest[i] = {rest.markers[i].x.raw() / 256.0, rest.markers[i].y.raw() / 256.0};
      if (now.markers[i].valid) want_now[i] = {now.markers[i].x.raw() / 256.0, now.markers[i].y.raw() / 256.0};
    }
    saturations = {};
    displacement::update(config, now, rest, raw(pitch_q8), saturations, out);
    const auto want = reference_model::displacement_um(want_now, want_rest, pitch_q8 / 256.0, config.pitch_um);
    CHECK_TRUE(out.grid == now.grid);
    std::uint32_t cut = 0;
    const auto check = [&](double exact, Micrometres got) {
      DOUBLES_EQUAL(std::clamp<double>(exact, Micrometres::kMin, Micrometres::kMax), got.raw(), 0.5 + 1e-6);
      if (std::abs(exact) >= Micrometres::kMax + 0.5) ++cut;
    };
    for (std::size_t i = 0; i < 63; ++i) {
      CHECK_EQUAL(want[i].has_value(), out.markers[i].valid);
      check(want[i] ? want[i]->x : 0.0, out.markers[i].dx);
      check(want[i] ? want[i]->y : 0.0, out.markers[i].dy);
    }
    LONGS_EQUAL(cut, saturations.count);
    if (usual) LONGS_EQUAL(0, cut);
  }
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
