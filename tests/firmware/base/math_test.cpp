// SPDX-License-Identifier: Apache-2.0
#include "base/math.hpp"
#include "base/units.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "tests/support/draw.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

TEST_GROUP(Math){};

TEST(Math, RoundsQuotientsToNearestAndHalvesAwayFromZero) {
  LONGS_EQUAL(2, div_round(3, 2));
  LONGS_EQUAL(-2, div_round(-3, 2));
  LONGS_EQUAL(1, div_round(1, 2));
  LONGS_EQUAL(-1, div_round(-1, 2));
  LONGS_EQUAL(0, div_round(0, 7));
  LONGS_EQUAL(1, div_round(4, 3));
  LONGS_EQUAL(2, div_round(5, 3));
  LONGS_EQUAL(5, div_round(5, 1));
}

// |n - q d| <= d / 2, in integers: no rounding in the oracle. Over the whole range: the rest fits even where the
// product is rounded away from a numerator of 2^62.
TEST(Math, TheRestOfAQuotientIsHalfTheDenominatorAtMost) {
  test::Draw draw(1);
  for (int i = 0; i < 200'000; ++i) {
    constexpr std::int64_t kEnd = std::int64_t{1} << 62;
    const std::int64_t numerator = draw.of(-kEnd, kEnd);
    const std::int64_t denominator = draw.of(1, std::int64_t{1} << draw.of(0, 61));
    const std::int64_t rest = numerator - div_round(numerator, denominator) * denominator;
    CHECK_TRUE(std::abs(rest) <= denominator / 2);
    if (denominator % 2 == 0 && std::abs(rest) == denominator / 2) CHECK_TRUE((rest < 0) == (numerator > 0));
  }
}

TEST(Math, RootIsTheLargestWhoseSquareFits) {
  const auto check = [](std::uint64_t value) {
    const std::uint64_t root = isqrt(value);
    CHECK_TRUE(root * root <= value);
    // (root + 1)^2 > value without overflow at the top.
    CHECK_TRUE(value - root * root <= 2 * root);
  };
  for (std::uint64_t value = 0; value < 70'000; ++value) check(value);
  for (std::uint64_t root = 1; root < 0xFFFFFFFF; root = root * 3 + 1) {
    check(root * root - 1);
    check(root * root);
    check(root * root + 1);
  }
  check(UINT64_MAX);
  LONGS_EQUAL(0xFFFFFFFF, isqrt(UINT64_MAX));
  std::mt19937_64 random(2);
  for (int i = 0; i < 100'000; ++i) check(random() >> (random() % 64));
}

// log2 rounded down: small values, any, and the integers on both sides of every power 2^(k/256). What lies nearer to a
// step than 2^-22 LSB may fall on its other side (math.hpp), and long double cannot tell nearer ones than 1e-6 from
// below.
TEST(Math, Log2StepsWhereThePowersOfTwoDo) {
  const auto check = [](std::uint64_t value) {
    const long double exact = 256.0L * std::log2(static_cast<long double>(value));
    const std::int32_t got = log2_q8(value);
    CHECK_TRUE(static_cast<long double>(got) <= exact + 1e-6L);
    CHECK_TRUE(static_cast<long double>(got) >= exact - 1.0L - 1e-6L);
    const long double over = exact - std::floor(exact);
    if (over > 0x1p-22L && over < 1.0L - 1e-6L) LONGS_EQUAL(static_cast<long>(std::floor(exact)), got);
  };
  for (std::uint64_t value = 1; value < 5000; ++value) check(value);
  std::mt19937_64 random(4);
  for (int i = 0; i < 20'000; ++i) check(std::max<std::uint64_t>(random() >> (random() % 64), 1));
  check(UINT64_MAX);
  for (int k = 1; k < 64 * 256; ++k) {
    const long double step = std::exp2(static_cast<long double>(k) / 256.0L);
    const auto below = static_cast<std::uint64_t>(step);
    check(below);
    check(below + 1);
  }
}

TEST(Math, SquaresUpToTheRootOfTheirRange) {
  constexpr std::int64_t kRoot = 3'037'000'499;
  CHECK_TRUE(square(kRoot) == square(-kRoot));
  CHECK_TRUE(static_cast<std::uint64_t>(square(kRoot)) + 2 * kRoot + 1 > std::uint64_t{INT64_MAX});
  LONGS_EQUAL(kRoot, isqrt(std::uint64_t{INT64_MAX}));
}

TEST(Math, CountsStayAtTheirEnd) {
  std::uint32_t counter = UINT32_MAX - 3;
  count_up(counter);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX - 2, counter);
  count_up(counter, 2);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX, counter);
  count_up(counter);
  count_up(counter, UINT32_MAX);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX, counter);
  counter = 1;
  count_up(counter, UINT32_MAX);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX, counter);
  counter = 0;
  count_up(counter, 0);
  UNSIGNED_LONGS_EQUAL(0, counter);
}

// Up to 768: what the grid stage sorts at most (four neighbours of each of 192 dots).
TEST(Math, SortsAndFindsTheLowerMiddle) {
  std::mt19937_64 random(3);
  for (const int count : {1, 2, 3, 4, 63, 64, 192, 768}) {
    for (int round = 0; round < 20; ++round) {
      std::vector<std::int32_t> values(static_cast<std::size_t>(count));
      for (auto& value : values) value = static_cast<std::int32_t>(random() % 100) - 50;
      std::vector<std::int32_t> sorted = values;
      std::sort(sorted.begin(), sorted.end());
      LONGS_EQUAL(sorted[static_cast<std::size_t>((count - 1) / 2)], median_of_few(values.data(), count));
      CHECK_TRUE(values == sorted);
    }
  }
}

// Against libm; the tolerance is the documented one.
TEST(Math, Exp2IsThePowerOfTheLogarithm) {
  for (std::int32_t raw = 0; raw <= Log2Q8::kMax; ++raw) {
    const double exact = 1000 * std::exp2(raw / 256.0);
    DOUBLES_EQUAL(exact, static_cast<double>(exp2_milli(raw)), 0.004 * exact + 1);
  }
  LONGS_EQUAL(500, exp2_milli(-256));
  LONGS_EQUAL(0, exp2_milli(Log2Q8::kMin));
}
