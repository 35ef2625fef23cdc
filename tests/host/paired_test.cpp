// SPDX-License-Identifier: Apache-2.0
// The interval that the benchmarks print (tests/bench/paired.hpp). Oracle: ranks of the 95 % interval of a median as
// tables of the sign test give them.
#include "tests/bench/paired.hpp"

#include <numeric>

#include "CppUTest/TestHarness.h"

using namespace holdfast;

TEST_GROUP(Paired){};

TEST(Paired, IntervalOfTheMedianHasTheRanksOfTheSignTest) {
  struct Case {
    std::size_t n;
    double low, high;  // ranks, from 1
  };
  for (const Case& c : {Case{6, 1, 6}, {10, 2, 9}, {20, 6, 15}, {50, 18, 33}, {100, 40, 61}}) {
    std::vector<double> ranks(c.n);
    std::iota(ranks.begin(), ranks.end(), 1.0);
    std::reverse(ranks.begin(), ranks.end());
    const bench::Figure figure = bench::figure_of(ranks);
    DOUBLES_EQUAL(static_cast<double>(c.n + 1) / 2, figure.median, 0);
    DOUBLES_EQUAL(c.low, figure.low, 0);
    DOUBLES_EQUAL(c.high, figure.high, 0);
  }
}

TEST(Paired, FewerThanSixValuesHaveNoInterval) {
  CHECK_TRUE(std::isnan(bench::figure_of({1, 2, 3, 4, 5}).median));
}

TEST(Paired, WorstIsTheSmallestAndSkipsWhatWasNotMeasured) {
  bench::Worst worst("x");
  worst.see(bench::figure_of({}), "nothing");
  worst.see(bench::figure_of({5, 5, 5, 5, 5, 5}), "five");
  worst.see(bench::figure_of({3, 3, 3, 3, 3, 3}), "three");
  worst.see(bench::figure_of({4, 4, 4, 4, 4, 4}), "four");
  STRCMP_EQUAL("three", worst.where().c_str());
}
