// SPDX-License-Identifier: Apache-2.0
// Label files: what happens in recorded clips, frame by frame. One CSV file beside its clips, with a header and one
// clip a line; frame numbers count from 0 and intervals include both ends.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::learn {

// Other columns are ignored. An optional column may be missing, and every cell but `clip` and `onset_recorded` empty.
struct LabelColumn {
  std::string_view name;
  bool required;
  std::string_view help;
};
inline constexpr std::array<LabelColumn, 16> kLabelColumns{{
    {"clip", true, "name of the recording beside the label file, with its ending or without .avi, .mjpg or .mcap"},
    {"slip_start", true, "first frame in which the object moves against the gel; empty: it never does"},
    {"slip_end", true, "last frame of that slip"},
    {"onset_recorded", true, "1: the slip begins inside the clip; 0: there is none, or it began before"},
    {"silent_intervals", true, "a-b:high;c-d:medium;e-f:low  contact without slip, and how sure that is"},
    {"empty_intervals", true, "a-b;c-d  nothing touches the gel"},
    {"contact_start", false, "first frame of contact; empty: no contact"},
    {"contact_end", false, "last frame of contact; empty: not known"},
    {"slip_kind", false, "loss, slide_kept or none; printed only"},
    {"release_start", false, "first frame in which the gripper opens or the object is taken away"},
    {"release_end", false, "last frame of the release"},
    {"event_kind", false, "second_slip_loss: an onset of its own; contact_lost: a release; others: a load step"},
    {"event_start", false, "first frame of the event"},
    {"event_end", false, "last frame of the event"},
    {"confidence", false, "high, medium or low (high without the column); onsets of low confidence do not count"},
    {"note", false, "what the labeller saw, in words; beside every missed onset and alarm in findings.csv"},
}};

enum class Confidence : std::uint8_t { kHigh, kMedium, kLow };
inline constexpr std::array<std::string_view, 3> kConfidenceNames{"high", "medium", "low"};

inline constexpr int kUnknownEnd = std::numeric_limits<int>::max();

struct Frames {
  int from = 0;
  int to = 0;  // the last one

  [[nodiscard]] bool has(long frame) const { return frame >= from && frame <= to; }
};

struct SilentFrames : Frames {
  Confidence confidence = Confidence::kHigh;

  [[nodiscard]] bool sure() const { return confidence != Confidence::kLow; }
};

struct ClipLabels {
  std::filesystem::path file;  // the label file
  int line = 0;                // of it
  std::string name;
  std::string object;  // the clip's name up to "__exp"
  std::filesystem::path path;
  std::optional<Frames> contact;  // to kUnknownEnd when nobody knows
  std::optional<Frames> slip;
  std::string slip_kind;
  bool onset_recorded = false;
  std::optional<Frames> release;
  std::optional<Frames> event;
  std::string event_kind;
  std::vector<SilentFrames> silent;
  std::vector<Frames> empty;
  Confidence confidence = Confidence::kHigh;
  std::string note;

  [[nodiscard]] bool is_empty(long frame) const;
  [[nodiscard]] bool is_silent(long frame) const;  // of high or medium confidence
};

// Appends all clips of a label file, in its order. A recording may be labelled once, the clips that are there already
// included, and no silent or empty interval may overlap its slip. Nothing, or an error line.
[[nodiscard]] std::optional<std::string> read_labels(const std::filesystem::path& file, std::vector<ClipLabels>& clips);

// What is not certainly wrong but contradicts itself, a line each: a gel that is empty in contact, a slip outside of
// it, an interval of two confidences.
[[nodiscard]] std::vector<std::string> contradictions(const ClipLabels& clip);

// Whether the labels end within the clip, which has so many frames. Nothing, or an error line.
[[nodiscard]] std::optional<std::string> check_length(const ClipLabels& clip, long frames);
// The same for a clip that was not replayed. Nothing where its frames cannot be counted.
[[nodiscard]] std::optional<std::string> check_length(const ClipLabels& clip);

// empty_CAMERA.png beside the label file, CAMERA being what follows the last "__" of the clip's name: a picture of that
// camera's empty gel. Nothing when there is no such file.
[[nodiscard]] std::optional<std::filesystem::path> empty_picture(const ClipLabels& clip);

// Which picture shows the empty gel: the middle of the empty interval before the contact, else the end of the last
// empty one, else `empty` if it names a picture, else empty_picture(), else the last frame, whatever it shows.
// Intervals of fewer than four frames are too short to be sure of.
struct Rest {
  std::string reference;  // as --reference takes it
  bool in_contact = false;
};
[[nodiscard]] Rest rest_of(const ClipLabels& clip, const std::string& empty = {});

// An error line about that clip's line of the label file.
[[nodiscard]] std::string label_error(const ClipLabels& clip, std::string_view what, std::string_view cause,
                                      std::string_view next);

}  // namespace holdfast::learn
