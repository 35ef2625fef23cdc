// SPDX-License-Identifier: Apache-2.0
// Frames and events against figures worked out by hand.
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/learn/metrics.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

// One trial at 40 ms a row: labels as h, s, o (upper case: the frame was not accepted), verdicts as 0 and 1.
GraspEvent played(std::string_view labels, std::string_view said, const decision::Config& config = {}) {
  Samples samples;
  Trial before;  // so that the trial's rows do not start at 0
  before.count = 2;
  samples.trials.push_back(before);
  samples.rows.resize(2);
  Trial trial;
  trial.first = 2;
  trial.count = static_cast<int>(labels.size());
  samples.trials.push_back(trial);
  std::vector<std::uint8_t> verdicts;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    Row row;
    row.trial = 1;
    row.frame = static_cast<int>(i);
    row.t_s = 1.0 + 0.04 * static_cast<double>(i);
    row.accepted = labels[i] >= 'a';
    const char label = static_cast<char>(labels[i] | 0x20);
    row.label = label == 'h' ? Label::kHold : label == 's' ? Label::kSlip : Label::kOpen;
    samples.rows.push_back(row);
    verdicts.push_back(said[i] == '1' ? 1 : 0);
  }
  return event_of(samples, 1, verdicts, config);
}

}  // namespace

TEST_GROUP(Metrics){};

TEST(Metrics, FramesAsWorkedOutByHand) {
  Confusion c;
  const struct {
    bool is, said;
    int times;
  } counts[] = {{true, true, 30}, {true, false, 10}, {false, true, 20}, {false, false, 140}};
  for (const auto& count : counts) {
    for (int i = 0; i < count.times; ++i) c.add(count.is, count.said);
  }
  LONGS_EQUAL(30, c.true_slip);
  LONGS_EQUAL(10, c.false_hold);
  LONGS_EQUAL(20, c.false_slip);
  LONGS_EQUAL(140, c.true_hold);
  LONGS_EQUAL(200, c.count());
  DOUBLES_EQUAL(0.85, c.accuracy(), 1e-12);
  DOUBLES_EQUAL(0.6, c.precision(), 1e-12);
  DOUBLES_EQUAL(0.75, c.recall(), 1e-12);
  DOUBLES_EQUAL((0.75 + 0.875) / 2, c.balanced_accuracy(), 1e-12);
  DOUBLES_EQUAL(2 * 0.6 * 0.75 / 1.35, c.f1(), 1e-12);
  Confusion twice = c;
  twice += c;
  LONGS_EQUAL(400, twice.count());
  LONGS_EQUAL(60, twice.true_slip);
  DOUBLES_EQUAL(c.f1(), twice.f1(), 1e-12);
}

TEST(Metrics, NothingToShareIsZero) {
  const Confusion none;
  for (const double figure : {none.accuracy(), none.balanced_accuracy(), none.precision(), none.recall(), none.f1()}) {
    DOUBLES_EQUAL(0.0, figure, 0.0);
  }
  Confusion silent;
  silent.add(false, false);
  DOUBLES_EQUAL(1.0, silent.accuracy(), 0.0);
  DOUBLES_EQUAL(0.5, silent.balanced_accuracy(), 0.0);
  DOUBLES_EQUAL(0.0, silent.precision(), 0.0);
}

// Quantiles of Student's t as every table prints them, three digits.
TEST(Metrics, IntervalsAreStudents) {
  const struct {
    int freedom;
    double t;
  } table[] = {{1, 12.706}, {2, 4.303},  {3, 3.182},  {4, 2.776},  {5, 2.571},   {9, 2.262},
               {10, 2.228}, {29, 2.045}, {30, 2.042}, {60, 2.000}, {120, 1.980}, {1000, 1.962}};
  for (const auto& row : table) {
    // n values -1 and +1 (and a 0 when n is odd): mean 0.
    const int n = row.freedom + 1;
    std::vector<double> values(static_cast<std::size_t>(n), 0.0);
    for (int i = 0; i < n / 2; ++i) {
      values[static_cast<std::size_t>(2 * i)] = 1.0;
      values[static_cast<std::size_t>(2 * i) + 1] = -1.0;
    }
    const int ones = n - n % 2;  // values that are not 0
    const double deviation = std::sqrt(static_cast<double>(ones) / row.freedom);
    const Interval interval = interval_of(values);
    DOUBLES_EQUAL(0.0, interval.mean, 1e-12);
    DOUBLES_EQUAL(row.t, interval.half / deviation * std::sqrt(static_cast<double>(n)), 0.0006);
    LONGS_EQUAL(n, interval.count);
  }
  const Interval hand = interval_of(std::vector{1.0, 2.0, 3.0, 4.0});
  DOUBLES_EQUAL(2.5, hand.mean, 1e-12);
  DOUBLES_EQUAL(3.18245 * 1.290994 / 2.0, hand.half, 1e-4);
  DOUBLES_EQUAL(0.7, interval_of(std::vector{0.7}).mean, 1e-12);
  DOUBLES_EQUAL(0.0, interval_of(std::vector{0.7}).half, 0.0);
  DOUBLES_EQUAL(0.0, interval_of(std::vector{0.7, 0.7, 0.7}).half, 1e-12);
  LONGS_EQUAL(0, interval_of({}).count);
}

TEST(Metrics, DetectionIsCountedFromTheOnset) {
  // Two slips in a row raise: onset in row 3, raised in row 5.
  const GraspEvent event = played("hhhssss", "0000110");
  LONGS_EQUAL(1, event.trial);
  CHECK_TRUE(event.slips);
  DOUBLES_EQUAL(1.12, event.onset_s, 1e-9);
  CHECK_TRUE(event.raised_s.has_value());
  DOUBLES_EQUAL(1.20, *event.raised_s, 1e-9);
  LONGS_EQUAL(2, *event.raised_frames);
  CHECK_FALSE(event.raised_before);
  LONGS_EQUAL(0, event.false_alarms);
  DOUBLES_EQUAL(0.12, event.held_s, 1e-9);
}

TEST(Metrics, MissedSlipIsNeverRaised) {
  const GraspEvent event = played("hhsss", "01010");
  CHECK_TRUE(event.slips);
  CHECK_FALSE(event.raised_s.has_value());
  CHECK_FALSE(event.raised_frames.has_value());
}

TEST(Metrics, HoldTrialHasNoOnset) {
  const GraspEvent event = played("oohhhhhhhhhhoo", "11000110000000");
  CHECK_FALSE(event.slips);
  CHECK_FALSE(event.raised_s.has_value());
  LONGS_EQUAL(1, event.open_alarms);
  // Raised in row 1 and held to row 5 (160 ms after the last slip): rows 5 and 6 only prolong it.
  LONGS_EQUAL(0, event.false_alarms);
  DOUBLES_EQUAL(0.40, event.held_s, 1e-9);
}

TEST(Metrics, EveryRiseOnAHoldRowIsAFalseAlarm) {
  // Raised in rows 1 and 10; 200 ms after the last slip (row 2; row 11) it falls.
  LONGS_EQUAL(2, played("hhhhhhhhhhhhhhhhhhh", "1110000001110000000").false_alarms);
  decision::Config quick;
  quick.raise_frames = 1;
  quick.hold = Micros{40'000};
  LONGS_EQUAL(3, played("hhhhhh", "101010", quick).false_alarms);
  LONGS_EQUAL(1, played("hhhhhh", "101010", {1, Micros{200'000}}).false_alarms);
}

TEST(Metrics, AlarmThatWasUpBeforeTheOnsetIsBoth) {
  const GraspEvent event = played("hhhsss", "0110 0");
  CHECK_TRUE(event.raised_before);
  LONGS_EQUAL(1, event.false_alarms);
  CHECK_TRUE(event.raised_s.has_value());
  DOUBLES_EQUAL(event.onset_s, *event.raised_s, 1e-12);
  LONGS_EQUAL(0, *event.raised_frames);
  // A rise on the onset's own row is none.
  const GraspEvent exact = played("hhhsss", "001100");
  CHECK_FALSE(exact.raised_before);
  LONGS_EQUAL(0, exact.false_alarms);
  LONGS_EQUAL(0, *exact.raised_frames);
}

TEST(Metrics, RejectedFramesKeepTheRequest) {
  // Not accepted rows between two slips neither end the run nor lengthen it.
  const GraspEvent event = played("hhsSSs", "001110");
  CHECK_FALSE(event.raised_s.has_value());
  LONGS_EQUAL(3, *played("hhsSSs", "001001").raised_frames);
  // The truth stands on its own: the onset may fall on a rejected frame.
  const GraspEvent onset = played("hhSsss", "000110");
  DOUBLES_EQUAL(1.08, onset.onset_s, 1e-9);
  LONGS_EQUAL(2, *onset.raised_frames);
  // Raised before and kept through rejected frames however long they last.
  CHECK_TRUE(played("hhHHHHHHHHHss", "1100000000000").raised_before);
}

TEST(Metrics, HeldTimeEndsWithTheTrial) {
  DOUBLES_EQUAL(0.0, played("h", "0").held_s, 0.0);
  DOUBLES_EQUAL(0.08, played("hh", "00").held_s, 1e-9);
  DOUBLES_EQUAL(0.04, played("soh", "000").held_s, 1e-9);
}
