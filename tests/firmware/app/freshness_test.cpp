// SPDX-License-Identifier: Apache-2.0
#include "app/freshness.hpp"

#include <cstdint>
#include <random>
#include <set>
#include <vector>

#include "drivers/sim/noise.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

TEST_GROUP(Freshness) {
  static constexpr int kWidth = 410, kHeight = 308, kStride = 416;

  freshness::State state;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(std::size_t{kStride} * kHeight, 120);
  std::uint32_t sequence = 0;
  std::mt19937_64 random{20261124};

  void teardown() override {
    pixels = {};
  }

  [[nodiscard]] LumaView view() const {
    return {pixels.data(), kWidth, kHeight, kStride};
  }
  Reason show() {
    return freshness::update(state, view(), sequence++).reason;
  }
  void add_noise() {
    sim::add_noise(pixels, random());
  }
};

// As many buffers as V4L2 can have, and any fewer; 256 is what is remembered.
TEST(Freshness, FindsARingOfOldPictures) {
  for (const std::size_t ring : {1U, 2U, 3U, 16U, 32U, 255U, 256U}) {
    state = {};
    std::vector<std::vector<std::uint8_t>> old;
    for (std::size_t k = 0; k < ring; ++k) {
      add_noise();
      CHECK_TRUE(show() == Reason::kNone);
      old.push_back(pixels);
    }
    for (std::size_t k = 0; k < 3 * ring + 500; ++k) {
      pixels = old[k % ring];
      CHECK_TRUE(show() == Reason::kFrameFrozen);
    }
    LONGS_EQUAL(3 * ring + 500, state.repeated);
  }
}

// Old pictures between new ones are refused each time, for as long as it goes on.
TEST(Freshness, FindsOldPicturesBetweenNewOnes) {
  const std::vector<std::uint8_t> old = pixels;
  CHECK_TRUE(show() == Reason::kNone);
  for (int k = 0; k < 600; ++k) {
    add_noise();
    CHECK_TRUE(show() == Reason::kNone);
    const std::vector<std::uint8_t> fresh = pixels;
    pixels = old;
    CHECK_TRUE(show() == Reason::kFrameFrozen);
    pixels = fresh;
  }
}

// A sensor's noise is 2.5 levels rms in most pixels; here one pixel in a hundred moves by one.
TEST(Freshness, TakesNoisyPicturesForNews) {
  for (int k = 0; k < 2000; ++k) {
    for (std::size_t i = 0; i < pixels.size() / 100; ++i) pixels[random() % pixels.size()] ^= 1;
    CHECK_TRUE(show() == Reason::kNone);
  }
}

// Every word that is looked at counts, each bit of it, and what lies between the rows does not.
TEST(Freshness, LooksAtAThousandPlacesOfThePicture) {
  const std::uint64_t before = freshness::fingerprint_of(view());
  int seen = 0, at_once = 0;
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    pixels[k] ^= static_cast<std::uint8_t>(1U << (k % 8));
    const bool differs = freshness::fingerprint_of(view()) != before;
    CHECK_FALSE(differs && k % kStride >= kWidth);
    seen += differs ? 1 : 0;
    pixels[k] ^= static_cast<std::uint8_t>(1U << (k % 8));
  }
  CHECK_TRUE(seen >= 8 * 900 && seen <= 8 * 1024);
  // Two words whose changes could cancel: the highest bit of each.
  std::set<std::uint64_t> all{before};
  std::vector<std::uint8_t> tiny(64 * 48, 0);
  for (std::size_t k = 7; k < tiny.size(); k += 8) {
    tiny[k] ^= 0x80;
    ++at_once;
    all.insert(freshness::fingerprint_of({tiny.data(), 64, 48, 64}));
  }
  LONGS_EQUAL(at_once + 1, all.size());
}

TEST(Freshness, TellsShapesApart) {
  const std::vector<std::uint8_t> flat(64 * 64, 9);
  CHECK_TRUE(freshness::fingerprint_of({flat.data(), 64, 48, 64}) !=
             freshness::fingerprint_of({flat.data(), 64, 50, 64}));
  CHECK_TRUE(freshness::fingerprint_of({flat.data(), 64, 48, 64}) !=
             freshness::fingerprint_of({flat.data(), 48, 64, 64}));
}

TEST(Freshness, FindsANumberThatStandsStill) {
  CHECK_TRUE(freshness::update(state, view(), 5).ok());
  add_noise();
  CHECK_TRUE(freshness::update(state, view(), 5).reason == Reason::kFrameFrozen);
  add_noise();
  CHECK_TRUE(freshness::update(state, view(), 6).ok());
}

// A stream that begins anew counts anew, and may not show what it had shown.
TEST(Freshness, KeepsPicturesAcrossARestartButNotNumbers) {
  CHECK_TRUE(freshness::update(state, view(), 5).ok());
  freshness::restart(state);
  CHECK_TRUE(freshness::update(state, view(), 0).reason == Reason::kFrameFrozen);
  add_noise();
  freshness::restart(state);
  CHECK_TRUE(freshness::update(state, view(), 0).ok());
}
