// SPDX-License-Identifier: Apache-2.0
// The marker score against the same formula in double, from noise to the ends of every feature's range.
#include "slip/score.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using score::kMaxTerms;
using score::Score;
using score::Term;

constexpr double kLeast_q8 = -32.0 * 256.0;
constexpr double kMost_q8 = 32.0 * 256.0;

// In Q8, not rounded and not limited.
double reference_q8(const Score& score, const std::vector<std::int32_t>& x) {
  double sum = score.bias_q8;
  for (int i = 0; i < score.count; ++i) {
    const Term& term = score.terms[idx(i)];
    sum += term.weight_q8 * std::log2(std::abs(static_cast<double>(x[idx(i)])) + term.offset);
  }
  return sum;
}

// log2_q8 rounds down by less than one LSB, each weighted; the sum is rounded once, by at most half of one.
double most_error_lsb(const Score& score) {
  double most = 0.5;
  for (const Term& term : score.terms) most += std::abs(term.weight_q8) / 256.0;
  return most;
}

std::vector<std::uint8_t> readable() {
  std::vector<std::uint8_t> all;
  for (std::size_t i = 0; i < kFeatures.size(); ++i) {
    if (score::may_read(kFeatures[i])) all.push_back(static_cast<std::uint8_t>(i));
  }
  return all;
}

Score random_score(std::mt19937& random, int most_weight) {
  std::vector<std::uint8_t> features = readable();
  std::shuffle(features.begin(), features.end(), random);
  Score score;
  score.count = 1 + static_cast<int>(random() % kMaxTerms);
  score.bias_q8 = static_cast<std::int32_t>(random() % 20'000) - 10'000;
  for (int i = 0; i < score.count; ++i) {
    const int magnitude = 1 + static_cast<int>(random() % static_cast<unsigned>(most_weight));
    score.terms[idx(i)] = {features[idx(i)], static_cast<std::int16_t>(random() % 2 == 0 ? magnitude : -magnitude),
                           static_cast<std::uint16_t>(1 + random() % 65535)};
  }
  return score;
}

// Checks one score of one x; returns whether it had to be limited.
bool agrees(const Score& score, const std::vector<std::int32_t>& x) {
  Saturations saturations;
  const Log2Q8 got = score::of(score, x, saturations);
  const double want = reference_q8(score, x);
  DOUBLES_EQUAL(std::clamp(want, kLeast_q8, kMost_q8), got.raw(), most_error_lsb(score) + 1e-6);
  if (want > kMost_q8 + most_error_lsb(score) || want < kLeast_q8 - most_error_lsb(score)) {
    UNSIGNED_LONGS_EQUAL(1, saturations.count);
    return true;
  }
  if (want < kMost_q8 - most_error_lsb(score) && want > kLeast_q8 + most_error_lsb(score)) {
    UNSIGNED_LONGS_EQUAL(0, saturations.count);
  }
  return false;
}

}  // namespace

// clang-format off
TEST_GROUP(Score) {};
// clang-format on

TEST(Score, IsTheFormulaInDouble) {
  std::mt19937 random(1);
  int limited = 0;
  for (int round = 0; round < 3000; ++round) {
    const Score score = random_score(random, round % 3 == 0 ? 32767 : 150);
    CHECK(score::is_valid(score));
    std::vector<std::int32_t> x;
    for (int i = 0; i < score.count; ++i) {
      const FeatureInfo& f = kFeatures[score.terms[idx(i)].feature];
      // As often small as large: 0 to 24 bits.
      const auto bits = static_cast<std::int32_t>((random() & 0xFFFFFF) >> (random() % 25));
      x.push_back(std::clamp(random() % 2 == 0 ? bits : -bits, f.min, f.max));
    }
    limited += agrees(score, x) ? 1 : 0;
  }
  CHECK(limited > 300 && limited < 2000);  // both kinds were met
}

TEST(Score, StandsTheEndsOfEveryFeature) {
  for (const std::uint8_t feature : readable()) {
    const FeatureInfo& f = kFeatures[feature];
    for (const std::int32_t x : {f.min, f.min + 1, -1, 0, 1, f.max - 1, f.max, INT32_MIN, INT32_MAX}) {
      for (const int weight : {-32768, -256, -1, 1, 256, 32767}) {
        for (const int offset : {1, 2, 65535}) {
          Score score;
          score.count = 1;
          score.terms[0] = {feature, static_cast<std::int16_t>(weight), static_cast<std::uint16_t>(offset)};
          (void)agrees(score, {x});
        }
      }
    }
  }
}

TEST(Score, StandsEightTermsAtTheirEndsAndAnyBias) {
  const std::vector<std::uint8_t> features = readable();
  for (const std::int32_t bias : {INT32_MIN, -1, 0, 1, INT32_MAX}) {
    for (const int weight : {-32768, 32767}) {
      Score score;
      score.count = kMaxTerms;
      score.bias_q8 = bias;
      for (int i = 0; i < kMaxTerms; ++i) {
        score.terms[idx(i)] = {features[idx(i)], static_cast<std::int16_t>(weight), 65535};
      }
      (void)agrees(score, std::vector<std::int32_t>(kMaxTerms, INT32_MIN));
      (void)agrees(score, std::vector<std::int32_t>(kMaxTerms, 0));
    }
  }
}

// Exact where nothing rounds: powers of two, weights in whole numbers.
TEST(Score, CountsOctaves) {
  Score score;
  score.count = 2;
  score.bias_q8 = -5 * 256;
  score.terms[0] = {0, 256, 16};
  score.terms[1] = {2, -512, 1};
  Saturations saturations;
  const auto of = [&](std::int32_t a, std::int32_t b) { return score::of(score, std::array{a, b}, saturations).raw(); };
  LONGS_EQUAL(-256, of(0, 0));        // -5 + log2 16
  LONGS_EQUAL(0, of(16, 0));          // an octave over the offset: odds doubled
  LONGS_EQUAL(0, of(-16, 0));         // whichever way it moves
  LONGS_EQUAL(256, of(48, 0));        // and doubled again
  LONGS_EQUAL(-256 - 512, of(0, 1));  // twice an octave less
  UNSIGNED_LONGS_EQUAL(0, saturations.count);
}

TEST(Score, HalvesAreRoundedAwayFromZero) {
  Score score;
  score.count = 1;
  score.terms[0] = {0, 128, 2};  // log2 2 = 1: 128/256 of a log2 of 256 LSB
  Saturations saturations;
  LONGS_EQUAL(128, score::of(score, std::array{0}, saturations).raw());
  score.terms[0] = {0, 128, 3};  // log2 3 = 405 LSB: half of it is 202.5
  LONGS_EQUAL(203, score::of(score, std::array{0}, saturations).raw());
  score.terms[0].weight_q8 = -128;
  LONGS_EQUAL(-203, score::of(score, std::array{0}, saturations).raw());
}

TEST(Score, WithoutTermsIsZero) {
  Saturations saturations;
  LONGS_EQUAL(0, score::of({}, {}, saturations).raw());
  CHECK(score::is_valid({}));
  CHECK_FALSE(score::reads({}, Stage::kField));
  CHECK_FALSE(score::reads({}, Stage::kAlways));
}

TEST(Score, ReadsTheMarkersFeaturesOnly) {
  for (std::size_t i = 0; i < kFeatures.size(); ++i) {
    Score score;
    score.count = 1;
    score.terms[0] = {static_cast<std::uint8_t>(i), 1, 1};
    const Stage stage = kFeatures[i].stage;
    CHECK_EQUAL(stage == Stage::kAlways || stage == Stage::kField, score::is_valid(score));
    for (const Stage other : {Stage::kAlways, Stage::kField}) CHECK_EQUAL(stage == other, score::reads(score, other));
    LONGS_EQUAL(i, score::index_of(kFeatures[i].name));
  }
  LONGS_EQUAL(kFeatureCount, score::index_of("none"));
  LONGS_EQUAL(kFeatureCount, score::index_of(""));
}

TEST(Score, ValidIsOneFormOnly) {
  Score good;
  good.count = 2;
  good.bias_q8 = -7;
  good.terms[0] = {0, 1, 1};
  good.terms[1] = {1, -1, 1};
  CHECK(score::is_valid(good));
  const auto refused = [&](auto change) {
    Score bad = good;
    change(bad);
    CHECK_FALSE(score::is_valid(bad));
  };
  refused([](Score& s) { s.count = -1; });
  refused([](Score& s) { s.count = kMaxTerms + 1; });
  refused([](Score& s) { s.count = 1; });  // a term behind the last
  refused([](Score& s) { s.count = 3; });  // one that weighs nothing
  refused([](Score& s) { s.terms[7].offset = 1; });
  refused([](Score& s) { s.terms[0].weight_q8 = 0; });
  refused([](Score& s) { s.terms[0].offset = 0; });
  refused([](Score& s) { s.terms[1].feature = 0; });  // twice the same
  refused([](Score& s) { s.terms[1].feature = kFeatureCount; });
  refused([](Score& s) { s.terms[1].feature = 255; });
  refused([](Score& s) { s = {.count = 0, .bias_q8 = 1, .terms = {}}; });
}
