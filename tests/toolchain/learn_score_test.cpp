// SPDX-License-Identifier: Apache-2.0
// The regression behind the marker score against closed forms and plain gradient descent; the score in integers against
// the regression; and that it stands only where it belongs.
#include "toolchain/learn/score.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "base/math.hpp"
#include "tests/support/learn_data.hpp"
#include "toolchain/learn/evaluate.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

struct Data {
  int width = 0;
  std::vector<double> x;
  std::vector<std::uint8_t> slip;
  std::vector<double> weight;

  void add(std::initializer_list<double> row, int is_slip, double weighs = 1.0) {
    width = static_cast<int>(row.size());
    x.insert(x.end(), row);
    slip.push_back(static_cast<std::uint8_t>(is_slip));
    weight.push_back(weighs);
  }
  [[nodiscard]] Logistic fit(double ridge) const { return fit_logistic(x, width, slip, weight, ridge); }
};

double probability(double log_odds) {
  return 1.0 / (1.0 + std::exp(-log_odds));
}

// Rows of a known law: normal columns of these deviations, ln of the odds = bias + weights x.
Data drawn(int rows, double bias, const std::vector<double>& weights, const std::vector<double>& deviations,
           std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  Data data;
  data.width = static_cast<int>(weights.size());
  for (int r = 0; r < rows; ++r) {
    double z = bias;
    for (std::size_t c = 0; c < weights.size(); ++c) {
      data.x.push_back(5.0 + deviations[c] * normal(random));
      z += weights[c] * data.x.back();
    }
    data.slip.push_back(uniform(random) < probability(z) ? 1 : 0);
    data.weight.push_back(1.0);
  }
  return data;
}

// The oracle: the same loss, written down anew, gone down step by step. Columns of any scale; the ridge counts each
// weight times its column's deviation.
Logistic descended(const Data& data, double ridge) {
  const auto width = static_cast<std::size_t>(data.width);
  const std::size_t rows = data.slip.size();
  const double all = std::accumulate(data.weight.begin(), data.weight.end(), 0.0);
  std::vector<double> mean(width);
  std::vector<double> deviation(width);
  for (std::size_t c = 0; c < width; ++c) {
    double sum = 0.0;
    double squares = 0.0;
    for (std::size_t r = 0; r < rows; ++r) {
      const double x = data.x[r * width + c];
      sum += data.weight[r] * x;
      squares += data.weight[r] * x * x;
    }
    mean[c] = sum / all;
    deviation[c] = std::sqrt(squares / all - mean[c] * mean[c]);
  }
  std::vector<double> weights(width);
  double bias = 0.0;
  for (int step = 0; step < 20'000; ++step) {
    std::vector<double> down(width);
    double down_bias = 0.0;
    for (std::size_t r = 0; r < rows; ++r) {
      double z = bias;
      for (std::size_t c = 0; c < width; ++c) z += weights[c] * (data.x[r * width + c] - mean[c]) / deviation[c];
      const double off = data.weight[r] * (probability(z) - data.slip[r]) / all;
      for (std::size_t c = 0; c < width; ++c) down[c] += off * (data.x[r * width + c] - mean[c]) / deviation[c];
      down_bias += off;
    }
    for (std::size_t c = 0; c < width; ++c) weights[c] -= 1.0 * (down[c] + ridge * weights[c]);
    bias -= 1.0 * down_bias;
  }
  Logistic out{bias, weights, 0};
  for (std::size_t c = 0; c < width; ++c) {
    out.weights[c] /= deviation[c];
    out.bias -= out.weights[c] * mean[c];
  }
  return out;
}

const FeatureSet& scored_set() {
  return *find_feature_set("score");
}

// Trials of 40 rows whose log2 of the odds is `law` of the octaves of two features.
struct Law {
  double bias = 0.0;
  double vx = 0.0;
  double residual = 0.0;
};
Samples lawful(int trials, const Law& law, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform;
  Samples samples;
  for (int t = 0; t < trials; ++t) {
    Trial trial;
    trial.object = t % 2 == 0 ? "ball" : "box";
    trial.kind = "slip";
    trial.first = static_cast<int>(samples.rows.size());
    trial.count = 40;
    for (int k = 0; k < trial.count; ++k) {
      Row row;
      row.trial = t;
      row.frame = k;
      row.t_s = 0.04 * k;
      const double vx_octaves = 4.0 + 8.0 * uniform(random);
      const double residual_octaves = 7.0 + 5.0 * uniform(random);
      row.x[score::index_of("vx_um_s")] =
          static_cast<std::int32_t>(std::exp2(vx_octaves) - 16) * (random() % 2 == 0 ? 1 : -1);
      row.x[score::index_of("residual_um_q4")] = static_cast<std::int32_t>(std::exp2(residual_octaves) - 96);
      const double odds_octaves = law.bias + law.vx * vx_octaves + law.residual * residual_octaves;
      row.label = uniform(random) < probability(odds_octaves * std::numbers::ln2) ? Label::kSlip : Label::kHold;
      samples.rows.push_back(row);
    }
    samples.trials.push_back(trial);
  }
  return samples;
}

constexpr std::array<ScoreInput, 2> kTwo{{{"vx_um_s", 16}, {"residual_um_q4", 96}}};

Settings plain() {
  Settings settings;
  settings.balanced = false;
  return settings;
}

Matrix all_rows(const Samples& samples, const FeatureSet& set) {
  return matrix_of(samples, set, test::all_trials(samples));
}

}  // namespace

TEST_GROUP(LearnScore){};

// One column of 0 and 1 has a closed form: the odds of each value are those of its rows.
TEST(LearnScore, OneBinaryColumnHasTheOddsOfItsRows) {
  Data data;
  for (int i = 0; i < 30; ++i) data.add({0.0}, 0);
  for (int i = 0; i < 10; ++i) data.add({0.0}, 1);
  for (int i = 0; i < 5; ++i) data.add({1.0}, 0);
  for (int i = 0; i < 25; ++i) data.add({1.0}, 1);
  const Logistic fit = data.fit(0.0);
  DOUBLES_EQUAL(std::log(10.0 / 30.0), fit.bias, 1e-6);
  DOUBLES_EQUAL(std::log(25.0 / 5.0) - std::log(10.0 / 30.0), fit.weights[0], 1e-6);
  CHECK(fit.steps < 20);
}

TEST(LearnScore, IsWhereGradientDescentEnds) {
  for (const double ridge : {1e-4, 0.1}) {
    for (std::uint64_t seed = 0; seed < 3; ++seed) {
      Data data = drawn(300, -3.0, {0.8, -1.1, 0.05}, {1.0, 0.4, 6.0}, seed);
      std::mt19937_64 random(seed);
      for (double& weight : data.weight) weight = 0.1 + static_cast<double>(random() % 30) / 10.0;
      const Logistic want = descended(data, ridge);
      const Logistic have = data.fit(ridge);
      // What 20 000 steps leave to go, with curvature of 0.02 at least: e^-400.
      for (std::size_t c = 0; c < 3; ++c) DOUBLES_EQUAL(want.weights[c], have.weights[c], 1e-5);
      DOUBLES_EQUAL(want.bias, have.bias, 1e-5);
    }
  }
}

// Standard errors by Fisher's information: sqrt(1 / (n p(1-p) var)), at 100 000 rows below 0.013; four of them.
TEST(LearnScore, FindsTheLawItsRowsWereDrawnBy) {
  const std::vector<double> weights{0.9, -0.6, 0.0};
  const Logistic fit = drawn(100'000, -1.5, weights, {1.0, 1.0, 1.0}, 5).fit(1e-6);
  for (std::size_t c = 0; c < weights.size(); ++c) DOUBLES_EQUAL(weights[c], fit.weights[c], 0.05);
  DOUBLES_EQUAL(-1.5, fit.bias, 0.35);  // at the origin, 5 deviations away on three columns
}

TEST(LearnScore, AWeightIsAsManyRows) {
  Data weighted;
  Data repeated;
  std::mt19937_64 random(1);
  for (int i = 0; i < 60; ++i) {
    const double x = static_cast<double>(random() % 100) / 10.0;
    const int is_slip = x + static_cast<double>(random() % 60) / 10.0 > 8.0 ? 1 : 0;
    const int times = 1 + static_cast<int>(random() % 4);
    weighted.add({x}, is_slip, times);
    for (int k = 0; k < times; ++k) repeated.add({x}, is_slip);
  }
  const Logistic a = weighted.fit(kRidge);
  const Logistic b = repeated.fit(kRidge);
  DOUBLES_EQUAL(b.weights[0], a.weights[0], 1e-7);
  DOUBLES_EQUAL(b.bias, a.bias, 1e-7);
  weighted.add({1000.0}, 0, 0.0);  // weighs nothing: is not there
  DOUBLES_EQUAL(a.weights[0], weighted.fit(kRidge).weights[0], 1e-7);
}

TEST(LearnScore, ClassesThatAPlanePartsStayFinite) {
  for (const double gap : {0.001, 1.0, 1e6}) {
    Data data;
    for (int i = 0; i < 50; ++i) data.add({-gap - i * 0.01, 3.0}, 0);
    for (int i = 0; i < 50; ++i) data.add({gap + i * 0.01, 3.0}, 1);
    const Logistic fit = data.fit(kRidge);
    CHECK(std::isfinite(fit.weights[0]) && std::isfinite(fit.bias));
    CHECK(fit.weights[0] > 0.0);
    CHECK(fit.steps < 100);
    DOUBLES_EQUAL(0.0, fit.weights[1], 0.0);  // does not vary
    for (std::size_t r = 0; r < data.slip.size(); ++r) {
      CHECK_EQUAL(data.slip[r] != 0, fit.bias + fit.weights[0] * data.x[2 * r] > 0.0);
    }
    // Certain, but not without end: mean loss + ridge / 2 w^2 is at most what w = 0 has, ln 2.
    CHECK(fit.weights[0] * (gap + 0.25) < 2.0 * std::sqrt(2.0 * std::numbers::ln2 / kRidge));
  }
}

TEST(LearnScore, AucIsTheShareOfPairs) {
  std::mt19937_64 random(3);
  for (int round = 0; round < 50; ++round) {
    std::vector<double> values;
    std::vector<std::uint8_t> slip;
    for (int i = 0; i < 40; ++i) {
      slip.push_back(random() % 3 == 0 ? 1 : 0);
      values.push_back(static_cast<double>(random() % 12) + 3.0 * slip.back());
    }
    double won = 0.0;
    double pairs = 0.0;
    for (std::size_t a = 0; a < values.size(); ++a) {
      for (std::size_t b = 0; b < values.size(); ++b) {
        if (slip[a] == 0 || slip[b] != 0) continue;
        pairs += 1.0;
        won += values[a] > values[b] ? 1.0 : values[a] == values[b] ? 0.5 : 0.0;
      }
    }
    DOUBLES_EQUAL(won / pairs, auc_of(values, slip), 1e-12);
  }
  DOUBLES_EQUAL(0.5, auc_of({}, {}), 0.0);
  DOUBLES_EQUAL(0.5, auc_of(std::vector<double>{1, 2}, std::vector<std::uint8_t>{1, 1}), 0.0);
}

// 80 000 rows: standard errors of the weights are below 0.01 octaves per octave, of the bias at the origin below 0.15.
TEST(LearnScore, TheScoreIsTheLawInOctaves) {
  const Law law{-9.0, 0.75, 0.4};
  const Samples samples = lawful(2000, law, 1);
  score::Score score;
  const auto error = fit_score(samples, all_rows(samples, scored_set()), plain(), score, kTwo);
  CHECK_FALSE(error.has_value());
  CHECK(score::is_valid(score));
  LONGS_EQUAL(2, score.count);
  STRCMP_EQUAL("vx_um_s", std::string(kFeatures[score.terms[0].feature].name).c_str());
  LONGS_EQUAL(16, score.terms[0].offset);
  DOUBLES_EQUAL(law.vx * 256, score.terms[0].weight_q8, 8.0);
  STRCMP_EQUAL("residual_um_q4", std::string(kFeatures[score.terms[1].feature].name).c_str());
  LONGS_EQUAL(96, score.terms[1].offset);
  DOUBLES_EQUAL(law.residual * 256, score.terms[1].weight_q8, 8.0);
  DOUBLES_EQUAL(law.bias * 256, score.bias_q8, 130.0);

  // In integers it ranks and parts as the law itself, which no score can beat but by chance (AUC's standard error on
  // 80 000 rows: 0.002).
  std::vector<double> truth;
  const Matrix rows = all_rows(samples, scored_set());
  for (const int r : rows.row) {
    const learn::Features& x = samples.rows[idx(r)].x;
    truth.push_back(law.vx * std::log2(std::abs(x[score::index_of("vx_um_s")]) + 16.0) +
                    law.residual * std::log2(x[score::index_of("residual_um_q4")] + 96.0));
  }
  const ScoreFigures figures = figures_of(samples, score, rows);
  DOUBLES_EQUAL(auc_of(truth, rows.slip), figures.auc, 0.002);
  DOUBLES_EQUAL(best_threshold(truth, rows.slip).balanced_accuracy, figures.balanced_accuracy, 0.005);
  CHECK(figures.auc > 0.75);
}

// Rounding weights to 1/256 moves a score, at 8 octaves from a column's mean, by at most 8/512 octaves a term; the
// bias takes what it moves the mean. The rest is what score.hpp allows for.
TEST(LearnScore, RoundingCostsLittle) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const Samples samples = lawful(100, {-9.0, 0.75, 0.4}, seed);
    const Matrix rows = all_rows(samples, scored_set());
    score::Score score;
    CHECK_FALSE(fit_score(samples, rows, plain(), score, kTwo).has_value());
    Data data;
    data.width = static_cast<int>(kTwo.size());
    data.slip = rows.slip;
    data.weight.assign(rows.slip.size(), 1.0);
    for (const int r : rows.row) {
      for (const ScoreInput& input : kTwo) {
        const double x = samples.rows[idx(r)].x[score::index_of(input.feature)];
        data.x.push_back(std::log2(std::abs(x) + input.offset));
      }
    }
    const Logistic fit = data.fit(kRidge);
    double slack_lsb = 0.5;
    for (const double weight : fit.weights) slack_lsb += 8.0 / 2.0 + 2.0 * std::abs(weight) / std::numbers::ln2;
    double off = 0.0;
    for (std::size_t i = 0; i < rows.row.size(); ++i) {
      double want = fit.bias;
      for (std::size_t c = 0; c < kTwo.size(); ++c) want += fit.weights[c] * data.x[i * kTwo.size() + c];
      want *= 256.0 / std::numbers::ln2;
      const double got = score_of(score, samples.rows[idx(rows.row[i])].x);
      DOUBLES_EQUAL(want, got, slack_lsb);
      off += (got - want) / static_cast<double>(rows.row.size());
    }
    DOUBLES_EQUAL(0.0, off, 1.0);  // the bias is whole, which is half of it, and the mean of log2 as rounded is its own
  }
}

TEST(LearnScore, RowsWeighAsInTheTrees) {
  const Samples samples = lawful(300, {-9.0, 0.75, 0.4}, 2);
  const Matrix rows = all_rows(samples, scored_set());
  const auto bias = [&](const Settings& settings) {
    score::Score score;
    CHECK_FALSE(fit_score(samples, rows, settings, score, kTwo).has_value());
    return score_of(score, samples.rows[0].x) / 256.0;
  };
  // Odds are multiplied by the weight of slip: in octaves, log2 of it is added. Exact only where the law holds exactly;
  // on 12 000 rows weights move by their standard errors, 0.1 octaves at some row.
  Settings rare = plain();
  rare.slip_weight = 0.25;
  DOUBLES_EQUAL(bias(plain()) - 2.0, bias(rare), 0.2);
  const auto slips = static_cast<double>(std::count(rows.slip.begin(), rows.slip.end(), 1));
  Settings balanced;
  DOUBLES_EQUAL(bias(plain()) + std::log2((rows.height() - slips) / slips), bias(balanced), 0.2);
}

TEST(LearnScore, RefusesWhatCannotBeLearned) {
  const Samples good = lawful(20, {-9.0, 0.75, 0.4}, 3);
  const auto refused = [](const Samples& samples, const Matrix& rows) {
    score::Score score;
    score.count = 3;
    const auto error = fit_score(samples, rows, Settings{}, score);
    CHECK(score == score::Score{});
    return error.value_or("");
  };
  Matrix rows = all_rows(good, scored_set());
  STRCMP_EQUAL("",
               [&] {
                 score::Score score;
                 return fit_score(good, rows, Settings{}, score).value_or("");
               }()
                   .c_str());
  rows.slip.assign(rows.slip.size(), 1);
  STRCMP_CONTAINS("all rows are slip", refused(good, rows).c_str());
  rows.slip.assign(rows.slip.size(), 0);
  STRCMP_CONTAINS("all rows are hold", refused(good, rows).c_str());
  Matrix none;
  none.set = &scored_set();
  STRCMP_CONTAINS("no rows", refused(good, none).c_str());
  Samples blind = good;
  for (Row& row : blind.rows) row.x = {};
  STRCMP_CONTAINS("no feature of the markers", refused(blind, all_rows(blind, scored_set())).c_str());
}

TEST(LearnScore, FillsItsColumnAndNoOther) {
  Samples samples = test::grasps(20, 1);
  for (const FeatureSet& set : kFeatureSets) {
    const Matrix before = all_rows(samples, set);
    Matrix train = before;
    score::Score score;
    CHECK_FALSE(fit_and_fill(samples, Settings{}, train, score).has_value());
    CHECK_EQUAL(reads(set, Stage::kScore), score.count > 0);
    for (int i = 0; i < train.height(); ++i) {
      for (int c = 0; c < set.size(); ++c) {
        const learn::Features& x = samples.rows[idx(train.row[idx(i)])].x;
        LONGS_EQUAL(set[c].stage == Stage::kScore ? score_of(score, x) : before.at(i)[idx(c)], train.at(i)[idx(c)]);
      }
    }
    Matrix again = before;
    fill_score(samples, score, again);
    CHECK(score.count == 0 || again.x == train.x);
  }
  // What a file says of the score is of no account.
  score::Score said;
  score::Score silent;
  Matrix rows = all_rows(samples, scored_set());
  CHECK_FALSE(fit_and_fill(samples, Settings{}, rows, said).has_value());
  const std::vector<std::int32_t> column = rows.x;
  for (Row& row : samples.rows) row.x.back() = 4321;
  rows = all_rows(samples, scored_set());
  CHECK_FALSE(fit_and_fill(samples, Settings{}, rows, silent).has_value());
  CHECK(said == silent);
  CHECK(column == rows.x);
}

TEST(LearnScore, AModelSeesItsOwnScore) {
  const Samples samples = lawful(20, {-9.0, 0.75, 0.4}, 3);
  score::Score score;
  CHECK_FALSE(fit_score(samples, all_rows(samples, scored_set()), plain(), score).has_value());
  const std::size_t column = score::index_of("marker_score_log2_q8");
  for (const Row& row : samples.rows) {
    learn::Features want = row.x;
    CHECK(seen_by(score::Score{}, row.x) == want);
    want[column] = score_of(score, row.x);
    CHECK(seen_by(score, row.x) == want);
  }
}
