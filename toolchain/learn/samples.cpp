// SPDX-License-Identifier: Apache-2.0
// Text of samples. Times are written to the microsecond, which is the firmware's unit; fractions and speeds to six
// digits: reading and writing again gives the same bytes.
#include "toolchain/learn/samples.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <istream>
#include <iterator>
#include <ostream>
#include <unordered_set>
#include <utility>

#include "base/math.hpp"
#include "toolchain/learn/number_text.hpp"

namespace holdfast::learn {
namespace {

enum SampleColumn : std::size_t {
  kSource,
  kObject,
  kPrimitive,
  kKind,
  kSeed,
  kTrial,
  kFrame,
  kTime,
  kLabel,
  kSlipFraction,
  kSlide,
  kAccepted,
  kFirstFeature
};

constexpr std::array<std::string_view, kFirstFeature> kColumns{"source", "object",        "primitive",  "kind",
                                                               "seed",   "trial",         "frame",      "t_s",
                                                               "label",  "slip_fraction", "slide_mm_s", "accepted"};
constexpr std::size_t kColumnCount = kFirstFeature + kFeatures.size();
using Cells = std::array<std::string_view, kColumnCount>;

// A grasp lasts seconds; times must fit the firmware's microseconds with room to spare.
constexpr double kMostSeconds = 1e6;
constexpr double kMostSlide_mm_s = 1e6;

constexpr std::string_view column_name(std::size_t i) {
  return i < kFirstFeature ? kColumns[i] : kFeatures[i - kFirstFeature].name;
}

// Names stand in the file as they are: what would part cells or lines becomes '_'.
std::string cell_of(std::string name) {
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return c == ',' || c == '"' || c < 0x20 || c == 0x7F; }, '_');
  return name;
}

std::string in_quotes(std::string_view cell) {
  constexpr std::size_t kShown = 40;
  return fmt::format("'{}{}'", cell.substr(0, kShown), cell.size() > kShown ? "..." : "");
}

// Cells of one line; how many there are, which may be more than fit.
std::size_t split(std::string_view line, Cells& cells) {
  std::size_t count = 0;
  for (std::size_t at = 0;; ++count) {
    const std::size_t end = std::min(line.find(',', at), line.size());
    if (count < cells.size()) cells[count] = line.substr(at, end - at);
    if (end == line.size()) return count + 1;
    at = end + 1;
  }
}

using Error = std::optional<std::string>;

// One pass over the lines.
class Reader {
 public:
  Reader(std::string_view name, Samples& samples) : name_(name), samples_(samples) {}

  Error read(std::string_view text) {
    while (!text.empty()) {
      ++line_;
      const std::size_t end = text.find('\n');
      if (end == std::string_view::npos) {
        return error("the last line does not end", "the file was cut off", "copy it again, or write it again");
      }
      std::string_view line = text.substr(0, end);
      text.remove_prefix(end + 1);
      if (line.ends_with('\r')) {
        return error("the line ends with a carriage return", "the file went through another system's editor",
                     "save it with Unix line ends");
      }
      if (Error bad = line_ == 1 ? header(line) : row(line)) return bad;
    }
    if (!samples_.rows.empty()) return std::nullopt;
    return error("there are no rows", line_ == 0 ? "the file is empty" : "the run that wrote it made no trials",
                 "write it again with `holdfast dataset`");
  }

 private:
  [[nodiscard]] Error error(const std::string& what, std::string_view cause, std::string_view next) const {
    return fmt::format("{}:{}: {}. Likely cause: {}. Next: {}", name_, std::max(line_, 1L), what, cause, next);
  }

  Error header(std::string_view line) {
    Cells cells;
    const std::size_t count = split(line, cells);
    for (std::size_t i = 0; i < kColumnCount; ++i) {
      if (i < count && cells[i] == column_name(i)) continue;
      return error(i < count
                       ? fmt::format("column {} is {} where '{}' is due", i + 1, in_quotes(cells[i]), column_name(i))
                       : fmt::format("column {}, '{}', is missing", i + 1, column_name(i)),
                   "no file of samples, or of a firmware with other features",
                   "write it again with this version's `holdfast dataset`");
    }
    if (count == kColumnCount) return std::nullopt;
    return error(fmt::format("{} columns where {} are due", count, kColumnCount), "a firmware with more features",
                 "write it again with this version's `holdfast dataset`");
  }

  [[nodiscard]] Error bad_cell(SampleColumn column, std::string_view cell, const std::string& due) const {
    return error(fmt::format("{} {} is not {}", column_name(column), in_quotes(cell), due),
                 "the file is damaged, or was changed by hand", "write it again with `holdfast dataset`");
  }

  template <typename Number>
  Error number(const Cells& cells, SampleColumn column, Number least, Number most, Number& value) const {
    if (to_number(cells[column], value) && value >= least && value <= most) return std::nullopt;
    return bad_cell(column, cells[column], fmt::format("a number from {} to {}", least, most));
  }

  Error row(std::string_view line) {
    Cells cells;
    const std::size_t count = split(line, cells);
    if (count != kColumnCount) {
      return error(fmt::format("{} cells where {} are due", count, kColumnCount),
                   "the line was cut or joined with another", "write the file again with `holdfast dataset`");
    }
    if (Error bad = trial(cells)) return bad;

    Row row;
    row.trial = static_cast<int>(samples_.trials.size()) - 1;
    if (Error bad = number(cells, kFrame, 0, INT32_MAX, row.frame)) return bad;
    if (Error bad = number(cells, kTime, 0.0, kMostSeconds, row.t_s)) return bad;
    if (Error bad = number(cells, kSlipFraction, 0.0, 1.0, row.slip_fraction)) return bad;
    if (Error bad = number(cells, kSlide, -kMostSlide_mm_s, kMostSlide_mm_s, row.slide_mm_s)) return bad;
    constexpr std::array<Label, 4> kLabels{Label::kHold, Label::kSlip, Label::kEmpty, Label::kOpen};
    const auto* const label =
        std::find_if(kLabels.begin(), kLabels.end(), [&](Label l) { return name_of(l) == cells[kLabel]; });
    if (label == kLabels.end()) return bad_cell(kLabel, cells[kLabel], "hold, slip, open or empty");
    row.label = *label;
    int accepted = 0;
    if (Error bad = number(cells, kAccepted, 0, 1, accepted)) return bad;
    row.accepted = accepted == 1;
    if (Error bad = features(cells, row)) return bad;

    Trial& trial = samples_.trials.back();
    if (trial.count > 0) {
      const Row& before = samples_.rows.back();
      if (row.frame <= before.frame) {
        return error(fmt::format("frame {} follows frame {}", row.frame, before.frame),
                     "lines were doubled or sorted anew", "keep the order in which the file was written");
      }
      if (row.t_s < before.t_s) {
        return error(fmt::format("the time goes back from {} to {} s", before.t_s, row.t_s),
                     "lines were sorted anew, or the recording's clock jumped",
                     "keep the order in which the file was written, or leave the trial out");
      }
    }
    ++trial.count;
    samples_.rows.push_back(row);
    return std::nullopt;
  }

  Error features(const Cells& cells, Row& row) const {
    for (std::size_t i = 0; i < kFeatures.size(); ++i) {
      const std::string_view cell = cells[kFirstFeature + i];
      const FeatureInfo& info = kFeatures[i];
      if (!to_number(cell, row.x[i])) {
        return error(fmt::format("{} {} is not an integer", info.name, in_quotes(cell)),
                     "the file is damaged, or was written by another program",
                     "write it again with `holdfast dataset`");
      }
      const bool in_range = row.x[i] >= info.min && row.x[i] <= info.max;
      if (row.accepted && !in_range) {
        return error(fmt::format("{} {} lies outside of {}..{}", info.name, row.x[i], info.min, info.max),
                     "the file is damaged: the firmware cannot produce this value",
                     "write it again with `holdfast dataset`");
      }
      if (!row.accepted && row.x[i] != 0) {
        return error(fmt::format("{} is {} in a frame that was not accepted", info.name, row.x[i]),
                     "the file was changed by hand", "write it again with `holdfast dataset`");
      }
    }
    return std::nullopt;
  }

  // Opens a trial when its number changes; its own columns must then stay as they are.
  Error trial(const Cells& cells) {
    int number_here = 0;
    if (Error bad = number(cells, kTrial, 0, INT32_MAX, number_here)) return bad;
    const bool same = !samples_.trials.empty() && number_here == trial_number_;
    if (same) {
      for (const SampleColumn column : {kSource, kObject, kPrimitive, kKind, kSeed}) {
        if (cells[column] == first_[column]) continue;
        return error(fmt::format("{} is {} and was {} in the same trial {}", column_name(column),
                                 in_quotes(cells[column]), in_quotes(first_[column]), number_here),
                     "two files were joined by hand", "give the files one by one");
      }
      return std::nullopt;
    }
    if (!seen_.insert(number_here).second) {
      return error(fmt::format("trial {} is there in two pieces", number_here),
                   "lines were sorted anew, or two files were joined by hand",
                   "keep the order in which the file was written, and give several files one by one");
    }
    Trial trial;
    if (cells[kSource] == name_of(Source::kRecorded)) {
      trial.source = Source::kRecorded;
    } else if (cells[kSource] != name_of(Source::kSimulated)) {
      return bad_cell(kSource, cells[kSource], "simulated or recorded");
    }
    if (Error bad = number(cells, kSeed, std::uint64_t{0}, UINT64_MAX, trial.seed)) return bad;
    for (const SampleColumn column : {kObject, kKind}) {
      if (cells[column].empty()) return bad_cell(column, cells[column], "a name");
    }
    trial.object = cells[kObject];
    trial.primitive = cells[kPrimitive];
    trial.kind = cells[kKind];
    trial.first = static_cast<int>(samples_.rows.size());
    samples_.trials.push_back(std::move(trial));
    first_ = cells;
    trial_number_ = number_here;
    return std::nullopt;
  }

  std::string_view name_;
  Samples& samples_;
  long line_ = 0;
  int trial_number_ = 0;
  Cells first_;  // of the trial's first row
  std::unordered_set<int> seen_;
};

}  // namespace

std::string_view name_of(Source source) {
  return source == Source::kSimulated ? "simulated" : "recorded";
}

std::string_view name_of(Label label) {
  constexpr std::array<std::string_view, 4> kNames{"hold", "slip", "empty", "open"};
  return kNames[static_cast<std::size_t>(label)];
}

void write_csv(std::ostream& out, const Samples& samples) {
  fmt::memory_buffer text;
  const auto at = std::back_inserter(text);
  for (std::size_t i = 0; i < kColumnCount; ++i) fmt::format_to(at, "{}{}", i > 0 ? "," : "", column_name(i));
  fmt::format_to(at, "\n");
  for (std::size_t i = 0; i < samples.trials.size(); ++i) {
    const Trial& trial = samples.trials[i];
    const std::string head = fmt::format("{},{},{},{},{},{}", name_of(trial.source), cell_of(trial.object),
                                         cell_of(trial.primitive), cell_of(trial.kind), trial.seed, i);
    for (const Row& row : samples.of(trial)) {
      fmt::format_to(at, "{},{},{:.6f},{},{:.6g},{:.6g},{}", head, row.frame, row.t_s, name_of(row.label),
                     row.slip_fraction, row.slide_mm_s, row.accepted ? 1 : 0);
      for (const std::int32_t x : row.x) fmt::format_to(at, ",{}", x);
      fmt::format_to(at, "\n");
    }
    out.write(text.data(), static_cast<std::streamsize>(text.size()));
    text.clear();
  }
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
}

std::optional<std::string> read_csv(std::istream& in, std::string_view name, Samples& samples) {
  samples = {};
  std::string text;
  constexpr std::size_t kChunk = std::size_t{1} << 20;
  while (in) {
    const std::size_t had = text.size();
    text.resize(had + kChunk);
    in.read(text.data() + had, kChunk);
    text.resize(had + static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  }
  if (!in.eof()) {
    return fmt::format(
        "{}:1: cannot be read. Likely cause: no such file, a folder, or no right to read it. Next: give a file that "
        "`holdfast dataset` wrote",
        name);
  }
  return Reader(name, samples).read(text);
}

void append(Samples& all, Samples more) {
  const auto first_trial = static_cast<int>(all.trials.size());
  const auto first_row = static_cast<int>(all.rows.size());
  for (Trial& trial : more.trials) {
    trial.first += first_row;
    all.trials.push_back(std::move(trial));
  }
  for (Row& row : more.rows) {
    row.trial += first_trial;
    all.rows.push_back(row);
  }
}

}  // namespace holdfast::learn
