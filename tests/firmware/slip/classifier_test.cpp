// SPDX-License-Identifier: Apache-2.0
#include "slip/classifier.hpp"

#include <array>
#include <chrono>
#include <cmath>
#include <random>
#include <vector>
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

std::int32_t raw_of(const FeatureSet& set, int i, const Features& features) {
  return set[i].read(features);
}

// Of an object with relief in contact.
Features in_contact(int motion, int growth, int dilation_ppm_s, int flow_residual_um_s) {
  Features seen;
  seen.contact = Count::from_raw(1);
  seen.rates_valid = true;
  seen.imprint.patches = Count::from_raw(40);
  seen.imprint.motion = Log2Q8::from_raw(motion);
  seen.imprint.growth = Log2Q8::from_raw(growth);
  seen.field.dilation_rate = StrainPpmPerSec::from_raw(dilation_ppm_s);
  seen.field.flow_residual = MicrometresPerSec::from_raw(flow_residual_um_s);
  return seen;
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
  classifier::State state;
  for (const Micros from : {3600s, 0s}) {
    for (int k = 0; k < 4; ++k) CHECK_TRUE(classifier::judge(state, {}, nearly, from + k * 40ms) == Verdict::kHold);
  }
  CHECK_TRUE(classifier::judge(state, {}, nearly, 160ms) == Verdict::kSlipNow);
}

// Against the whole history, by the rules in words: slip by the model, or in every frame of 140 ms and more, no two of
// them more than 150 ms apart, motion of more than 1/1.54 of what the model asks. Neither in a press: a frame that
// slips but for its growth, and those behind it of which each falls by 64 / 256 octaves or more.
TEST(Classifier, WhatNearlySlipsForALagIsSlip) {
  using namespace std::chrono_literals;
  const std::int32_t asked = slip_tree::kFirst[0].threshold;  // of the imprint, log2 um in Q8
  std::mt19937 random(5);
  const auto in = [&](int from, int to) { return std::uniform_int_distribution(from, to)(random); };
  int by_model = 0;
  int by_lasting = 0;
  int by_falling = 0;
  for (int round = 0; round < 1000; ++round) {
    classifier::State state;
    std::vector<Micros> times;
    std::vector<bool> nearly;
    std::vector<bool> begins_press;
    std::vector<int> motions;
    Micros now = 1s;
    for (int k = 0; k < 60; ++k) {
      now += std::chrono::milliseconds(in(0, 15) == 0 ? in(145, 156) : in(16, 60));
      Features seen;
      seen.contact = Count::from_raw(1);
      seen.imprint.patches = Count::from_raw(20);
      const bool presses = in(0, 25) == 0;
      const std::int32_t below = presses ? in(-300, 200) : in(0, 6) == 0 ? in(-200, 200) : in(100, 161);
      seen.imprint.motion = Log2Q8::from_raw(asked - below);
      seen.imprint.growth = Log2Q8::from_raw(presses ? in(32, 90) : in(-50, 31));
      const bool grows = seen.imprint.growth.raw() > 31;
      times.push_back(now);
      motions.push_back(asked - below);
      begins_press.push_back(grows && below < 0);
      std::size_t press = times.size() - 1;
      while (press > 0 && !begins_press[press] && motions[press] <= motions[press - 1] - 64 &&
             times[press] - times[press - 1] <= 150ms)
        --press;
      const bool pressed = begins_press[press];
      const bool slips = !grows && below < 0 && !pressed;
      nearly.push_back(!grows && below < 160 && !pressed);
      std::size_t first = times.size();
      while (first > 0 && nearly[first - 1] && (first == times.size() || times[first] - times[first - 1] <= 150ms))
        --first;
      const bool lasted = first < times.size() && now - times[first] >= 140ms;
      const Verdict verdict = classifier::judge(state, {}, seen, now);
      CHECK_TRUE((verdict == Verdict::kSlipNow) == (slips || lasted));
      CHECK_TRUE(verdict != Verdict::kSlip);
      by_model += slips ? 1 : 0;
      by_lasting += lasted && !slips ? 1 : 0;
      by_falling += pressed && !grows && below < 0 ? 1 : 0;
    }
  }
  CHECK_TRUE(by_model > 100 && by_lasting > 500 && by_falling > 20);
}

// A flat box that slides at 5 and at 100 mm/s, as the firmware measured it, behind a contact that has settled; each
// bound.
TEST(Classifier, AShadingThatGrowsUnderASlideIsSlip) {
  using namespace std::chrono_literals;
  struct Frame {
    int motion;
    int growth;
    int turnover = 0;
    int dilation_ppm_s = 0;
    int flow_residual_um_s = 0;
  };
  constexpr Frame kMade{1000, 98}, kStill{1000, 31};
  const auto last_slips = [](const std::vector<Frame>& frames, bool raised = false) {
    classifier::State state;
    Verdict verdict{};
    Micros now = 1s;
    for (const Frame& frame : frames) {
      Features seen = in_contact(frame.motion, frame.growth, frame.dilation_ppm_s, frame.flow_residual_um_s);
      seen.imprint.turnover = ShareQ10::from_raw(frame.turnover);
      verdict = classifier::judge(state, {}, seen, now += 40ms, raised);
    }
    return verdict == Verdict::kSlipNow;
  };
  const auto settled = [&](const Frame& frame) { return last_slips({kMade, kStill, kStill, kStill, frame}); };
  CHECK_TRUE(settled({1944, 118, 500, -9992, 1091}));
  CHECK_TRUE(settled({2078, 170, 977, 23'533, 682}));
  CHECK_TRUE(settled({2012, 98, 732, 48'000, 2212}));
  const std::int32_t twice = slip_tree::kFirst[0].threshold + 256;
  CHECK_TRUE(settled({twice + 1, 65, 412}));
  CHECK_FALSE(settled({twice, 65, 412}));
  CHECK_FALSE(settled({twice + 1, 65, 411}));
  CHECK_TRUE(settled({2000, 98, 700, 50'000, 1000}));
  CHECK_FALSE(settled({2000, 98, 700, 50'001, 1000}));
  CHECK_FALSE(last_slips({kMade, kStill, kStill, {2000, 98, 700}}));
  CHECK_FALSE(last_slips({kMade, kStill, kStill, {1000, 32}, {2000, 98, 700}}));
  CHECK_TRUE(last_slips({kMade, kStill, kStill, kStill, {1000, 32}, {2000, 98, 700}}));  // it has settled once
  CHECK_FALSE(last_slips({kMade, kStill, kStill, kStill, {2000, 98, 700}}, true));
  // Spread by something that presses, 160 and 200 ms ago.
  CHECK_FALSE(last_slips({{1000, 0, 0, 1}, kStill, kStill, kStill, {2000, 98, 700}}));
  CHECK_TRUE(last_slips({{1000, 0, 0, 1}, kStill, kStill, kStill, kStill, {2000, 98, 700}}));
}

// Frames of simulated closings, as the firmware measured them. What moves on behind a press, or moves again, slips.
TEST(Classifier, WhatIsOfAPressIsNoSlip) {
  using namespace std::chrono_literals;
  struct Frame {
    int motion;
    int growth;
    int dilation_ppm_s = 0;
    int flow_residual_um_s = 100;
    int flow_along_q10 = 901;
    int flow_shift_um_s = 0;
  };
  const auto verdicts = [](std::initializer_list<Frame> frames, Micros period = 40ms, bool raised = false) {
    classifier::State state;
    std::vector<bool> slips;
    Micros now = 1s;
    for (const Frame& frame : frames) {
      Features seen = in_contact(frame.motion, frame.growth, frame.dilation_ppm_s, frame.flow_residual_um_s);
      seen.field.flow_along = ShareQ10::from_raw(frame.flow_along_q10);
      seen.field.flow_shift = MicrometresPerSec::from_raw(frame.flow_shift_um_s);
      slips.push_back(classifier::judge(state, {}, seen, now += period, raised) == Verdict::kSlipNow);
    }
    return slips;
  };
  using Slips = std::vector<bool>;
  // What falls by a sixth and more behind a frame whose growth alone spoke against slip.
  CHECK_TRUE(verdicts({{1947, 97}, {1865, 63}, {1560, 20}, {1490, 3}}) == Slips(4));
  CHECK_TRUE(verdicts({{1947, 97}, {1865, 63}, {1802, 20}, {1802, 3}}) == (Slips{false, false, true, true}));
  CHECK_TRUE(verdicts({{1947, 97}, {1865, 63}, {1560, 20}, {1561, 3}}) == (Slips{false, false, false, true}));
  CHECK_TRUE(verdicts({{1865, 63}, {1560, 20}}, 151ms) == (Slips{false, true}));  // not in a row
  CHECK_TRUE(verdicts({{1865, 63}, {1560, 20, 0, 300}}) == Slips(2));
  CHECK_TRUE(verdicts({{1865, 63}, {1560, 20, 0, 301}}) == (Slips{false, true}));
  CHECK_TRUE(verdicts({{1480, 63}, {1600, 20}}) == (Slips{false, true}));  // slow enough with any growth
  // Markers that open; each bound.
  CHECK_TRUE(verdicts({{1874, -58, 11'025, 145}, {1963, -118, 11'850, 151}}) == Slips(2));
  CHECK_TRUE(verdicts({{1874, 0, 6001}}) == Slips(1));
  CHECK_TRUE(verdicts({{1874, 0, 6000}}) == Slips(1, true));
  CHECK_TRUE(verdicts({{1874, 0, 6001, 100, 900}}) == Slips(1, true));
  CHECK_TRUE(verdicts({{1874, 0, 6001, 100, 901, 99}}) == Slips(1));
  CHECK_TRUE(verdicts({{1874, 0, 6001, 100, 901, 100}}) == Slips(1, true));
  CHECK_TRUE(verdicts({{1874, 0, 6001}}, 40ms, true) == Slips(1, true));
  // Markers that close, back along their displacements, and not as one; then they stand still.
  CHECK_TRUE(verdicts({{1874, 0, -6001, 100, -901, 49}, {1807, -28, 0, 60}, {1807, 0, 0, 61}}) ==
             (Slips{false, false, true}));
  CHECK_TRUE(verdicts({{1874, 0, -6000, 100, -901, 49}}) == Slips(1, true));
  CHECK_TRUE(verdicts({{1874, 0, -6001, 100, -900, 49}}) == Slips(1, true));
  CHECK_TRUE(verdicts({{1874, 0, -6001, 100, -901, 50}}) == Slips(1, true));
  CHECK_TRUE(verdicts({{1874, 0, -6001, 100, 901, 49}}) == Slips(1, true));
  // They stand still, and the lag still shows the press; up to its end, and no longer than they stand still.
  const Frame press{0, 593, 20'017, 205};
  CHECK_TRUE(verdicts({press, {1807, -28, 1483, 21}, {1807, 0, 0, 60}, {1807, 0, 0, 61}}) ==
             (Slips{false, false, false, true}));
  CHECK_TRUE(verdicts({press, {0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}, {1807, 0, 0, 0}, {1807, 0, 0, 0}}) ==
             (Slips{false, false, false, false, false, true}));
  // Nothing lasts while it is pressed.
  const Frame nearly{1400, 0};
  CHECK_TRUE(verdicts({nearly, nearly, nearly, nearly, nearly}) == (Slips{false, false, false, false, true}));
  CHECK_TRUE(verdicts({nearly, nearly, {1400, 0, 6001}, nearly, nearly, nearly}) == Slips(6));
}

// Each bound of the compiled model from both sides: a fifth of the relief, and a quarter of an octave either way.
TEST(Classifier, AnotherReliefIsSlipWhileItsShadingStays) {
  const auto says = [&](std::int32_t turnover, std::int32_t growth) {
    features.imprint.turnover = ShareQ10::from_raw(turnover);
    features.imprint.growth = Log2Q8::from_raw(growth);
    return classifier::classify({}, features);
  };
  CHECK_TRUE(says(205, 0) == Verdict::kHold && says(206, 0) == Verdict::kSlipNow);
  CHECK_TRUE(says(1024, 64) == Verdict::kSlipNow && says(1024, 65) == Verdict::kHold);
  CHECK_TRUE(says(1024, -64) == Verdict::kSlipNow && says(1024, -65) == Verdict::kHold);
  // Motion that counts while the shading does not grow needs no other relief; where it grows a little, it does.
  features.imprint.motion = Log2Q8::from_raw(1600);
  CHECK_TRUE(says(0, -65) == Verdict::kSlipNow && says(0, 40) == Verdict::kHold && says(206, 40) == Verdict::kSlipNow);
}

// Of small shifts turnover goes by the square: half and twice the motion, a quarter and four times the share.
TEST(Classifier, TurnoverIsScaledByTheSquareOfTheMotion) {
  const auto scaled = [&](std::int32_t turnover, std::int32_t by_q8) {
    features.imprint.turnover = ShareQ10::from_raw(turnover);
    return classifier::scaled(features, by_q8).imprint.turnover.raw();
  };
  LONGS_EQUAL(400, scaled(100, 256));
  LONGS_EQUAL(25, scaled(100, -256));
  LONGS_EQUAL(1024, scaled(300, 256));
  LONGS_EQUAL(0, scaled(0, 1024));
  DOUBLES_EQUAL(100.0 * std::exp2(320.0 / 256.0), scaled(100, 160), 2.0);
  features.imprint.turnover = ShareQ10::from_raw(900);
  CHECK_TRUE(classifier::for_a_step({}, features) == Verdict::kSlipNow);
  features.imprint.turnover = ShareQ10::from_raw(800);
  CHECK_TRUE(classifier::for_a_step({}, features) == Verdict::kHold);
  features.imprint.turnover = ShareQ10::from_raw(60);
  CHECK_TRUE(classifier::goes_on({}, features));
  features.imprint.turnover = ShareQ10::from_raw(40);
  CHECK_FALSE(classifier::goes_on({}, features));
  features.imprint.blind = true;  // says nothing, also not that it has ended
  CHECK_TRUE(classifier::goes_on({}, features));
  CHECK_TRUE(classifier::classify({}, features) == Verdict::kHold);
}

TEST(Classifier, AModelThatSeesNoPictureIsAskedOnce) {
  const FeatureSet& paper = *find_feature_set("paper");
  const model::Tree tree = slip_up_to(paper, 0, 100);
  classifier::State state;
  for (int k = 0; k < 10; ++k) {
    CHECK_TRUE(classifier::judge(state, {&tree}, features, Micros{k * 40'000}) == Verdict::kSlip);
    CHECK_TRUE(state.last == classifier::State{}.last);
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
