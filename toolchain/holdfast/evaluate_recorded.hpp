// SPDX-License-Identifier: Apache-2.0
// Labelled recordings through the firmware, exactly as `holdfast replay CLIP --grid auto --reference N` plays them, and
// what the decision is worth on them (learn/clip_score.hpp), beside detectors for comparison.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "toolchain/learn/clip_score.hpp"
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

// The same recordings two by two, as the fingers of a hand (learn/pairs.hpp): each finger alone, the fused decision,
// and what its thresholds come to.
[[nodiscard]] std::string evaluate_pairs(const RecordedOptions& options, learn::ReportFacts& facts,
                                         std::vector<learn::Table>& tables,
                                         const std::function<void(long, long)>& progress);

// --- what both are made of ---

struct ScoreRow {
  std::string detector;
  std::string of;
  learn::ClipScore score;
};
[[nodiscard]] learn::Table silence_table(const std::string& id, const std::string& title,
                                         const std::vector<ScoreRow>& rows);
[[nodiscard]] learn::Table trial_table(const std::string& id, const std::string& title,
                                       const std::vector<ScoreRow>& rows);

// Calls work(0) to work(count - 1), `jobs` at a time, until somebody interrupts.
void each_of(std::size_t count, int jobs, const std::function<void(long, long)>& progress,
             const std::function<void(std::size_t)>& work);

}  // namespace holdfast::tool
