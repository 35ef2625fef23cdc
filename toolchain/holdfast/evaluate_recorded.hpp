// SPDX-License-Identifier: Apache-2.0
// Labelled recordings through the firmware, exactly as `holdfast replay CLIP --grid auto --reference N` plays them, and
// what the decision is worth on them (learn/clip_score.hpp), beside detectors for comparison.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toolchain/learn/evaluate_report.hpp"

namespace holdfast::tool {

struct RecordedOptions {
  std::vector<std::string> labels;  // label files
  std::string model;                // decides instead of the compiled one
  std::string empty;                // picture of the empty gel for clips that show none; empty: empty_CAMERA.png
  std::string grid = "auto";
  int jobs = 1;
};

// Empty, or an error line. `progress`: clips done of all.
[[nodiscard]] std::string evaluate_recorded(const RecordedOptions& options, learn::ReportFacts& facts,
                                            std::vector<learn::Table>& tables,
                                            const std::function<void(long, long)>& progress);

}  // namespace holdfast::tool
