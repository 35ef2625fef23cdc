// SPDX-License-Identifier: Apache-2.0
// What the decision `slip` is worth on labelled clips, in two tallies: labelled silence, and the whole trial by phase.
//
// It looks at nothing but `slip`, frame by frame. An alarm is a rising edge of it. An onset is detected within k frames
// when an alarm comes after the last silent frame before it, at most kEarly frames early, and at most k frames late. A
// clip that could not be replayed has detected nothing and adds no time.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/learn/labels.hpp"

namespace holdfast::learn {

inline constexpr int kFramesPerMinute = 25 * 60;  // the time base of the public clips' container
inline constexpr std::array kWithin{5, 10, 15};   // frames after an onset
// Labels of onsets are placed within 2 frames (high confidence) to 10 (medium).
inline constexpr int kEarly = 6;

// The whole trial: every frame of a clip whose labels are of high or medium confidence, once it is set up. The first
// phase that applies; kHold has all frames that no other phase has. kSlip and kUnscored count nowhere; load steps and
// releases are reported, not added up.
enum class Phase : std::uint8_t { kEmpty, kTouch, kHold, kShake, kLoadStep, kRelease, kSlip, kUnscored };
inline constexpr std::array<std::string_view, 8> kPhaseNames{"empty",     "touch",   "hold", "shake",
                                                             "load step", "release", "slip", "unscored"};
inline constexpr std::size_t kScoredPhases = 6;
[[nodiscard]] Phase phase_of(const ClipLabels& clip, int frame, int frames);

// The public clips shake the object in frames 100 to 250; artificial_strawberry shows no shaking.
[[nodiscard]] bool is_shaken(const ClipLabels& clip, int frame);

struct Alarms {
  int count = 0;
  long frames = 0;  // in which they could have come

  [[nodiscard]] double minutes() const { return static_cast<double>(frames) / kFramesPerMinute; }
  [[nodiscard]] std::optional<double> per_minute() const;
};

struct Onsets {
  int count = 0;
  std::array<int, kWithin.size()> within{};
  std::vector<int> delays;  // frames, of those detected within the longest; an early alarm has 0
};

struct ClipScore {
  Onsets onsets;   // recorded ones, of high or medium confidence
  Onsets seconds;  // second slips, likewise
  // Labelled silence, of high and medium confidence.
  Alarms silent;
  Alarms shaken;  // of it
  Alarms empty;
  // The whole trial.
  int trials = 0;
  std::array<Alarms, kScoredPhases> phases{};
  int touches = 0;          // clips whose contact begins inside
  int touches_alarmed = 0;  // of them, with an alarm at the touch

  // Empty, touch, hold and shake.
  [[nodiscard]] Alarms whole() const;
};

// One alarm, or one onset that nobody reported within the longest window.
struct Finding {
  const ClipLabels* clip = nullptr;
  int frame = 0;
  bool missed = false;
  bool silent = false;  // the alarm is false by the labels, silent or empty
  Phase phase = Phase::kUnscored;
  std::string what;
};

// Adds one clip. `slip`: one a frame; none when it could not be replayed. `findings`: may be null.
void add_clip(ClipScore& score, const ClipLabels& clip, std::span<const std::uint8_t> slip,
              std::vector<Finding>* findings);

// The label that holds the frame, else the nearest: "in silent 2-103", "4 frames after slip 107-122".
[[nodiscard]] std::string nearest_label(const ClipLabels& clip, int frame);

// --- detectors of one number, for comparison ---

// Slip while the value exceeds the threshold, and for 5 frames from then on, which is the firmware's hold at 25 fps.
[[nodiscard]] std::vector<std::uint8_t> held_above(std::span<const double> values, double threshold);

struct ClipValues {
  const ClipLabels* clip = nullptr;
  std::vector<std::uint8_t> budget;  // another detector's decisions
  std::vector<double> values;
};
// Decisions for each clip, by the threshold of the other objects' clips: the lowest that raises no more alarms in their
// labelled silence and on their empty gel than the budget's detector does there.
[[nodiscard]] std::vector<std::vector<std::uint8_t>> leave_one_object_out(std::span<const ClipValues> clips);

}  // namespace holdfast::learn
