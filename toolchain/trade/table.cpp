// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <istream>
#include <map>
#include <utility>

#include "toolchain/learn/evaluate_report.hpp"
#include "toolchain/learn/number_text.hpp"

namespace holdfast::trade {
namespace {

enum class Better : std::uint8_t { kLess, kMore, kNeither };
struct Figure {
  std::string_view id;     // of the CSV's column
  std::string_view title;  // for people
  int decimals = 1;        // for people; the CSV has two more
  Better better = Better::kNeither;
  double same_within = 0.0;  // of its own size: less apart is no difference
};
constexpr double kTimesTremble = 0.05;
constexpr double kErrorsTremble = 0.005;  // a root mean square over 100 000 markers is good to 0.2 %

constexpr std::array<Figure, kFigures> kTable{{
    {"us_p50", "us", 0, Better::kLess, kTimesTremble},
    {"us_p99", "us p99", 0},
    {"decode_us_p50", "decode", 0},
    {"memory_bytes", "kB", 0, Better::kLess},
    {"marker_rms_px", "rms px", 4, Better::kLess, kErrorsTremble},
    {"markers_missed_pct", "lost %", 2, Better::kLess},
    {"frames_rejected", "refused", 0, Better::kLess},
    {"damaged_used_pct", "used %", 1, Better::kLess},
    {"film_entropy_error_nat", "E err", 4},
    {"clip_onsets", "onsets", 0},
    {"clip_within_5", "<= 5", 0, Better::kMore},
    {"clip_within_10", "<= 10", 0, Better::kMore},
    {"clip_alarms_per_hour", "alarms/h", 1, Better::kLess},
    {"clip_alarms_per_trial", "a trial", 2, Better::kLess},
    {"instructions_x86_64", "x86-64", 2},
    {"instructions_aarch64", "aarch64", 2},
}};

constexpr std::array<std::string_view, 4> kNames{"index", "knob", "value", "mode"};

std::string header() {
  std::string out;
  for (const std::string_view name : kNames) out += fmt::format("{}{}", out.empty() ? "" : ",", name);
  for (const Figure& figure : kTable) out += fmt::format(",{}", figure.id);
  return out;
}

// -1: a is worse, 0: no difference, 1: better.
int compared(const Figure& figure, double a, double b) {
  if (std::abs(a - b) <= figure.same_within * std::max(std::abs(a), std::abs(b))) return 0;
  return (a < b) == (figure.better == Better::kLess) ? 1 : -1;
}

// Whether `a` is as good as `b` in these and better in one; both have all of them that either has.
template <typename Indices>
bool beats(const Line& a, const Line& b, const Indices& indices) {
  bool better = false;
  for (const std::size_t i : indices) {
    if (a.figures[i].has_value() != b.figures[i].has_value()) return false;
    if (!a.figures[i]) continue;
    const int sign = compared(kTable[i], *a.figures[i], *b.figures[i]);
    if (sign < 0) return false;
    better = better || sign > 0;
  }
  return better;
}

std::vector<std::string> cells_of(std::string_view line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else if (c != '\r') {
      cells.back() += c;
    }
  }
  return cells;
}

}  // namespace

Line line_of(long index, const Point& point, const Price& price) {
  Line line;
  line.index = index;
  line.knob = point.knob;
  line.value = point.value;
  line.mode = point.mode;
  auto& figures = line.figures;
  if (point.tuning.rival == Rival::kNone) figures[kMemory] = static_cast<double>(price.memory_bytes);
  if (price.seen) {
    const PictureTally& seen = *price.seen;
    figures[kUsP50] = seen.us_p50;
    figures[kUsP99] = seen.us_p99;
    figures[kDecodeUs] = seen.decode_us_p50;
    if (seen.frames > seen.rejected) figures[kRms] = seen.rms_px;
    const double markers = 63.0 * static_cast<double>(std::max(1L, seen.frames - seen.rejected));
    figures[kMissed] = 100.0 * static_cast<double>(seen.missed) / markers;
    figures[kRejected] = static_cast<double>(seen.rejected);
    if (seen.damaged > 0)
      figures[kDamagedUsed] = 100.0 * static_cast<double>(seen.damaged_used) / static_cast<double>(seen.damaged);
    figures[kEntropyError] = seen.entropy_error_nat;
  }
  if (price.recorded) {
    const learn::ClipScore& score = *price.recorded;
    figures[kClipOnsets] = score.onsets.count;
    figures[kClipWithin5] = score.onsets.within[0];
    figures[kClipWithin10] = score.onsets.within[1];
    const double silent_min = score.silent.minutes() + score.empty.minutes();
    if (silent_min > 0.0) figures[kClipAlarms] = 60.0 * (score.silent.count + score.empty.count) / silent_min;
    if (score.trials > 0) figures[kClipTrialAlarms] = static_cast<double>(score.whole().count) / score.trials;
  }
  return line;
}

std::string csv(const std::vector<Line>& lines) {
  std::string out = header() + '\n';
  for (const Line& line : lines) {
    out += fmt::format("{},{},{},{}", line.index, line.knob, line.value, line.mode);
    for (std::size_t i = 0; i < kFigures; ++i) {
      const bool whole = kTable[i].decimals == 0 || i >= kInstructionsX86;
      const int digits = whole ? 0 : kTable[i].decimals + 2;
      out += line.figures[i] ? fmt::format(",{:.{}f}", *line.figures[i], digits) : ",";
    }
    out += '\n';
  }
  return out;
}

std::optional<std::string> read_csv(std::istream& in, std::string_view name, std::vector<Line>& lines) {
  std::string row;
  if (!std::getline(in, row) || cells_of(row) != cells_of(header())) {
    return fmt::format(
        "{}:1: no table of prices. Likely cause: another file, or one of another version. Next: give what holdfast "
        "trade firmware --csv wrote",
        name);
  }
  for (int number = 2; std::getline(in, row); ++number) {
    const std::vector<std::string> cells = cells_of(row);
    const auto wrong = [&](std::string_view what) {
      return fmt::format("{}:{}: {}. Likely cause: the file was cut off or edited. Next: measure that piece again",
                         name, number, what);
    };
    if (cells == cells_of(header())) continue;  // pieces that were put one behind the other
    if (cells.size() != kNames.size() + kFigures) return wrong(fmt::format("{} cells", cells.size()));
    Line line;
    if (!learn::to_number(cells[0], line.index)) return wrong("no index");
    line.knob = cells[1];
    line.value = cells[2];
    line.mode = cells[3];
    for (std::size_t i = 0; i < kFigures; ++i) {
      const std::string& cell = cells[kNames.size() + i];
      if (cell.empty()) continue;
      double value = 0.0;
      if (!learn::to_number(cell, value) || !std::isfinite(value)) return wrong(fmt::format("'{}' is no number", cell));
      line.figures[i] = value;
    }
    lines.push_back(std::move(line));
  }
  return {};
}

std::optional<std::string> read_counts(std::istream& in, std::string_view name, std::vector<Line>& lines) {
  std::string row;
  int number = 1;
  const auto wrong = [&](std::string_view what) {
    return fmt::format(
        "{}:{}: {}. Likely cause: another file, or counted with another version. Next: count again with "
        "tests/bench/count_settings.sh",
        name, number, what);
  };
  std::map<std::string, std::array<std::optional<double>, 2>> counts;
  for (; std::getline(in, row); ++number) {
    const std::vector<std::string> cells = cells_of(row);
    if (cells.size() != 3) return wrong(fmt::format("{} cells instead of 3", cells.size()));
    auto& [x86, arm] = counts[cells[0]];
    for (const auto& [cell, count] : {std::pair(&cells[1], &x86), std::pair(&cells[2], &arm)}) {
      double value = 0.0;
      if (cell->empty()) continue;
      if (!learn::to_number(*cell, value) || !(value > 0.0)) return wrong(fmt::format("'{}' is no count", *cell));
      *count = value;
    }
  }
  const std::vector<Point> all = points();
  for (Line& line : lines) {
    const auto settings = settings_of(all.at(static_cast<std::size_t>(line.index)));
    if (!settings) continue;
    const auto found = counts.find(*settings);
    if (found == counts.end()) return wrong(fmt::format("no count of '{}'", *settings));
    line.figures[kInstructionsX86] = found->second[0];
    line.figures[kInstructionsArm] = found->second[1];
  }
  return {};
}

std::optional<std::string> put_together(std::vector<Line>& lines) {
  std::ranges::sort(lines, {}, &Line::index);
  const std::vector<Point> all = points();
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool twice = i + 1 < lines.size() && lines[i].index == lines[i + 1].index;
    if (twice || i >= lines.size() || lines[i].index != static_cast<long>(i) || lines[i].knob != all[i].knob ||
        lines[i].value != all[i].value) {
      return fmt::format(
          "setting {} ({} {}) is {}. Likely cause: a piece left out, given twice, or measured by another version. "
          "Next: give each of the N pieces of one run once",
          i, all[i].knob, all[i].value, twice ? "there twice" : "missing");
    }
  }
  if (lines.size() == all.size()) return {};
  return "more settings than there are. Likely cause: another version measured. Next: measure again";
}

const Line* dominated_by(const Line& line, const std::vector<Line>& lines) {
  std::vector<std::size_t> judged;
  for (std::size_t i = 0; i < kFigures; ++i) {
    if (kTable[i].better != Better::kNeither) judged.push_back(i);
  }
  const auto found = std::ranges::find_if(lines, [&](const Line& other) { return beats(other, line, judged); });
  return found == lines.end() ? nullptr : &*found;
}

std::string text(const std::vector<Line>& lines, bool whole) {
  learn::Table table;
  table.columns = {{.id = "knob", .title = "", .group = ""}, {.id = "value", .title = "", .group = ""}};
  constexpr std::array<std::size_t, 12> kShown{kUsP50,           kDecodeUs,     kMemory,      kInstructionsX86,
                                               kInstructionsArm, kRms,          kDamagedUsed, kEntropyError,
                                               kClipWithin5,     kClipWithin10, kClipAlarms,  kClipTrialAlarms};
  for (const std::size_t i : kShown) {
    table.columns.push_back({.id = std::string(kTable[i].id),
                             .title = std::string(kTable[i].title),
                             .group = i <= kMemory            ? "a frame"
                                      : i >= kInstructionsX86 ? "million instructions"
                                      : i <= kEntropyError    ? "pictures"
                                                              : "recordings",
                             .decimals = kTable[i].decimals});
  }
  for (const Line& line : lines) {
    std::vector<learn::Cell> row{learn::Cell(line.knob), learn::Cell(line.value)};
    for (const std::size_t i : kShown) {
      const double unit = i == kMemory ? 1e3 : i == kInstructionsX86 || i == kInstructionsArm ? 1e6 : 1.0;
      row.emplace_back(line.figures[i] ? std::optional(*line.figures[i] / unit) : std::nullopt);
    }
    table.rows.push_back(std::move(row));
  }
  std::string out = learn::text(table);
  if (!whole) return out;
  for (const Line& line : lines) {
    if (!line.mode.empty() && dominated_by(line, lines) == nullptr) {
      out += fmt::format("mode {}: nothing is as good in everything and better in something\n", line.mode);
    }
  }
  for (const Line& line : lines) {
    const Line* const better = dominated_by(line, lines);
    if (better == nullptr) continue;
    out += fmt::format("dominated: {} {}, by {} {}\n", line.knob, line.value, better->knob, better->value);
  }
  return out;
}

std::string modes_markdown(const std::vector<Line>& lines) {
  std::string out =
      "| mode | time of a frame | million aarch64 instructions | memory it works on | marker error | error of E | "
      "recordings: onsets detected within 5 and 10 frames; false alarms an hour of silence, and a whole trial |\n"
      "|---|---|---|---|---|---|---|\n";
  const auto at = [](const Line& line, std::size_t i) { return line.figures[i].value_or(0.0); };
  for (const Line& line : lines) {
    if (line.mode.empty()) continue;
    out += fmt::format("| `{}` | {:.2f}x | {:.1f} | {:.1f} MB | {:.4f} px | {:.4f} nat | {} |\n", line.mode,
                       at(line, kUsP50) / at(lines.front(), kUsP50), at(line, kInstructionsArm) / 1e6,
                       at(line, kMemory) / 1e6, at(line, kRms), at(line, kEntropyError),
                       line.figures[kClipOnsets]
                           ? fmt::format("{:.0f} and {:.0f} of {:.0f}; {:.1f}, {:.2f}", at(line, kClipWithin5),
                                         at(line, kClipWithin10), at(line, kClipOnsets), at(line, kClipAlarms),
                                         at(line, kClipTrialAlarms))
                           : "not there");
  }
  return out;
}

}  // namespace holdfast::trade
