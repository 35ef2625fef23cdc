// SPDX-License-Identifier: Apache-2.0
// Recordings of the two fingers of one grasp: which belong together, how far apart they begin, and what a hand should
// have said.
//
// The labels of a hand are those of its fingers put together. It slips where either does, from the earlier of the two
// onsets on; it is held still, or empty, only where both are. So one finger that is scored alone has to report what the
// other saw first as well.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "toolchain/learn/clip_score.hpp"
#include "toolchain/learn/labels.hpp"

namespace holdfast::learn {

// Names that are the same up to their last "__", as OBJECT__exp_num_N__camera_0 and _2: left and right in the order of
// names. Indices into `clips`; what has no partner, or more than one, is left out.
[[nodiscard]] std::vector<std::array<std::size_t, 2>> pairs_of(std::span<const ClipLabels> clips);

struct Offset {
  int frames = 0;            // the right recording's frame i + frames shows what the left's frame i does
  double correlation = 0.0;  // there
};
// From the speeds of the markers' means, in any unit: where their logarithms correlate best. Looks no further than a
// 25th of the recording, and takes 0.01 off for each frame. Labels are not looked at.
[[nodiscard]] Offset find_offset(std::span<const double> left, std::span<const double> right);
// The same for recordings that were started by hand: up to a quarter of the shorter one, at 0.001 a frame, where the
// two are more alike there by 0.15. Of 100 pairs of recordings it finds what find_offset() does; up to a half, it would
// place one of 53 frames elsewhere (2026-11-29).
[[nodiscard]] Offset find_far_offset(std::span<const double> left, std::span<const double> right);
// Fingers that hold one object are more alike than this: 0.404 at least in 100 pairs, 0.70 by the median (2026-11-29).
inline constexpr double kDoubtful = 0.4;

// In the left's frames.
[[nodiscard]] ClipLabels merged(const ClipLabels& left, const ClipLabels& right, int offset);

// --- thresholds of the fused decision (slip/fusion.hpp) ---

// What one setting came to on some pairs, or what one finger alone did.
struct FusionScore {
  int within_5 = 0;
  int within_10 = 0;
  int quiet = 0;  // alarms in labelled silence and on the empty gel
  int whole = 0;  // alarms in the whole trial

  void add(const ClipScore& score);
  FusionScore& operator+=(const FusionScore& other);
};

// Of those settings that detect no fewer onsets than the better finger, within 5 and within 10 frames (none: that miss
// the fewest), and of them those with the fewest alarms in silence: the first of those that detect most within 5 frames
// among all whose alarms in whole trials are within a standard error of the fewest. Without that error the setting
// hangs on single alarms: left-out objects' then come to 26 alarms where the average finger has 25 (2026-11-26). Range:
// at least one setting; the first are nearest to a single finger's.
[[nodiscard]] std::size_t choose(std::span<const FusionScore> settings, const FusionScore& left,
                                 const FusionScore& right);

}  // namespace holdfast::learn
