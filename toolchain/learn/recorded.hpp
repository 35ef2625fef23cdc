// SPDX-License-Identifier: Apache-2.0
// What verdicts are worth on the samples of recordings: onsets that were noticed, and alarms where nothing slips. For
// thresholds and settings; the firmware itself is judged by clip_score.hpp.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "slip/decision.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// Onsets with a new alarm in a window: it rises from 3 frames before the onset on, which is how well the labels are
// placed, and at most 5, 10 or 15 frames after it.
struct Windows {
  int fresh = 0;
};
struct Exposure {
  int alarms = 0;
  double s = 0.0;
};
struct RecordedScore {
  int onsets = 0;
  int hits = 0;  // silent in the 5 frames before the onset, and a new alarm in the 10 after it
  Windows within_5;
  Windows within_10;
  Windows within_15;
  Exposure held;
  Exposure shaken;  // of held
  Exposure empty;   // nothing touches the gel
};

// One verdict a row of `recorded`, through the decision stage of the firmware.
[[nodiscard]] RecordedScore score_recordings(const Samples& recorded, std::span<const std::uint8_t> verdicts,
                                             const decision::Config& config);

// The same of some trials only.
[[nodiscard]] RecordedScore score_recordings(const Samples& recorded, std::span<const int> trials,
                                             std::span<const std::uint8_t> verdicts, const decision::Config& config);

// Exact (Clopper and Pearson) interval for a share of which `hits` of `count` were seen.
struct ShareInterval {
  double low = 0.0;
  double high = 1.0;
};
[[nodiscard]] ShareInterval share_interval(int hits, int count, double confidence = 0.95);

}  // namespace holdfast::learn
