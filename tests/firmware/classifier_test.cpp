// SPDX-License-Identifier: Apache-2.0
#include "slip/classifier.hpp"

#include <CppUTest/TestHarness.h>

using holdfast::Features;
using holdfast::MicrometresPerSec;
using holdfast::NatsPerSecQ8;
using holdfast::NatsQ16;
using holdfast::Verdict;
namespace classifier = holdfast::classifier;

TEST_GROUP(Classifier) {
  Features features;
  void setup() override {
    features.vx = MicrometresPerSec::from_raw(11);
    features.vy = MicrometresPerSec::from_raw(-22);
    features.entropy = NatsQ16::from_raw(33);
    features.entropy_rate = NatsPerSecQ8::from_raw(-44);
    features.rates_valid = true;
  }
};

TEST(Classifier, ReadsTheFeaturesInTheOrderOfTheSet) {
  CHECK_TRUE((classifier::Inputs{11, -22, 33, -44}) == classifier::inputs(features));
}

TEST(Classifier, ZeroesRatesThatAreNotValid) {
  features.rates_valid = false;
  CHECK_TRUE((classifier::Inputs{0, 0, 33, 0}) == classifier::inputs(features));
}

// True of every tree worth having, whatever its thresholds: a gel at rest does not slip.
TEST(Classifier, HoldsOnAGelAtRest) {
  CHECK_TRUE(Verdict::kHold == classifier::classify({}, Features{}));
}

TEST(Classifier, AnswersAsTheTreeOnTheExtremesOfEveryFeature) {
  for (int corner = 0; corner < 16; ++corner) {
    features.vx = MicrometresPerSec::from_raw((corner & 1) != 0 ? MicrometresPerSec::kMax : MicrometresPerSec::kMin);
    features.vy = MicrometresPerSec::from_raw((corner & 2) != 0 ? MicrometresPerSec::kMax : MicrometresPerSec::kMin);
    features.entropy = NatsQ16::from_raw((corner & 4) != 0 ? NatsQ16::kMax : NatsQ16::kMin);
    features.entropy_rate = NatsPerSecQ8::from_raw((corner & 8) != 0 ? NatsPerSecQ8::kMax : NatsPerSecQ8::kMin);
    const Verdict want = holdfast::slip_tree::evaluate(
        {features.vx.raw(), features.vy.raw(), features.entropy.raw(), features.entropy_rate.raw()});
    CHECK_TRUE(want == classifier::classify({}, features));
  }
}

TEST(Classifier, ALoadedTreeTakesThePlaceOfTheCompiledOne) {
  holdfast::model::Tree loaded;
  loaded.nodes[0] = {.threshold = -1, .feature = 1, .child_true = 1, .child_false = 2, .is_leaf = false};
  loaded.nodes[1] = {.is_leaf = true, .verdict = Verdict::kSlip};
  loaded.nodes[2] = {.is_leaf = true, .verdict = Verdict::kHold};
  CHECK_TRUE(Verdict::kSlip == classifier::classify({&loaded}, features));
  features.rates_valid = false;
  CHECK_TRUE(Verdict::kHold == classifier::classify({&loaded}, features));
}
