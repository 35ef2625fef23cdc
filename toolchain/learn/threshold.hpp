// SPDX-License-Identifier: Apache-2.0
// The imprint alone as a detector: slip while its motion exceeds a threshold, which is read off recordings.
#pragma once

#include <span>
#include <vector>

#include "toolchain/learn/recorded.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// Growth of the shading, log2 Q8, above which its change is a contact being made and no slip: a twelfth in the lag. On
// the recordings anything from 26 to 64 detects the same onsets within two, and alarms at 8 to 10 of 72 touches, six
// of which turn in the grip; without it 51 (2026-11-24).
inline constexpr int kMostGrowth = 31;

// The imprint's motion in every row, log2 um Q8; 0 where what moves is a contact that is being made.
[[nodiscard]] std::vector<double> imprint_motions(const Samples& samples);

// In which these trials hold.
[[nodiscard]] double held_minutes(const Samples& samples, std::span<const int> trials);

// How a threshold is chosen: the lowest one above which the request never rises more often while these trials hold than
// once in so many minutes, to the nearest whole number of times; plus a margin, log2 um Q8.
struct Budget {
  double minutes_per_alarm = 0.0;
  double margin = 0.0;
};
[[nodiscard]] double threshold_of(const Samples& samples, std::span<const double> motions, std::span<const int> trials,
                                  const Budget& budget, int raise_frames);

// Each object by the threshold of the others.
[[nodiscard]] RecordedScore leave_one_out(const Samples& samples, const Budget& budget, int raise_frames);

}  // namespace holdfast::learn
