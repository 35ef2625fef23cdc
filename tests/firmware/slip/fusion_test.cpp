// SPDX-License-Identifier: Apache-2.0
#include "slip/fusion.hpp"

#include <chrono>
#include <cstdint>
#include <random>
#include <vector>

#include "slip/slip_tree.gen.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using namespace std::chrono_literals;
using fusion::Strength;

constexpr Micros kPeriod = 40ms;

// Imprint over 1000 slips at once; else markers that spread slip with a second frame.
model::Tree plain_tree() {
  const FeatureSet* const set = find_feature_set("touch");
  const auto member = [&](std::string_view name) {
    const std::uint8_t feature = feature_index(name);
    std::uint8_t at = 0;
    while (set->members[at] != feature) ++at;
    return at;
  };
  model::Tree tree;
  tree.set = set;
  tree.count = 5;
  tree.nodes[0] = {1000, 4, member("imprint_log2_um_q8"), model::Kind::kSplit};
  tree.nodes[1] = {100, 3, member("reach_um"), model::Kind::kSplit};
  tree.nodes[2] = {.kind = model::Kind::kHold};
  tree.nodes[3] = {.kind = model::Kind::kSlip};
  tree.nodes[4] = {.kind = model::Kind::kSlipNow};
  return tree;
}

}  // namespace

TEST_GROUP(Fusion) {
  model::Tree tree = plain_tree();
  fusion::Config config;
  fusion::State state;
  void setup() override {
    config.fingers = 2;
    config.alone_q8 = 200;
    config.classifier.loaded = &tree;
  }
  // Of a finger's first frame.
  static fusion::Seen look(const fusion::Config& config, const Features& features, Micros at) {
    classifier::State fresh;
    return fusion::look(config, fresh, features, at);
  }
  // What a finger in contact with relief shows.
  static Features moves(std::int32_t motion_q8) {
    Features features;
    features.contact = Count::from_raw(1);
    features.imprint.patches = Count::from_raw(20);
    features.imprint.motion = Log2Q8::from_raw(motion_q8);
    return features;
  }
  static Features smooth(Features features) {
    features.imprint.patches = {};
    return features;
  }
  static Features spreads() {
    Features features = moves(0);
    features.field.reach = Micrometres::from_raw(101);
    return features;
  }
  static Features away() {
    return {};
  }
  Verdict give(int finger, const Features& features, Micros at) {
    return fusion::update(state, config, finger, true, features, at).verdict;
  }
  // The verdict on the second of two frames, 10 ms apart.
  Verdict both(const Features& left, const Features& right) {
    state = {};
    (void)give(0, left, 0ms);
    return give(1, right, 10ms);
  }
};

TEST(Fusion, GradesAFingerByTheModelsOwnThreshold) {
  struct Case {
    std::int32_t motion_q8;
    Strength strength;
  };
  for (const auto& [motion_q8, strength] : {Case{0, Strength::kNone},
                                            {900, Strength::kNone},
                                            {1000, Strength::kNone},
                                            {1001, Strength::kSlip},
                                            {1200, Strength::kSlip},
                                            {1201, Strength::kStrong},
                                            {8000, Strength::kStrong}}) {
    CHECK_TRUE(strength == look(config, moves(motion_q8), 0ms).strength);
  }
  Features apart = moves(4000);
  apart.contact = {};
  CHECK_TRUE(Strength::kNone == look(config, apart, 0ms).strength);
}

TEST(Fusion, AFingersSlowMotionCountsOnceItHasLasted) {
  // 2^(160 / 256) = 1.54 times 900 in Q8 of octaves is 1060, above the model's 1000: slip, but never strong.
  for (int k = 0; k < 4; ++k) {
    CHECK_TRUE(Verdict::kHold == give(0, moves(900), k * kPeriod));
    CHECK_TRUE(Verdict::kHold == give(1, moves(900), k * kPeriod + 10ms));
  }
  CHECK_TRUE(Verdict::kHold == give(0, moves(900), 160ms));  // lasts on one finger, which the other contradicts
  CHECK_TRUE(Strength::kSlip == state.seen[0].strength);
  CHECK_TRUE(Verdict::kSlipNow == give(1, moves(900), 170ms));
  // Lost from view it begins anew.
  (void)fusion::update(state, config, 0, false, moves(900), 200ms);
  CHECK_TRUE(Verdict::kHold == give(0, moves(900), 240ms));
}

// The compiled model has more conditions around the same threshold.
TEST(Fusion, GradesByTheCompiledModel) {
  config.classifier = {};
  const std::int32_t threshold = slip_tree::kFirst[0].threshold;
  CHECK_TRUE(Strength::kNone == look(config, moves(threshold), 0ms).strength);
  CHECK_TRUE(Strength::kSlip == look(config, moves(threshold + 1), 0ms).strength);
  CHECK_TRUE(Strength::kStrong == look(config, moves(threshold + 201), 0ms).strength);
  Features touched = moves(threshold + 400);
  touched.imprint.growth = Log2Q8::from_raw(300);  // a contact that is being made
  CHECK_TRUE(Strength::kNone == look(config, touched, 0ms).strength);
}

TEST(Fusion, WhatTwoFingersComeTo) {
  const Features still = moves(0);
  const Features slip = moves(1100);
  const Features strong = moves(1300);
  struct Case {
    const char* what;
    Features one, other;
    Verdict verdict;
  };
  const std::vector<Case> cases{
      {"neither moves", still, still, Verdict::kHold},
      {"both slip", slip, slip, Verdict::kSlipNow},
      {"outvoted", slip, still, Verdict::kHold},
      {"strong alone", strong, still, Verdict::kSlipNow},
      {"the other cannot see it", slip, smooth(still), Verdict::kSlipNow},
      {"no relief under either", smooth(slip), smooth(still), Verdict::kHold},
      {"without relief against one that sees", smooth(slip), still, Verdict::kHold},
      {"without relief, both", smooth(slip), smooth(slip), Verdict::kSlipNow},
      {"the other touches nothing", slip, away(), Verdict::kSlipNow},
      {"neither touches", away(), away(), Verdict::kHold},
      {"markers of one", spreads(), still, Verdict::kHold},
      {"markers of both", spreads(), spreads(), Verdict::kSlip},
      {"markers and imprint", spreads(), slip, Verdict::kSlip},
      {"markers, the other touches nothing", spreads(), away(), Verdict::kSlip},
  };
  for (const Case& one : cases) {
    CHECK_TRUE_TEXT(one.verdict == both(one.one, one.other), one.what);
    CHECK_TRUE_TEXT(one.verdict == both(one.other, one.one), one.what);
  }
}

TEST(Fusion, HearsEvidenceForAPeriodAndAMargin) {
  (void)give(0, moves(0), 0ms);
  CHECK_TRUE(Verdict::kHold == give(1, moves(1100), config.oldest));
  CHECK_TRUE(Verdict::kSlipNow == give(1, moves(1100), config.oldest + 1us));  // the other is as if it were not there
}

// A frame that was on its way for longer tells of an earlier time.
TEST(Fusion, TimeDoesNotRunBackBetweenFingers) {
  CHECK_TRUE(Verdict::kSlipNow == give(0, moves(1100), 100ms));
  CHECK_TRUE(Verdict::kSlipNow == give(1, moves(1100), 70ms));
  CHECK_TRUE(state.now == 100ms);
  // One that is older than evidence may be says nothing, of itself either.
  CHECK_TRUE(Verdict::kHold == give(0, moves(0), 300ms));
  CHECK_TRUE(Verdict::kHold == give(1, moves(5000), 150ms));
}

// While slip is raised the grip takes another step for twice the motion, by whichever finger sees it.
TEST(Fusion, StepsFurtherForTwiceTheMotionOfAnyFinger) {
  const auto step = [&](int finger, const Features& features, Micros at) {
    return fusion::update(state, config, finger, true, features, at).step;
  };
  CHECK_TRUE(Verdict::kSlipNow == step(0, moves(1300), 0ms));  // what raises it is the first step
  CHECK_TRUE(Verdict::kHold == step(1, moves(1250), 10ms));    // still slip, by both
  CHECK_TRUE(Verdict::kSlipNow == step(1, moves(1257), 50ms));
  CHECK_TRUE(Verdict::kSlipNow == step(0, moves(1100), 60ms));  // the other one's
  CHECK_TRUE(Verdict::kHold == step(1, moves(1100), 90ms));
}

// A clock that was set back takes what was seen with it: nothing would be young enough for as long as it went back.
TEST(Fusion, GoesOnAfterTheClockStepsBack) {
  (void)give(0, moves(0), 3600s);
  (void)give(1, moves(0), 3600s);
  fusion::restart(state);
  (void)give(0, moves(1100), 10ms);
  CHECK_TRUE(Verdict::kSlipNow == give(1, moves(1100), 20ms));
  const auto request = [&](Micros at) { return fusion::update(state, config, 0, true, moves(0), at).request; };
  CHECK_TRUE(GripRequest::kTighten == request(100ms));
  CHECK_TRUE(GripRequest::kHold == request(230ms));
}

TEST(Fusion, AFingerWithoutARestPositionIsNotHeard) {
  (void)fusion::update(state, config, 0, false, moves(0), 0ms);
  CHECK_TRUE(Verdict::kSlipNow == give(1, moves(1100), 10ms));
}

// A slip that was raised goes on at half of the motion that raises one, by all fingers that are heard; where none was
// raised, half says nothing.
TEST(Fusion, ASlipGoesOnAtHalfOfItsMotion) {
  const auto goes_on = [&](const Features& left, const Features& right) {
    state = {};
    (void)give(0, moves(1300), 0ms);
    for (int k = 1; k < 100; ++k) (void)give(k % 2, k % 2 == 0 ? left : right, k * 10ms);
    return state.decision.raised;
  };
  const Features half = moves(1001 - 256);
  const Features less = moves(1000 - 256);
  CHECK_TRUE(goes_on(half, half));
  CHECK_FALSE(goes_on(less, half));
  CHECK_FALSE(goes_on(half, less));
  CHECK_TRUE(goes_on(half, away()));
  CHECK_FALSE(goes_on(less, away()));
  CHECK_FALSE(goes_on(away(), away()));
  state = {};
  for (int k = 0; k < 100; ++k) CHECK_TRUE(Verdict::kHold == give(0, moves(1000 - 160), k * 10ms));
  CHECK_FALSE(state.decision.raised);
}

// 2 frames in a row of each finger take as long as 2 of one: the request rises with the second frame of the first.
TEST(Fusion, FramesInARowAreEachFingers) {
  config.decision.raise_frames = 2;
  std::vector<bool> raised;
  for (int k = 0; k < 3; ++k) {
    for (int finger = 0; finger < 2; ++finger) {
      const auto result = fusion::update(state, config, finger, true, spreads(), k * kPeriod + finger * 10ms);
      raised.push_back(result.request == GripRequest::kTighten);
    }
  }
  // The first frame is heard alone.
  CHECK_TRUE((raised == std::vector<bool>{false, false, true, true, true, true}));
}

// Written against the classifier and the decision alone, on frames of which many slip.
TEST(Fusion, OfOneFingerIsWhatOneFingerSays) {
  config.fingers = 1;
  config.classifier = {};
  decision::State alone;
  classifier::State judging;
  std::mt19937 random(7);
  int times_raised = 0;
  for (int k = 0; k < 20'000; ++k) {
    const auto in = [&](int from, int to) { return std::uniform_int_distribution(from, to)(random); };
    Features features = moves(in(0, 1600));
    features.rates_valid = true;
    features.imprint.patches = Count::from_raw(in(0, 14));
    features.imprint.growth = Log2Q8::from_raw(in(-50, 120));
    features.imprint.coarse = Log2Q8::from_raw(in(0, 1600));
    features.field.flow_residual = MicrometresPerSec::from_raw(in(0, 3000));
    features.field.octave_entropy = NatsQ16::from_raw(in(90'000, 130'000));
    features.field.reach = Micrometres::from_raw(in(0, 600));
    features.contact = Count::from_raw(in(0, 4) > 0 ? 1 : 0);
    const Micros now = k * kPeriod;
    const bool raised = alone.raised;
    const Features judged = raised ? classifier::while_raised(features) : features;
    if (features.contact.raw() == 0) judging = {};
    const Verdict verdict = features.contact.raw() != 0
                                ? classifier::judge(judging, config.classifier, judged, now, raised)
                                : Verdict::kHold;
    const bool goes_on = alone.raised && features.contact.raw() != 0 && classifier::goes_on({}, judged);
    const GripRequest request = decision::update(alone, config.decision, verdict, now, goes_on);
    const auto result = fusion::update(state, config, 0, true, features, now);
    CHECK_TRUE(verdict == result.verdict);
    const bool steps = verdict != Verdict::kHold && (!raised || classifier::for_a_step({}, judged) != Verdict::kHold);
    CHECK_TRUE(steps == (result.step != Verdict::kHold));
    CHECK_TRUE(request == result.request);
    times_raised += request == GripRequest::kTighten ? 1 : 0;
  }
  CHECK_TRUE(times_raised > 1000 && times_raised < 19'000);
}
