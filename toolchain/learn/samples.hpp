// SPDX-License-Identifier: Apache-2.0
// What is learned from: the firmware's features of every frame of many trials, with the truth beside them, and the CSV
// file that holds them.
//
// A trial is one grasp, from the empty gel to the empty gel. Splits go by trial or by object, never by frame: frames of
// one trial resemble each other. Features are the firmware's own integers (slip/tree_io.hpp, kFeatures): nothing is
// learned from a value that the device cannot produce.
//
// CSV, one row per frame, trials one after the other:
//   source,object,primitive,kind,seed,trial,frame,t_s,label,slip_fraction,slide_mm_s,accepted, then kFeatures by name
#pragma once

#include <array>
#include <cstdint>
#include <iosfwd>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slip/tree_io.hpp"

namespace holdfast::learn {

using Features = std::array<std::int32_t, kFeatureCount>;  // raw, in the order of kFeatures

enum class Source : std::uint8_t { kSimulated, kRecorded };

// Truth by the motion of the object against the gel.
enum class Label : std::uint8_t {
  kHold,   // in contact, at most half of the contact's area slips
  kSlip,   // more than half of it slips
  kEmpty,  // nothing touches the gel: not judged, but trees learn that it is no slip
  kOpen,   // not judged: the gripper lets go, or (recordings) the annotator could not tell
};

struct Trial {
  Source source = Source::kSimulated;
  std::string object;
  std::string primitive;  // recordings: empty
  std::string kind;       // static, slip, ... (dataset.hpp); recordings: clip
  std::uint64_t seed = 0;
  int first = 0;  // of Samples::rows
  int count = 0;
};

struct Row {
  int trial = 0;  // index of Samples::trials
  int frame = 0;
  double t_s = 0.0;
  Label label = Label::kOpen;
  double slip_fraction = 0.0;  // of the contact's area; recordings: 0 or 1
  double slide_mm_s = 0.0;     // object against gel; recordings: 0
  bool accepted = true;        // false: the firmware rejected the frame or had no reference; x is 0
  Features x{};
};

struct Samples {
  std::vector<Trial> trials;
  std::vector<Row> rows;

  [[nodiscard]] std::span<const Row> of(const Trial& trial) const {
    return std::span(rows).subspan(static_cast<std::size_t>(trial.first), static_cast<std::size_t>(trial.count));
  }
};

[[nodiscard]] std::string_view name_of(Source source);
[[nodiscard]] std::string_view name_of(Label label);

// Rows that classifiers see: accepted and labelled hold or slip.
[[nodiscard]] inline bool judged(const Row& row) {
  return row.accepted && (row.label == Label::kHold || row.label == Label::kSlip);
}

void write_csv(std::ostream& out, const Samples& samples);
// `name` is the file's, for messages. Returns nothing, or one line: where, what, likely cause, next step; `samples` is
// void then. Refused: another header, cells that are no numbers, features outside of their range, frames that do not
// count up, a trial in two pieces, no rows at all.
[[nodiscard]] std::optional<std::string> read_csv(std::istream& in, std::string_view name, Samples& samples);

// Puts the trials of `more` behind those that are there.
void append(Samples& all, Samples more);

}  // namespace holdfast::learn
