// SPDX-License-Identifier: Apache-2.0
// No trial, and no row, is learned from and judged at once; nothing is lost or doubled.
#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "tests/support/learn_data.hpp"
#include "toolchain/learn/splits.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

std::set<int> both(const std::vector<int>& a, const std::vector<int>& b) {
  std::set<int> out;
  for (const int i : a) {
    if (std::find(b.begin(), b.end(), i) != b.end()) out.insert(i);
  }
  return out;
}

template <typename AnySplit>
void check_parts(const std::vector<AnySplit>& splits, const std::vector<int>& items) {
  std::multiset<int> tested;
  for (const AnySplit& split : splits) {
    CHECK_TRUE(both(split.train, split.test).empty());
    std::multiset<int> all(split.train.begin(), split.train.end());
    all.insert(split.test.begin(), split.test.end());
    CHECK_TRUE(all == std::multiset<int>(items.begin(), items.end()));
    tested.insert(split.test.begin(), split.test.end());
  }
  CHECK_TRUE(tested == std::multiset<int>(items.begin(), items.end()));
}

bool slips(const Samples& samples, int trial) {
  return samples.trials[idx(trial)].kind == "slip";
}

}  // namespace

TEST_GROUP(Splits){};

TEST(Splits, TrialsStayWhole) {
  const Samples samples = test::grasps(33, 1);
  const std::vector<int> some{1, 2, 3, 5, 8, 13, 21, 22, 23, 24, 25, 26, 32};
  for (const int folds : {2, 3, 5, 13}) {
    for (const std::vector<int>& trials : {test::all_trials(samples), some}) {
      const auto splits = by_trial(samples, trials, folds, 7);
      LONGS_EQUAL(folds, splits.size());
      STRCMP_EQUAL("fold 1", splits[0].name.c_str());
      check_parts(splits, trials);
    }
  }
}

TEST(Splits, FoldsAreEven) {
  const Samples samples = test::grasps(33, 1);
  for (std::uint64_t seed = 1; seed < 20; ++seed) {
    std::vector<long> sizes;
    std::vector<long> slipping;
    for (const Split& split : by_trial(samples, test::all_trials(samples), 5, seed)) {
      sizes.push_back(static_cast<long>(split.test.size()));
      slipping.push_back(std::count_if(split.test.begin(), split.test.end(), [&](int t) { return slips(samples, t); }));
    }
    for (const auto& counts : {sizes, slipping}) {
      CHECK_TRUE(*std::max_element(counts.begin(), counts.end()) - *std::min_element(counts.begin(), counts.end()) <=
                 1);
    }
  }
}

TEST(Splits, SeedDecidesAndNothingElse) {
  const Samples samples = test::grasps(40, 1);
  const auto trials = test::all_trials(samples);
  const auto first = by_trial(samples, trials, 5, 1);
  const auto again = by_trial(samples, trials, 5, 1);
  const auto other = by_trial(samples, trials, 5, 2);
  bool differs = false;
  for (std::size_t i = 0; i < first.size(); ++i) {
    CHECK_TRUE(first[i].test == again[i].test && first[i].train == again[i].train);
    differs = differs || first[i].test != other[i].test;
  }
  CHECK_TRUE(differs);
}

TEST(Splits, MoreFoldsThanTrialsLeavesSomeEmpty) {
  const Samples samples = test::grasps(3, 1);
  const auto splits = by_trial(samples, test::all_trials(samples), 5, 1);
  LONGS_EQUAL(5, splits.size());
  check_parts(splits, test::all_trials(samples));
  LONGS_EQUAL(2, std::count_if(splits.begin(), splits.end(), [](const Split& s) { return s.test.empty(); }));
}

TEST(Splits, ObjectsStayWhole) {
  const Samples samples = test::grasps(20, 1);
  const std::vector<int> trials{2, 4, 1, 7, 8, 3, 19};  // sponge first
  const auto splits = by_object(samples, trials);
  LONGS_EQUAL(3, splits.size());
  STRCMP_EQUAL("sponge", splits[0].name.c_str());
  STRCMP_EQUAL("box", splits[1].name.c_str());
  STRCMP_EQUAL("ball", splits[2].name.c_str());
  check_parts(splits, trials);
  for (const Split& split : splits) {
    for (const int t : split.test) STRCMP_EQUAL(split.name.c_str(), samples.trials[idx(t)].object.c_str());
    for (const int t : split.train) CHECK_TRUE(split.name != samples.trials[idx(t)].object);
  }
}

TEST(Splits, FramesAreTheJudgedOnesAndLeakOnPurpose) {
  const Samples samples = test::grasps(10, 1);
  std::vector<int> rows;
  for (int i = 0; i < static_cast<int>(samples.rows.size()); ++i) {
    if (judged(samples.rows[idx(i)]) && samples.rows[idx(i)].trial != 4) rows.push_back(i);
  }
  const auto splits = by_frame(samples, {0, 1, 2, 3, 5, 6, 7, 8, 9}, 5, 3);
  LONGS_EQUAL(5, splits.size());
  check_parts(splits, rows);
  int shared = 0;
  for (const RowSplit& split : splits) {
    std::vector<int> train;
    std::vector<int> test;
    for (const int row : split.train) train.push_back(samples.rows[idx(row)].trial);
    for (const int row : split.test) test.push_back(samples.rows[idx(row)].trial);
    shared += both(test, train).empty() ? 0 : 1;
  }
  LONGS_EQUAL(5, shared);
}
