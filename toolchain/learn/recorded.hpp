// SPDX-License-Identifier: Apache-2.0
// What alarms are worth on recordings, whose labels are few: onsets that were noticed, and alarms where nothing slips.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "slip/decision.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// Windows begin at the onset (any alarm: up at all; new alarm: rises, from 3 frames before the onset on, which is how
// well the labels are placed) and end 5, 10 or 15 frames after it. Sham: share of such windows that lie wholly in
// silent held contact and show the same: what chance gives.
struct Windows {
  int any = 0;  // onsets
  int fresh = 0;
  double sham_any = 0.0;  // shares of all windows in held contact
  double sham_fresh = 0.0;
  double shaken_any = 0.0;  // likewise in shaken contact
  double shaken_fresh = 0.0;
};
struct Exposure {
  int alarms = 0;
  double s = 0.0;

  [[nodiscard]] double per_minute() const { return s > 0.0 ? alarms * 60.0 / s : 0.0; }
};
struct RecordedScore {
  std::string name;
  std::string trained;  // on what
  int raise_frames = 2;
  Confusion frames;
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
