// SPDX-License-Identifier: Apache-2.0
// What a classifier is worth: frame by frame as the paper counts, and event by event as a gripper meets it.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slip/decision.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// Frames. Slip is the positive class. A share whose denominator is 0 is 0.
struct Confusion {
  long true_slip = 0;
  long false_slip = 0;
  long true_hold = 0;
  long false_hold = 0;

  void add(bool is_slip, bool said_slip);
  Confusion& operator+=(const Confusion& other);
  [[nodiscard]] long count() const { return true_slip + false_slip + true_hold + false_hold; }
  [[nodiscard]] double accuracy() const;
  [[nodiscard]] double balanced_accuracy() const;
  [[nodiscard]] double precision() const;
  [[nodiscard]] double recall() const;
  [[nodiscard]] double f1() const;
};

// Mean with a 95 % interval over repetitions (Student's t); one value has no interval (half = 0).
struct Interval {
  double mean = 0.0;
  double half = 0.0;
  int count = 0;
};
[[nodiscard]] Interval interval_of(std::span<const double> values);

// The value below which `share` of them lie (nearest rank, so always one that occurred); nothing of none.
[[nodiscard]] std::optional<double> quantile(std::vector<double> values, double share);

// One trial through the decision stage of the firmware (slip/decision.hpp), from one verdict a row.
struct GraspEvent {
  int trial = 0;
  bool slips = false;                // the trial has an onset: its first slip row after which nothing was slip before
  double onset_s = 0.0;              //
  std::optional<double> raised_s;    // first time that the request is raised at or after the onset
  std::optional<int> raised_frames;  // likewise, rows after the onset's
  bool raised_before = false;        // already raised when the onset came: a false alarm, and no detection to be timed
  int false_alarms = 0;              // times it rose on a hold row or before the onset; rises on open rows are counted
  int open_alarms = 0;               //   here instead
  double held_s = 0.0;               // time of the hold rows
};
// `verdicts`: of every row of the trial, in order; rows that were not accepted keep the request as it is.
[[nodiscard]] GraspEvent event_of(const Samples& samples, int trial, std::span<const std::uint8_t> verdicts,
                                  const decision::Config& config);

// The request after each row of a trial: update() of slip/decision.hpp; rows not accepted keep it.
[[nodiscard]] std::vector<std::uint8_t> requests_of(const Samples& samples, const Trial& trial,
                                                    std::span<const std::uint8_t> verdicts,
                                                    const decision::Config& config);

}  // namespace holdfast::learn
