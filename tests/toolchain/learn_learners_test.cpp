// SPDX-License-Identifier: Apache-2.0
// Our tree and k-NN behind one interface; the tree as a model; k-NN against brute force.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "base/math.hpp"
#include "slip/model.hpp"
#include "tests/support/learn_data.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/treec/tree_model.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

constexpr std::array kKinds{Kind::kTree, Kind::kKnn};

const FeatureSet& paper() {
  return *find_feature_set("paper");
}

Matrix judged_rows(int trials, std::uint64_t seed, double apart) {
  const Samples samples = test::grasps(trials, seed, apart);
  return matrix_of(samples, paper(), test::all_trials(samples));
}

std::unique_ptr<Learner> fitted(const Settings& settings, const Matrix& rows) {
  std::unique_ptr<Learner> learner = make_learner(settings);
  const auto error = learner->fit(rows);
  if (error) FAIL(error->c_str());
  return learner;
}

double right(const std::vector<std::uint8_t>& said, const Matrix& rows) {
  int count = 0;
  for (int i = 0; i < rows.height(); ++i) count += said[idx(i)] == rows.slip[idx(i)] ? 1 : 0;
  return static_cast<double>(count) / rows.height();
}

long slips(const std::vector<std::uint8_t>& said) {
  return std::count(said.begin(), said.end(), 1);
}

Verdict walk(const treec::Model& model, std::span<const std::int32_t> x) {
  int at = 0;
  while (!model.nodes[idx(at)].is_leaf) {
    const treec::Node& node = model.nodes[idx(at)];
    at = x[idx(node.feature)] <= node.threshold ? node.child_true : node.child_false;
  }
  return model.nodes[idx(at)].verdict;
}

// On its own rows and where every threshold has just been passed.
void check_same_as_tree(const Learner& learner, const treec::Model& model, const Matrix& rows) {
  Matrix probes = rows;
  for (const treec::Node& node : model.nodes) {
    if (node.is_leaf) continue;
    for (int i = 0; i < rows.height(); i += 17) {
      for (std::int64_t t = std::int64_t{node.threshold} - 1; t <= std::int64_t{node.threshold} + 1; ++t) {
        if (t < INT32_MIN || t > INT32_MAX) continue;
        std::vector<std::int32_t> x(rows.at(i).begin(), rows.at(i).end());
        x[idx(node.feature)] = static_cast<std::int32_t>(t);
        probes.x.insert(probes.x.end(), x.begin(), x.end());
        probes.slip.push_back(0);
        probes.row.push_back(0);
      }
    }
  }
  const std::vector<std::uint8_t> said = learner.predict(probes);
  LONGS_EQUAL(probes.height(), said.size());
  long differ = 0;
  for (int i = 0; i < probes.height(); ++i) {
    differ += (walk(model, probes.at(i)) == Verdict::kSlip) != (said[idx(i)] != 0) ? 1 : 0;
  }
  LONGS_EQUAL(0, differ);
}

}  // namespace

TEST_GROUP(Learners){};

TEST(Learners, MatrixHoldsTheJudgedRowsInTheSetsOrder) {
  const Samples samples = test::grasps(4, 1);
  for (const FeatureSet& set : kFeatureSets) {
    const Matrix m = matrix_of(samples, set, std::vector{3, 0});
    LONGS_EQUAL(20 + 12 + 20, m.height());
    LONGS_EQUAL(set.size(), m.width());
    LONGS_EQUAL(m.height() * m.width(), m.x.size());
    for (int i = 0; i < m.height(); ++i) {
      const Row& row = samples.rows[idx(m.row[idx(i)])];
      CHECK_TRUE(judged(row));
      CHECK_EQUAL(row.label == Label::kSlip, m.slip[idx(i)] != 0);
      LONGS_EQUAL(i < 32 ? 3 : 0, row.trial);
      for (int c = 0; c < set.size(); ++c) LONGS_EQUAL(row.x[set.members[idx(c)]], m.at(i)[idx(c)]);
    }
  }
}

// Two classes 2 deviations apart in each of d features are 2 sqrt(d) apart: even with two features 92 % is possible.
TEST(Learners, EachLearnsWhatCanBeLearned) {
  const Matrix train = judged_rows(60, 1, 3.0);
  const Matrix test = judged_rows(40, 100, 3.0);
  for (const Kind kind : kKinds) {
    Settings settings;
    settings.kind = kind;
    settings.min_leaf = 10;
    const auto learner = fitted(settings, train);
    CHECK_TRUE(right(learner->predict(test), test) > 0.95);
    CHECK_EQUAL(kind == Kind::kTree, learner->tree().has_value());
    Matrix none;
    none.set = train.set;
    LONGS_EQUAL(0, learner->predict(none).size());
  }
}

TEST(Learners, RefuseWhatCannotBeLearned) {
  const Matrix good = judged_rows(4, 1, 3.0);
  Matrix none;
  none.set = good.set;
  Matrix slip_only = good;
  slip_only.slip.assign(good.slip.size(), 1);
  Matrix hold_only = good;
  hold_only.slip.assign(good.slip.size(), 0);
  Matrix weightless = good;
  weightless.weight.assign(good.slip.size(), 0.0F);
  Matrix one_sided = good;  // the slips are there and weigh nothing
  for (const std::uint8_t slip : good.slip) one_sided.weight.push_back(slip != 0 ? 0.0F : 1.0F);
  Matrix negative = good;
  negative.weight.assign(good.slip.size(), 1.0F);
  negative.weight[3] = -1.0F;
  Matrix not_finite = negative;
  not_finite.weight[3] = std::numeric_limits<float>::quiet_NaN();
  Matrix too_few = good;
  too_few.weight = {1.0F};
  struct Case {
    const Matrix& rows;
    const char* what;
  };
  const Case cases[] = {{none, "no rows"},
                        {slip_only, "all rows are slip"},
                        {hold_only, "all rows are hold"},
                        {weightless, "weigh nothing"},
                        {one_sided, "all rows are hold"},
                        {negative, "negative"},
                        {not_finite, "not finite"},
                        {too_few, "not every row"}};
  for (const Kind kind : kKinds) {
    Settings settings;
    settings.kind = kind;
    for (const Case& c : cases) {
      const auto error = make_learner(settings)->fit(c.rows);
      CHECK_TRUE(error.has_value());
      STRCMP_CONTAINS(c.what, error->c_str());
    }
    CHECK_FALSE(make_learner(settings)->tree().has_value());
  }
}

TEST(Learners, TreesAreModelsThatTheCompilerTakes) {
  const Matrix rows = judged_rows(60, 5, 1.0);
  for (const double slip_weight : {0.2, 1.0, 3.0}) {
    Settings settings;
    settings.min_leaf = 5;
    settings.slip_weight = slip_weight;
    const auto learner = fitted(settings, rows);
    auto model = learner->tree();
    CHECK_TRUE(model.has_value());
    const auto problem = treec::check(*model);
    if (problem) FAIL(problem->what.c_str());
    CHECK_TRUE(treec::depth(*model) <= settings.max_depth);
    for (const treec::Node& node : model->nodes) {
      if (node.is_leaf) continue;
      const treec::Node& a = model->nodes[idx(node.child_true)];
      const treec::Node& b = model->nodes[idx(node.child_false)];
      CHECK_TRUE(!a.is_leaf || !b.is_leaf || a.verdict != b.verdict);
    }
    check_same_as_tree(*learner, *model, rows);
    model->name = "test";
    const model::Tree table = treec::to_table(*model);
    for (int i = 0; i < rows.height(); ++i) CHECK_TRUE(model::evaluate(table, rows.at(i)) == walk(*model, rows.at(i)));
  }
}

TEST(Learners, NearestNeighbourIsTheNearest) {
  const Matrix train = judged_rows(12, 1, 1.0);
  const Matrix test = judged_rows(8, 50, 1.0);
  Settings settings;
  settings.kind = Kind::kKnn;
  const std::vector<std::uint8_t> said = fitted(settings, train)->predict(test);
  std::vector<double> mean(idx(train.width()));
  std::vector<double> deviation(idx(train.width()));
  for (std::size_t c = 0; c < mean.size(); ++c) {
    for (int i = 0; i < train.height(); ++i) mean[c] += train.at(i)[c] / static_cast<double>(train.height());
    for (int i = 0; i < train.height(); ++i) deviation[c] += std::pow(train.at(i)[c] - mean[c], 2) / train.height();
    deviation[c] = std::sqrt(deviation[c]);
  }
  for (int i = 0; i < test.height(); ++i) {
    double least = 1e300;
    std::uint8_t nearest = 0;
    for (int k = 0; k < train.height(); ++k) {
      double distance = 0.0;
      for (std::size_t c = 0; c < mean.size(); ++c) {
        distance += std::pow((static_cast<double>(test.at(i)[c]) - train.at(k)[c]) / deviation[c], 2);
      }
      if (distance >= least) continue;
      least = distance;
      nearest = train.slip[idx(k)];
    }
    LONGS_EQUAL(nearest, said[idx(i)]);
  }
}

// 20 hold to 1 slip, one deviation apart: without weights the safest answer would be nearly always hold.
TEST(Learners, WeightsMoveTheVerdicts) {
  std::mt19937_64 random(6);
  std::normal_distribution<double> noise;
  Matrix m;
  m.set = find_feature_set("entropy");
  for (int i = 0; i < 2100; ++i) {
    const int slip = i % 21 == 0 ? 1 : 0;
    test::add_row(m,
                  {test::feature_at(m.set->members[0], 20 * noise(random) + 20 * slip),
                   test::feature_at(m.set->members[1], 20 * noise(random) + 20 * slip)},
                  slip);
  }
  Settings settings;
  settings.max_depth = 4;
  const long balanced = slips(fitted(settings, m)->predict(m));
  settings.slip_weight = 0.3;
  const long careful = slips(fitted(settings, m)->predict(m));
  settings.slip_weight = 3.0;
  const long eager = slips(fitted(settings, m)->predict(m));
  CHECK_TRUE(balanced > 300 && balanced < 1050);
  CHECK_TRUE(careful < balanced && balanced < eager);
  Matrix weighted = m;
  for (const std::uint8_t slip : m.slip) weighted.weight.push_back(slip != 0 ? 20.0F : 1.0F);
  settings.slip_weight = 1.0;
  LONGS_EQUAL(balanced, slips(fitted(settings, weighted)->predict(m)));  // the classes are levelled out either way
}
