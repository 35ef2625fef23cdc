// SPDX-License-Identifier: Apache-2.0
// Recordings of two fingers: which belong together, their offset, their labels as a hand's, and how thresholds are
// chosen; and the order in which a hand is given two fingers' frames.
#include "toolchain/learn/pairs.hpp"

#include <cmath>
#include <random>
#include <vector>

#include "base/math.hpp"
#include "slip/slip_tree.gen.hpp"
#include "toolchain/play/hand.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using namespace holdfast::learn;

ClipLabels named(const std::string& name) {
  ClipLabels clip;
  clip.name = name;
  return clip;
}

// A shake by hand: bursts of speed with pauses, never the same twice.
std::vector<double> shake(int frames, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<double> speeds;
  double burst = 0.0;
  for (int i = 0; i < frames; ++i) {
    if (random() % 9 == 0) burst = 20'000.0 * static_cast<double>(random() % 100) / 100.0;
    speeds.push_back(burst *= 0.7);
  }
  return speeds;
}

// `later` frames are missing at the start, and the camera sees half as much and its own noise.
std::vector<double> begins_later(const std::vector<double>& speeds, int later, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<double> out;
  for (int i = later; i < static_cast<int>(speeds.size()); ++i) {
    out.push_back(0.5 * (i < 0 ? 0.0 : speeds[idx(i)]) + static_cast<double>(random() % 200));
  }
  return out;
}

}  // namespace

TEST_GROUP(Pairs){};

TEST(Pairs, AreTwoOfTheSameName) {
  const std::vector<ClipLabels> clips{named("mug__exp_num_1__camera_2"),
                                      named("mug__exp_num_2__camera_0"),
                                      named("mug__exp_num_1__camera_0"),
                                      named("cup__exp_num_3__a"),
                                      named("cup__exp_num_3__b"),
                                      named("cup__exp_num_3__c"),
                                      named("alone")};
  const auto pairs = pairs_of(clips);
  LONGS_EQUAL(1, pairs.size());
  LONGS_EQUAL(2, pairs[0][0]);  // camera_0 is the left
  LONGS_EQUAL(0, pairs[0][1]);
}

TEST(Pairs, TheOffsetIsWhereTheFingersMoveAlike) {
  const std::vector<double> left = shake(450, 1);
  for (const int later : {0, 1, 5, 17, -4, -17}) {
    const Offset found = find_offset(left, begins_later(left, later, 2));
    LONGS_EQUAL(-later, found.frames);
    CHECK_TRUE(found.correlation > 0.7);
  }
  // Further than a 25th of the recording it does not look, unless it is told to, and then no further than a quarter.
  for (const int later : {40, 80, -40, -80}) {
    const std::vector<double> right = begins_later(left, later, 2);
    CHECK_TRUE(std::abs(find_offset(left, right).frames) <= 18);
    LONGS_EQUAL(-later, find_far_offset(left, right).frames);
  }
  CHECK_TRUE(std::abs(find_far_offset(left, begins_later(left, 110, 2)).frames) <= 85);
  LONGS_EQUAL(find_offset(left, begins_later(left, 5, 2)).frames,
              find_far_offset(left, begins_later(left, 5, 2)).frames);
  CHECK_TRUE(find_far_offset(left, shake(450, 3)).correlation < kDoubtful);
  LONGS_EQUAL(0, find_offset({}, {}).frames);
  LONGS_EQUAL(0, find_far_offset({}, {}).frames);
}

TEST(Pairs, LabelsOfAHandInTheLeftsFrames) {
  ClipLabels left = named("mug__exp_num_1__camera_0");
  left.object = "mug";
  left.contact = Frames{10, kUnknownEnd};
  left.slip = Frames{50, 60};
  left.onset_recorded = true;
  left.silent = {{{12, 40}, Confidence::kHigh}, {{70, 90}, Confidence::kHigh}};
  left.empty = {{0, 9}};
  left.event = Frames{100, 110};
  left.event_kind = "load_step";
  ClipLabels right = named("mug__exp_num_1__camera_2");
  right.contact = Frames{10, 120};
  right.slip = Frames{46, 55};
  right.slip_kind = "loss";
  right.onset_recorded = true;
  right.silent = {{{14, 80}, Confidence::kMedium}};
  right.empty = {{0, 8}};
  right.event = Frames{80, 84};
  right.event_kind = "second_slip_loss";
  right.confidence = Confidence::kMedium;

  const ClipLabels hand = merged(left, right, 2);  // the right's frame 2 is the left's frame 0
  STRCMP_EQUAL("mug__exp_num_1", hand.name.c_str());
  LONGS_EQUAL(8, hand.contact->from);
  LONGS_EQUAL(kUnknownEnd, hand.contact->to);
  LONGS_EQUAL(44, hand.slip->from);
  LONGS_EQUAL(60, hand.slip->to);
  STRCMP_EQUAL("loss", hand.slip_kind.c_str());
  LONGS_EQUAL(2, hand.silent.size());
  LONGS_EQUAL(12, hand.silent[0].from);
  LONGS_EQUAL(40, hand.silent[0].to);
  LONGS_EQUAL(70, hand.silent[1].from);
  LONGS_EQUAL(78, hand.silent[1].to);
  CHECK_TRUE(hand.silent[0].confidence == Confidence::kMedium);
  LONGS_EQUAL(1, hand.empty.size());
  LONGS_EQUAL(6, hand.empty[0].to);
  STRCMP_EQUAL("second_slip_loss", hand.event_kind.c_str());
  LONGS_EQUAL(78, hand.event->from);  // not the left's load step
  LONGS_EQUAL(82, hand.event->to);
  CHECK_TRUE(hand.confidence == Confidence::kMedium);
  CHECK_TRUE(hand.onset_recorded);

  // It began before the recording did, on one finger: no onset.
  right.slip = Frames{0, 55};
  right.onset_recorded = false;
  CHECK_FALSE(merged(left, right, 2).onset_recorded);
}

TEST(Pairs, ThresholdsAreChosenByDetectionThenAlarms) {
  const FusionScore left{30, 38, 1, 20};
  const FusionScore right{32, 37, 0, 20};
  // within 5, within 10, quiet, whole
  const std::vector<FusionScore> settings{
      {39, 39, 1, 5},   // an alarm in silence
      {31, 39, 0, 10},  // detects less than the right finger within 5
      {36, 37, 0, 10},  // and less than the left within 10
      {36, 38, 0, 21},  // more alarms than a standard error above 16
      {34, 38, 0, 20},  //
      {35, 38, 0, 20},  // this one
      {35, 39, 0, 18},  //
      {33, 38, 0, 16},  // the fewest
  };
  LONGS_EQUAL(5, choose(settings, left, right));
  // Where none detects as much, the one that misses the fewest.
  LONGS_EQUAL(1, choose(std::vector<FusionScore>{{30, 38, 0, 1}, {31, 38, 3, 9}}, left, right));
}

// Only one right frame shows a motion; it reaches the hand with the left frame of the same time, or with the next where
// the right's frames come later.
TEST(Pairs, AHandIsGivenFramesInTheOrderOfTheirTimes) {
  const auto fine = [](int frame) {
    pipeline::Result out;
    out.timestamp = Micros(1'000'000 + 40'000 * frame);
    out.referenced = true;
    out.grid = {7, 9};
    out.features.markers = 63;
    out.features.contact = Count::from_raw(1);
    out.features.imprint.patches = Count::from_raw(20);
    return out;
  };
  const auto first_slip = [&](int offset, Micros later) {
    std::vector<pipeline::Result> right;
    right.reserve(60);
    for (int frame = 0; frame < 60; ++frame) right.push_back(fine(frame + 1000));  // another clock
    right[30].features.imprint.motion = Log2Q8::from_raw(slip_tree::kFirst[0].threshold + 600);
    tool::HandPlayer hand(fingers::config_of(2, {}, {}), right, offset, later);
    int frame = 0;
    while (frame < 60 && !hand.step(fine(frame)).result.hand.slip) ++frame;
    return frame;
  };
  LONGS_EQUAL(30, first_slip(0, Micros{0}));
  LONGS_EQUAL(27, first_slip(3, Micros{0}));
  LONGS_EQUAL(35, first_slip(-5, Micros{0}));
  LONGS_EQUAL(31, first_slip(0, Micros{10'000}));
  LONGS_EQUAL(28, first_slip(3, Micros{39'000}));
}
