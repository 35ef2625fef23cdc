// SPDX-License-Identifier: Apache-2.0
// Detectors of one number: slip while it exceeds a threshold, which is read off recordings. The plainest that there
// are: what a tree is worth shows beside them.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/learn/recorded.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// Its number for every row of the samples; what it has to learn first it learns from these trials. Higher: more like
// slip. An error line, or nothing.
struct Detector {
  std::string_view name;
  bool in_contact = false;  // only where there is contact
  std::optional<std::string> (*values)(const Samples& samples, std::span<const int> trials,
                                       std::vector<double>& values);
};

// |V| is a motion-start detector: most recorded onsets coincide with the start of the shake.
extern const std::array<Detector, 2> kDetectors;

// Growth of the shading, log2 Q8, above which its change is a contact being made and no slip: a twelfth in the lag. On
// the recordings anything from 26 to 64 detects the same onsets within two, and alarms at 8 to 10 of 72 touches, six
// of which turn in the grip; without it 51 (2026-11-24).
inline constexpr int kMostGrowth = 31;

// The imprint's motion, which `holdfast fuse` takes its threshold of.
[[nodiscard]] const Detector& imprint_detector();

// How a threshold is chosen: the lowest one above which the request never rises more often than `alarms` times while
// these trials hold, plus a margin (in the detector's own unit).
struct Budget {
  int alarms = 0;
  double margin = 0.0;
};
[[nodiscard]] double threshold_of(const Samples& samples, const Detector& detector, std::span<const int> trials,
                                  std::span<const double> values, const Budget& budget, int raise_frames);

// 1 where it says slip.
[[nodiscard]] std::vector<std::uint8_t> verdicts_of(const Samples& samples, const Detector& detector,
                                                    std::span<const double> values, double threshold);

// Each object by the threshold of the others. An error line, or nothing.
[[nodiscard]] std::optional<std::string> leave_one_out(const Samples& samples, const Detector& detector,
                                                       const Budget& budget, int raise_frames, RecordedScore& score);

}  // namespace holdfast::learn
