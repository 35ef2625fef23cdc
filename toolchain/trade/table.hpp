// SPDX-License-Identifier: Apache-2.0
// The prices of all settings as one table: a CSV whose pieces put together are the whole, and what can be read off it.
//
// A row that has a figure for everything and is no better than another in anything is dominated: nobody should choose
// it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/trade/price.hpp"

namespace holdfast::trade {

inline constexpr std::size_t kFigures = 16;
// What is measured of a line, in the order of the CSV's columns. Recordings: of all that were given.
enum : std::uint8_t {
  kUsP50,
  kUsP99,
  kDecodeUs,
  kMemory,
  kRms,
  kMissed,
  kRejected,
  kDamagedUsed,
  kEntropyError,
  kClipOnsets,
  kClipWithin5,
  kClipWithin10,
  kClipAlarms,
  kClipTrialAlarms,
  kInstructionsX86,
  kInstructionsArm,
};
struct Line {
  long index = 0;  // of points(), from 0
  std::string knob;
  std::string value;
  std::string mode;
  std::array<std::optional<double>, kFigures> figures{};
};
[[nodiscard]] Line line_of(long index, const Point& point, const Price& price);

[[nodiscard]] std::string csv(const std::vector<Line>& lines);
// Adds the lines of one CSV. Nothing, or one line: what is wrong, likely cause, next step.
[[nodiscard]] std::optional<std::string> read_csv(std::istream& in, std::string_view name, std::vector<Line>& lines);
// Puts lines of any order into theirs. As above: one that is missing, or there twice.
[[nodiscard]] std::optional<std::string> put_together(std::vector<Line>& lines);

// Adds the instruction counts of a frame, one line a setting: settings,x86_64,aarch64 (tests/bench/count_settings.sh).
// Nothing, or one line as above.
[[nodiscard]] std::optional<std::string> read_counts(std::istream& in, std::string_view name, std::vector<Line>& lines);

// The line that is as good in everything and better in something; null: none, or a figure is missing.
[[nodiscard]] const Line* dominated_by(const Line& line, const std::vector<Line>& lines);

// `whole`: these are all lines, so that one can be compared with the others.
[[nodiscard]] std::string text(const std::vector<Line>& lines, bool whole);
// The shipped modes as a table in Markdown.
[[nodiscard]] std::string modes_markdown(const std::vector<Line>& lines);

}  // namespace holdfast::trade
