// SPDX-License-Identifier: Apache-2.0
#include "slip/classifier.hpp"

#include <array>
#include <chrono>
#include <random>
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

TEST(Classifier, WhatLastsBeginsAnewWhereTheClockStepsBack) {
  using namespace std::chrono_literals;
  Features nearly;
  nearly.contact = Count::from_raw(1);
  nearly.imprint.patches = Count::from_raw(20);
  nearly.imprint.motion = Log2Q8::from_raw(slip_tree::kFirst[0].threshold - 100);
  classifier::Lasting state;
  for (const Micros from : {3600s, 0s}) {
    for (int k = 0; k < 4; ++k) CHECK_TRUE(classifier::judge(state, {}, nearly, from + k * 40ms) == Verdict::kHold);
  }
  CHECK_TRUE(classifier::judge(state, {}, nearly, 160ms) == Verdict::kSlipNow);
}

// Against the whole history, by the rule in words: slip by the model, or in every frame of 140 ms and more, no two of
// them more than 150 ms apart, motion of more than 1/1.54 of what the model asks.
TEST(Classifier, WhatNearlySlipsForALagIsSlip) {
  using namespace std::chrono_literals;
  const std::int32_t asked = slip_tree::kFirst[0].threshold;  // of the imprint, log2 um in Q8
  std::mt19937 random(5);
  const auto in = [&](int from, int to) { return std::uniform_int_distribution(from, to)(random); };
  int by_model = 0;
  int by_lasting = 0;
  for (int round = 0; round < 300; ++round) {
    classifier::Lasting state;
    std::vector<Micros> times;
    std::vector<bool> nearly;
    Micros now = 1s;
    for (int k = 0; k < 60; ++k) {
      now += std::chrono::milliseconds(in(0, 15) == 0 ? in(145, 156) : in(16, 60));
      Features seen;
      seen.contact = Count::from_raw(1);
      seen.imprint.patches = Count::from_raw(20);
      const std::int32_t below = in(0, 9) == 0 ? in(-40, 200) : in(100, 161);
      seen.imprint.motion = Log2Q8::from_raw(asked - below);
      seen.imprint.growth = Log2Q8::from_raw(in(0, 25) == 0 ? 32 : in(-50, 31));
      const bool grows = seen.imprint.growth.raw() > 31;
      const bool slips = !grows && below < 0;
      times.push_back(now);
      nearly.push_back(!grows && below < 160);
      std::size_t first = times.size();
      while (first > 0 && nearly[first - 1] && (first == times.size() || times[first] - times[first - 1] <= 150ms))
        --first;
      const bool lasted = first < times.size() && now - times[first] >= 140ms;
      const Verdict verdict = classifier::judge(state, {}, seen, now);
      CHECK_TRUE((verdict == Verdict::kSlipNow) == (slips || lasted));
      CHECK_TRUE(verdict != Verdict::kSlip);
      by_model += slips ? 1 : 0;
      by_lasting += lasted && !slips ? 1 : 0;
    }
  }
  CHECK_TRUE(by_model > 100 && by_lasting > 1000);
}

TEST(Classifier, AModelThatSeesNoPictureIsAskedOnce) {
  const FeatureSet& paper = *find_feature_set("paper");
  const model::Tree tree = slip_up_to(paper, 0, 100);
  classifier::Lasting state;
  for (int k = 0; k < 10; ++k) {
    CHECK_TRUE(classifier::judge(state, {&tree}, features, Micros{k * 40'000}) == Verdict::kSlip);
    CHECK_TRUE(state.last == classifier::Lasting{}.last);
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

TEST(Classifier, NeedsTheStagesOfItsTree) {
  for (const FeatureSet& set : kFeatureSets) {
    const model::Tree tree = slip_up_to(set, 0, 0);
    for (const Stage stage : {Stage::kAlways, Stage::kField, Stage::kImprint}) {
      CHECK_EQUAL(reads(set, stage), classifier::needs({&tree}, stage));
    }
  }
  CHECK_EQUAL(reads(classifier::kCompiledSet, Stage::kImprint), classifier::needs({}, Stage::kImprint));
}
