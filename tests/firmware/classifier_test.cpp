// SPDX-License-Identifier: Apache-2.0
#include "slip/classifier.hpp"

#include <array>
#include <cmath>
#include <vector>
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

std::int32_t raw_of(const FeatureSet& set, int i, const Features& features) {
  return set[i].read(features);
}

}  // namespace

TEST_GROUP(Classifier) {
  Features features;
  void setup() override {
    features.vx = MicrometresPerSec::from_raw(11);
    features.vy = MicrometresPerSec::from_raw(-22);
    features.entropy = NatsQ16::from_raw(33);
    features.entropy_rate = NatsPerSecQ8::from_raw(-44);
    features.rates_valid = true;
  }
  // A tree of one predicate: feature `i` of the set <= threshold is slip.
  static model::Tree slip_up_to(const FeatureSet& set, int i, std::int32_t threshold) {
    model::Tree tree;
    tree.set = &set;
    tree.count = 3;
    tree.nodes[0] = {threshold, 2, static_cast<std::uint8_t>(i), model::Kind::kSplit};
    tree.nodes[1] = {.kind = model::Kind::kSlip};
    tree.nodes[2] = {.kind = model::Kind::kHold};
    return tree;
  }
  Verdict with(const model::Tree& tree) {
    return classifier::classify({&tree}, features);
  }
};

TEST(Classifier, ReadsTheFeaturesInTheOrderOfTheSet) {
  const classifier::Inputs x = classifier::inputs(features);
  for (int i = 0; i < classifier::kCompiledSet.size(); ++i) {
    LONGS_EQUAL(raw_of(classifier::kCompiledSet, i, features), x[idx(i)]);
  }
}

TEST(Classifier, ZeroesRatesThatAreNotValid) {
  features.rates_valid = false;
  const classifier::Inputs x = classifier::inputs(features);
  for (int i = 0; i < classifier::kCompiledSet.size(); ++i) {
    const FeatureInfo& feature = classifier::kCompiledSet[i];
    LONGS_EQUAL(feature.needs_earlier_frame ? 0 : feature.read(features), x[idx(i)]);
  }
}

// True of every tree worth having, whatever its thresholds: a gel at rest does not slip.
TEST(Classifier, HoldsOnAGelAtRest) {
  CHECK_TRUE(Verdict::kHold == classifier::classify({}, Features{}));
}

TEST(Classifier, AnswersAsTheTreeOnTheExtremesOfThePapersFeatures) {
  for (int corner = 0; corner < 16; ++corner) {
    features.vx = MicrometresPerSec::from_raw((corner & 1) != 0 ? MicrometresPerSec::kMax : MicrometresPerSec::kMin);
    features.vy = MicrometresPerSec::from_raw((corner & 2) != 0 ? MicrometresPerSec::kMax : MicrometresPerSec::kMin);
    features.entropy = NatsQ16::from_raw((corner & 4) != 0 ? NatsQ16::kMax : NatsQ16::kMin);
    features.entropy_rate = NatsPerSecQ8::from_raw((corner & 8) != 0 ? NatsPerSecQ8::kMax : NatsPerSecQ8::kMin);
    classifier::Inputs x{};
    for (int i = 0; i < classifier::kCompiledSet.size(); ++i) x[idx(i)] = raw_of(classifier::kCompiledSet, i, features);
    CHECK_TRUE(slip_tree::evaluate(x) == classifier::classify({}, features));
  }
}

TEST(Classifier, ALoadedTreeOfThePapersSetReadsItsFourFeatures) {
  const FeatureSet& paper = *find_feature_set("paper");
  const std::vector<std::int32_t> values{11, -22, 33, -44};
  for (int i = 0; i < 4; ++i) {
    CHECK_TRUE(Verdict::kHold == with(slip_up_to(paper, i, values[idx(i)] - 1)));
    CHECK_TRUE(Verdict::kSlip == with(slip_up_to(paper, i, values[idx(i)])));
    CHECK_TRUE(Verdict::kSlip == with(slip_up_to(paper, i, values[idx(i)] + 1)));
  }
}

TEST(Classifier, ALoadedTreeMayBeOfAnySet) {
  for (const FeatureSet& set : kFeatureSets) {
    for (int i = 0; i < set.size(); ++i) {
      const std::int32_t value = raw_of(set, i, features);
      CHECK_TRUE(Verdict::kHold == with(slip_up_to(set, i, value - 1)));
      CHECK_TRUE(Verdict::kSlip == with(slip_up_to(set, i, value)));
    }
  }
}

TEST(Classifier, ALoadedTreeSeesRatesOfZeroWhenTheyAreNotValid) {
  features.rates_valid = false;
  for (const FeatureSet& set : kFeatureSets) {
    for (int i = 0; i < set.size(); ++i) {
      const std::int32_t value = set[i].needs_earlier_frame ? 0 : raw_of(set, i, features);
      CHECK_TRUE(Verdict::kHold == with(slip_up_to(set, i, value - 1)));
      CHECK_TRUE(Verdict::kSlip == with(slip_up_to(set, i, value)));
    }
  }
}

TEST(Classifier, AModelWithAScoreFillsIt) {
  model::Tree tree = slip_up_to(*find_feature_set("score"), 0, 0);
  tree.score.count = 3;
  tree.score.bias_q8 = -1000;
  tree.score.terms = {{{score::index_of("vy_um_s"), 300, 16},
                       {score::index_of("entropy_nat_q16"), -200, 5},
                       {score::index_of("residual_um_q4"), 256, 7}}};
  features.field.residual = MicrometresQ4::from_raw(121);
  Saturations saturations;
  classifier::complete({&tree}, features, saturations);
  const double want = -1000 + 300 * std::log2(22.0 + 16.0) - 200 * std::log2(33.0 + 5.0) + 256 * std::log2(128.0);
  DOUBLES_EQUAL(want, features.marker_score.raw(), 0.5 + (300 + 200 + 256) / 256.0);  // score.hpp: rounding
  UNSIGNED_LONGS_EQUAL(0, saturations.count);

  // Without valid rates vy counts as 0; what stands on the frame alone still counts.
  features.rates_valid = false;
  classifier::complete({&tree}, features, saturations);
  const double at_rest = want - 300 * (std::log2(22.0 + 16.0) - 4.0);
  DOUBLES_EQUAL(at_rest, features.marker_score.raw(), 0.5 + (300 + 200 + 256) / 256.0);

  // The tree reads what was filled in, and a clamp is counted.
  const std::int32_t filled = features.marker_score.raw();
  CHECK_TRUE(Verdict::kSlip == with(slip_up_to(*tree.set, 0, filled)));
  CHECK_TRUE(Verdict::kHold == with(slip_up_to(*tree.set, 0, filled - 1)));
  tree.score.bias_q8 = 100'000;
  classifier::complete({&tree}, features, saturations);
  LONGS_EQUAL(Log2Q8::kMax, features.marker_score.raw());
  UNSIGNED_LONGS_EQUAL(1, saturations.count);
}

// As many terms as there may be: eight times log2(0 + 2). In a constant expression, where nothing may be read beyond
// the last of them.
TEST(Classifier, AScoreMayHaveEightTerms) {
  constexpr std::int32_t kFilled = [] {
    model::Tree tree;
    tree.set = find_feature_set("score");
    tree.score.count = score::kMaxTerms;
    for (int i = 0; i < score::kMaxTerms; ++i) tree.score.terms[idx(i)] = {static_cast<std::uint8_t>(i), 256, 2};
    Features at_rest;
    Saturations saturations;
    classifier::complete({&tree}, at_rest, saturations);
    return at_rest.marker_score.raw();
  }();
  LONGS_EQUAL(8 * 256, kFilled);
}

TEST(Classifier, AModelWithoutAScoreFillsNothing) {
  const model::Tree tree = slip_up_to(*find_feature_set("paper"), 0, 0);
  features.marker_score = Log2Q8::from_raw(77);
  Saturations saturations;
  classifier::complete({&tree}, features, saturations);
  LONGS_EQUAL(77, features.marker_score.raw());
  if (slip_tree::kScore.count > 0) return;
  classifier::complete({}, features, saturations);
  LONGS_EQUAL(77, features.marker_score.raw());
}

TEST(Classifier, NeedsTheStagesOfItsTreeAndOfItsScore) {
  for (const FeatureSet& set : kFeatureSets) {
    model::Tree tree = slip_up_to(set, 0, 0);
    for (const Stage stage : {Stage::kAlways, Stage::kField, Stage::kImprint, Stage::kScore}) {
      CHECK_EQUAL(reads(set, stage), classifier::needs({&tree}, stage));
    }
  }
  model::Tree scored = slip_up_to(*find_feature_set("score"), 0, 0);
  scored.score.count = 1;
  scored.score.terms[0] = {score::index_of("vx_um_s"), 1, 1};
  CHECK_TRUE(classifier::needs({&scored}, Stage::kScore));
  CHECK_FALSE(classifier::needs({&scored}, Stage::kField));
  scored.score.count = 2;
  scored.score.terms[1] = {score::index_of("flow_spread_um_s"), 1, 1};
  CHECK_TRUE(classifier::needs({&scored}, Stage::kField));
  CHECK_FALSE(classifier::needs({&scored}, Stage::kImprint));
  CHECK_EQUAL(reads(classifier::kCompiledSet, Stage::kImprint), classifier::needs({}, Stage::kImprint));
}
