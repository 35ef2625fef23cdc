// SPDX-License-Identifier: Apache-2.0
#include "slip/evidence.hpp"

#include <cmath>
#include <string>
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using evidence::Shown;

constexpr classifier::Config kCompiled{};

}  // namespace

TEST_GROUP(Evidence) {
  Features features;
  void setup() override {
    features.rates_valid = true;
    features.contact = Count::from_raw(1);
    features.imprint.patches = Count::from_raw(20);
  }
  [[nodiscard]] Evidence decisive() const {
    return evidence::decisive(kCompiled, features, classifier::classify(kCompiled, features));
  }
  // A tree of the paper's set: entropy over `threshold` slips.
  static model::Tree by_entropy(std::int32_t threshold) {
    model::Tree tree;
    tree.set = find_feature_set("paper");
    tree.count = 3;
    tree.nodes[0] = {threshold, 2, 2, model::Kind::kSplit};
    tree.nodes[1] = {.kind = model::Kind::kHold};
    tree.nodes[2] = {.kind = model::Kind::kSlip};
    return tree;
  }
};

TEST(Evidence, ANameThatIsNoFeatureHasTheIndexPastTheLast) {
  LONGS_EQUAL(kFeatureCount, feature_index("nothing"));
  LONGS_EQUAL(evidence::kContactFeature, feature_index("contact"));
}

TEST(Evidence, OfAGelAtRestDecidesNothingAndShowsTheImprint) {
  CHECK_TRUE(decisive() == Evidence::kNone);
  const Shown shown = evidence::show(kCompiled, features, Evidence::kNone, false);
  CHECK_TRUE(shown.evidence == Evidence::kImprint);
  LONGS_EQUAL(0, shown.value_milli);
  DOUBLES_EQUAL(1000 * std::exp2(slip_tree::kFirst[0].threshold / 256.0), static_cast<double>(shown.threshold_milli),
                0.004 * static_cast<double>(shown.threshold_milli));
  STRCMP_EQUAL("um", std::string(shown.unit).c_str());
}

// The model holds on this frame alone: it is slip because as much was there in all frames of a lag.
TEST(Evidence, OfWhatLastsIsTheGroupThatNearlySlips) {
  const auto lasting = [&] { return evidence::decisive(kCompiled, features, Verdict::kSlipNow); };
  features.imprint.motion = Log2Q8::from_raw(slip_tree::kFirst[0].threshold - 100);
  CHECK_TRUE(decisive() == Evidence::kNone && lasting() == Evidence::kImprint);
  features.imprint.motion = {};
  features.imprint.coarse = Log2Q8::from_raw(slip_tree::kFirst[1].threshold - 100);
  features.field.flow_residual = MicrometresPerSec::from_raw(100);
  CHECK_TRUE(decisive() == Evidence::kNone && lasting() == Evidence::kCoarse);
}

TEST(Evidence, IsTheGroupWithoutWhichTheModelHolds) {
  features.imprint.motion = Log2Q8::from_raw(slip_tree::kFirst[0].threshold + 200);
  CHECK_TRUE(decisive() == Evidence::kImprint);
  features.imprint.motion = {};
  // The smooth shape speaks where the markers flow, too.
  features.imprint.coarse = Log2Q8::from_raw(slip_tree::kFirst[1].threshold + 100);
  features.field.flow_residual = MicrometresPerSec::from_raw(800);
  CHECK_TRUE(decisive() == Evidence::kCoarse);
  features.imprint.coarse = {};
  features.imprint.turnover = ShareQ10::from_raw(512);
  CHECK_TRUE(decisive() == Evidence::kTurnover);
  const Shown shown = evidence::show(kCompiled, features, Evidence::kTurnover, false);
  LONGS_EQUAL(50'000, shown.value_milli);
  LONGS_EQUAL(20'000, shown.threshold_milli);
  STRCMP_EQUAL("%", std::string(shown.unit).c_str());
}

// Every path to a slip has evidence, whichever it is: random features, of which many slip.
TEST(Evidence, IsThereForEverySlip) {
  std::uint64_t seed = 20261125;
  const auto draw = [&](std::int32_t low, std::int32_t high) {
    seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return low + static_cast<std::int32_t>((seed >> 33) % static_cast<std::uint64_t>(high - low + 1));
  };
  std::array<int, kEvidenceNames.size()> seen{};
  for (int i = 0; i < 20'000; ++i) {
    features.imprint.motion = Log2Q8::from_raw(draw(0, 1800));
    features.imprint.coarse = Log2Q8::from_raw(draw(0, 1700));
    features.imprint.growth = Log2Q8::from_raw(draw(-60, 80));
    features.imprint.patches = Count::from_raw(draw(0, 20));
    features.imprint.turnover = ShareQ10::from_raw(std::max(draw(-2000, 400), 0));
    features.field.flow_residual = MicrometresPerSec::from_raw(draw(0, 1200));
    features.field.octave_entropy = NatsQ16::from_raw(draw(100'000, 130'000));
    features.field.evenness = ShareQ10::from_raw(draw(300, 1000));
    features.field.unevenness = Log2Q8::from_raw(draw(-300, 200));
    features.field.flow_along = ShareQ10::from_raw(draw(-1000, 1000));
    features.field.flow_steady = ShareQ10::from_raw(draw(-1000, 1000));
    features.field.dilation_rate = StrainPpmPerSec::from_raw(draw(-5000, 5000));
    const Verdict verdict = classifier::classify(kCompiled, features);
    const Evidence found = evidence::decisive(kCompiled, features, verdict);
    CHECK_TRUE((found == Evidence::kNone) == (verdict == Verdict::kHold));
    ++seen[static_cast<std::size_t>(found)];
  }
  for (const Evidence group : {Evidence::kImprint, Evidence::kCoarse, Evidence::kTurnover, Evidence::kMarkers}) {
    CHECK_TEXT(seen[static_cast<std::size_t>(group)] > 50, kEvidenceNames[static_cast<std::size_t>(group)].data());
  }
}

TEST(Evidence, OfALoadedModelIsAskedOfThatModel) {
  const model::Tree tree = by_entropy(65'536);
  features.entropy = NatsQ16::from_raw(98'304);
  const classifier::Config config{&tree};
  const Evidence found = evidence::decisive(config, features, classifier::classify(config, features));
  CHECK_TRUE(found == Evidence::kMarkers);
  const Shown shown = evidence::show(config, features, found, false);
  LONGS_EQUAL(1500, shown.value_milli);
  LONGS_EQUAL(1000, shown.threshold_milli);
  STRCMP_EQUAL("nat", std::string(shown.unit).c_str());
}

// Of what a model never asks there is nothing to show, whatever its set may read.
TEST(Evidence, IsNotShownOfWhatTheModelDoesNotAsk) {
  model::Tree tree = by_entropy(0);
  tree.set = find_feature_set("touch");
  tree.nodes[0] = {0, 2, 17, model::Kind::kSplit};  // contact <= 0
  const classifier::Config config{&tree};
  CHECK_TRUE(classifier::classify(config, features) == Verdict::kSlip);
  CHECK_TRUE(evidence::show(config, features, Evidence::kImprint, false).evidence == Evidence::kNone);
  CHECK_TRUE(evidence::show(config, features, Evidence::kMarkers, false).evidence == Evidence::kNone);
}

TEST(Evidence, OfAFrameThatHoldsIsTheStrongerOfTheTwoImprints) {
  features.imprint.motion = Log2Q8::from_raw(1000);
  features.imprint.coarse = Log2Q8::from_raw(1100);
  CHECK_TRUE(evidence::show(kCompiled, features, Evidence::kNone, false).evidence == Evidence::kCoarse);
  features.imprint.coarse = Log2Q8::from_raw(1000);
  CHECK_TRUE(evidence::show(kCompiled, features, Evidence::kNone, false).evidence == Evidence::kImprint);
}

TEST(Evidence, EveryFeatureBelongsToItsGroup) {
  for (std::uint8_t i = 0; i < kFeatureCount; ++i) {
    const std::string name(kFeatures[i].name);
    const Evidence expected = name == "imprint_log2_um_q8"          ? Evidence::kImprint
                              : name == "imprint_coarse_log2_um_q8" ? Evidence::kCoarse
                              : name == "imprint_turnover_q10"      ? Evidence::kTurnover
                              : name == "imprint_growth_log2_q8" || name == "imprint_patches" || name == "contact"
                                  ? Evidence::kNone
                                  : Evidence::kMarkers;
    CHECK_TRUE_TEXT(evidence::group_of(i) == expected, name.c_str());
  }
}

TEST(Evidence, OfALostContactIsTheContact) {
  features.imprint.patches = Count::from_raw(2);
  const Shown shown = evidence::show(kCompiled, features, Evidence::kNone, true);
  CHECK_TRUE(shown.evidence == Evidence::kContact);
  LONGS_EQUAL(2000, shown.value_milli);
  LONGS_EQUAL(contact::Config{}.end_patches * 1000, shown.threshold_milli);
}

TEST(Evidence, ContactIsEmptyMadeOrHeld) {
  using contact::Phase;
  contact::Contact now;
  CHECK_TRUE(contact::phase_of(now, Log2Q8::from_raw(500)) == Phase::kEmpty);
  now.touching = true;
  CHECK_TRUE(contact::phase_of(now, Log2Q8::from_raw(32)) == Phase::kTouching);
  CHECK_TRUE(contact::phase_of(now, Log2Q8::from_raw(31)) == Phase::kHeld);
}
