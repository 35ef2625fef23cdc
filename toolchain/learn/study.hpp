// SPDX-License-Identifier: Apache-2.0
// How far the results lean on choices and on circumstances: which entropy, and what the deployed tree stands.
//
// Which entropy. The same displacement fields, as the firmware computes them, through histograms of other ranges, bin
// counts and kinds of bins; E and dE/dt in the device's formats, so that "0" means what it means there. Judged by what
// a tree can make of the two, by how often dE/dt is blind (0) and by how much it trembles where nothing moves.
// What the tree stands. The same grasps with one circumstance changed at a time, the tree left as it is.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slip/decision.hpp"
#include "slip/model.hpp"
#include "tactile/types.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/learn/evaluate.hpp"
#include "toolchain/learn/evaluate_report.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/plan.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// --- which entropy ---

enum class Bins : std::uint8_t {
  kHard,     // marker of length |D| counts in bin floor(count |D| / range), the last bin takes the overflow
  kSoft,     // split between the two bins whose centres it lies between, linearly; beyond the outer centres all in one
  kOctaves,  // half an octave each from 8 um (tactile/field_features.hpp); range and count are fixed
};

struct EntropyForm {
  Bins bins = Bins::kHard;
  std::int32_t range_um = 1900;
  int count = 15;

  friend bool operator==(const EntropyForm&, const EntropyForm&) = default;
};
[[nodiscard]] std::string name_of(const EntropyForm& form);

inline constexpr EntropyForm kPaperForm{};
// All that are compared: 15 hard, 5 soft, and the octaves.
inline constexpr int kEntropyForms = 21;
[[nodiscard]] const std::array<EntropyForm, kEntropyForms>& entropy_forms();

// Shannon entropy of the valid markers' lengths, nat; 0 of none. Range: 500 um <= range or any other above 0, count
// from 1 to 128.
[[nodiscard]] double entropy_nat(const EntropyForm& form, const DisplacementField& field);

// Both raw, as the device would have them.
struct EntropyPair {
  std::int32_t nat_q16 = 0;
  std::int32_t nat_s_q8 = 0;
};

enum class Calm : std::uint8_t { kMoving, kEmpty, kTouched };

// What the samples do not hold, one a row. Calm: no marker truly moved by 0.1 um since the frame before, a tenth of
// what tracking adds. kEmpty: nothing touches.
struct EntropyFrame {
  bool has_rate = false;  // the firmware had one, too
  Calm calm = Calm::kMoving;
  std::array<EntropyPair, kEntropyForms> of{};
};

struct EntropyRows {
  Samples samples;
  std::vector<EntropyFrame> frames;
};
// Appends one grasp.
void play_entropies(EntropyRows& rows, const Planned& planned, const Params& params);

// Shares from 0 to 1. Trees are our own, depth 6, balanced, on E and dE/dt.
struct EntropyScore {
  EntropyForm form;
  double blind_hold = 0.0;      // share of held contact in which dE/dt is 0
  double blind_slip = 0.0;      // likewise of slip
  double tremble_empty = 0.0;   // RMS of dE/dt at rest, nat/s
  double tremble_held = 0.0;    //
  OneThreshold level;           // E alone, on the rows it was chosen on
  Confusion five_fold;          // by trial
  Confusion left_out;           // one object at a time
  std::vector<double> objects;  // balanced accuracy of each object left out, in the order of the samples
};
// Nothing, or one line ("stopped" when `progress` said so, which hears how many of kEntropyForms are done).
[[nodiscard]] std::optional<std::string> score_entropies(const EntropyRows& rows, std::uint64_t seed,
                                                         const std::function<bool(int)>& progress,
                                                         std::vector<EntropyScore>& scores);

// --- what the tree stands ---

struct Condition {
  std::string_view what;        // "frame rate, fps"
  std::optional<double> value;  // none: as planned
  Variation variation;
};
[[nodiscard]] std::vector<Condition> conditions();

// Every `every`-th grasp, such that kinds, objects and primitives stay evenly mixed. Range: every >= 1.
[[nodiscard]] std::vector<PlannedGrasp> thinned(const Plan& plan, int every);

struct ConditionScore {
  Confusion frames;
  long refused = 0;  // frames of contact that the firmware did not judge: rejected, or no rest position
  EventGroup events;
  [[nodiscard]] double within_ms(double ms) const;  // share of the onsets

  // One trial of the samples, from one verdict a row.
  void add(const Samples& samples, int trial, std::span<const std::uint8_t> verdicts, const decision::Config& config);
};
// Every trial of the samples, by the tree's own features.
void judge(const Samples& samples, const model::Tree& tree, const decision::Config& config, ConditionScore& score);

// --- what is shown ---

[[nodiscard]] Table entropy_table(std::span<const EntropyScore> scores);
[[nodiscard]] Table condition_table(std::span<const Condition> conditions, std::span<const ConditionScore> scores);
[[nodiscard]] std::string entropy_chart(std::span<const EntropyScore> scores);
// Which form is best, and by how little; a few lines.
[[nodiscard]] std::string entropy_note(std::span<const EntropyScore> scores);

}  // namespace holdfast::learn
