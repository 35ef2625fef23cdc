// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/labels.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <system_error>
#include <utility>
#include <variant>

#include "drivers/common/input_file.hpp"
#include "drivers/sim/recording.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "toolchain/learn/number_text.hpp"
#include "toolchain/log/recording_file.hpp"

namespace holdfast::learn {
namespace {

namespace fs = std::filesystem;

using Error = std::optional<std::string>;

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // some spreadsheets begin a file with it

// Which column was meant by a name that is none of ours; empty: none. Other columns are whoever's who labelled; one
// that is nearly ours would be left out without a word.
std::string_view misspelt(std::string_view name, const std::vector<std::string>& header) {
  if (std::ranges::find(kLabelColumns, name, &LabelColumn::name) != kLabelColumns.end()) return {};
  for (const LabelColumn& column : kLabelColumns) {
    const bool missing = std::ranges::find(header, column.name) == header.end();
    if (missing && 4 * scene::file::edits(name, column.name) <= column.name.size()) return column.name;
  }
  return {};
}

// Why the header's columns cannot be told apart: what an office program saved instead of commas in UTF-8. Empty: they
// can, or something else is wrong.
std::string_view other_table(std::string_view header) {
  if (header.starts_with("\xFF\xFE") || header.starts_with("\xFE\xFF")) return "it is UTF-16";
  const std::size_t at = header.find_first_of(",;\t");
  if (at == std::string_view::npos || header[at] == ',') return {};
  return header[at] == ';' ? "its cells are parted by semicolons" : "its cells are parted by tabs";
}

// A cell in quotes may hold commas; two quotes in it are one.
std::vector<std::string> cells_of(std::string_view line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"') {
      if (quoted && line.substr(i + 1).starts_with('"'))
        cells.back() += line[++i];
      else
        quoted = !quoted;
    } else if (line[i] == ',' && !quoted) {
      cells.emplace_back();
    } else {
      cells.back() += line[i];
    }
  }
  return cells;
}

std::vector<std::string_view> parts_of(std::string_view text) {
  std::vector<std::string_view> parts;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(';'), text.size());
    parts.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parts;
}

std::optional<Confidence> find_confidence(std::string_view name) {
  const auto* const at = std::ranges::find(kConfidenceNames, name);
  if (at == kConfidenceNames.end()) return std::nullopt;
  return static_cast<Confidence>(at - kConfidenceNames.begin());
}

bool overlap(const Frames& a, const Frames& b) {
  return a.from <= b.to && b.from <= a.to;
}

// One line of the file, by the names of its columns.
class LabelRow {
 public:
  LabelRow(const std::vector<std::string>& header, const std::vector<std::string>& cells, ClipLabels& clip)
      : header_(header), cells_(cells), clip_(clip) {}

  Error read() {
    if (cells_.size() != header_.size()) {
      return error(fmt::format("{} cells where {} are due", cells_.size(), header_.size()),
                   "a comma that stands in no quotes, or a line that was cut", "mend the line");
    }
    clip_.name = cell("clip");
    clip_.object = fs::path(clip_.name).stem().string();
    if (const std::size_t at = clip_.object.find("__exp"); at != std::string::npos && at > 0) clip_.object.resize(at);
    if (Error bad = find()) return bad;
    clip_.slip_kind = cell("slip_kind");
    clip_.event_kind = cell("event_kind");
    for (const auto& [frames, from, to] : {std::tuple(&clip_.contact, "contact_start", "contact_end"),
                                           {&clip_.slip, "slip_start", "slip_end"},
                                           {&clip_.release, "release_start", "release_end"},
                                           {&clip_.event, "event_start", "event_end"}}) {
      if (cell(from).empty() && cell(to).empty()) continue;
      frames->emplace();
      if (frames == &clip_.contact && cell(to).empty() && to_number(cell(from), clip_.contact->from) &&
          clip_.contact->from >= 0) {
        clip_.contact->to = kUnknownEnd;
        continue;
      }
      if (Error bad = interval(cell(from) + "-" + cell(to), **frames)) return bad;
    }
    const std::string onset = cell("onset_recorded");
    if (onset != "0" && onset != "1") {
      return error(fmt::format("onset_recorded '{}' is neither 0 nor 1", onset), "cells were shifted",
                   "write 1 when the slip begins inside of the clip, else 0");
    }
    clip_.onset_recorded = onset == "1";
    if (clip_.onset_recorded && !clip_.slip) {
      return error("onset_recorded is 1, but there is no slip_start", "one of the two cells was forgotten",
                   "write the frames of the slip, or onset_recorded 0");
    }
    if (const std::string text = cell("confidence"); !text.empty()) {
      const auto confidence = find_confidence(text);
      if (!confidence) {
        return error(fmt::format("confidence '{}' is none of high, medium and low", text), "a typing error",
                     "write one of the three");
      }
      clip_.confidence = *confidence;
    }
    clip_.note = cell("note");
    for (const std::string& text = cell("silent_intervals"); const std::string_view part : parts_of(text)) {
      const std::size_t colon = std::min(part.find(':'), part.size());
      const auto confidence = find_confidence(part.substr(std::min(colon + 1, part.size())));
      if (!confidence) {
        return error(fmt::format("silent interval '{}' has no confidence", part), "a typing error",
                     "write it as from-to:high, :medium or :low");
      }
      SilentFrames& silent = clip_.silent.emplace_back();
      silent.confidence = *confidence;
      if (Error bad = interval(part.substr(0, colon), silent)) return bad;
    }
    for (const std::string& text = cell("empty_intervals"); const std::string_view part : parts_of(text)) {
      if (Error bad = interval(part, clip_.empty.emplace_back())) return bad;
    }
    return quiet_in_slip();
  }

 private:
  // Empty where the file lacks the column.
  [[nodiscard]] std::string cell(std::string_view column) const {
    const auto at = std::ranges::find(header_, column);
    return at == header_.end() ? std::string() : cells_[static_cast<std::size_t>(at - header_.begin())];
  }

  [[nodiscard]] Error error(const std::string& what, std::string_view cause, std::string_view next) const {
    return label_error(clip_, what, cause, next);
  }

  Error find() {
    std::error_code ignored;
    for (const std::string_view ending : {"", ".avi", ".mjpg", ".mcap"}) {
      clip_.path = clip_.file.parent_path() / (clip_.name + std::string(ending));
      if (!clip_.name.empty() && fs::exists(clip_.path, ignored)) return {};
    }
    return error(fmt::format("clip '{}' is not beside the label file", clip_.name),
                 "it was moved, or the label file was taken alone", "put the clips into the label file's folder");
  }

  [[nodiscard]] Error interval(std::string_view text, Frames& frames) const {
    const std::size_t dash = std::min(text.find('-'), text.size());
    if (to_number(text.substr(0, dash), frames.from) &&
        to_number(text.substr(std::min(dash + 1, text.size())), frames.to) && frames.from >= 0 &&
        frames.to >= frames.from) {
      return {};
    }
    return error(fmt::format("'{}' is no interval of frames", text), "a typing error, or one end is missing",
                 "write the first and the last frame, counted from 0");
  }

  // A frame cannot count as slip and as silence at once; what is of low confidence does not count.
  [[nodiscard]] Error quiet_in_slip() const {
    if (!clip_.slip || clip_.confidence == Confidence::kLow) return {};
    const Frames& slip = *clip_.slip;
    const auto check = [&](const Frames& quiet, std::string_view kind) -> Error {
      if (!overlap(quiet, slip)) return {};
      return error(fmt::format("{} interval {}-{} overlaps the slip {}-{} of {}", kind, quiet.from, quiet.to, slip.from,
                               slip.to, clip_.name),
                   "a typing error in one of the two", "let the interval end before the slip or begin after it");
    };
    for (const SilentFrames& one : clip_.silent) {
      if (!one.sure()) continue;
      if (Error bad = check(one, "silent")) return bad;
    }
    for (const Frames& one : clip_.empty) {
      if (Error bad = check(one, "empty")) return bad;
    }
    return {};
  }

  const std::vector<std::string>& header_;
  const std::vector<std::string>& cells_;
  ClipLabels& clip_;
};

// A recording by whatever name or link it was found.
std::string place_of(const ClipLabels& clip) {
  std::error_code failed;
  const fs::path place = fs::canonical(clip.path, failed);
  return failed ? clip.path.string() : place.string();
}

}  // namespace

bool ClipLabels::is_empty(long frame) const {
  return std::ranges::any_of(empty, [&](const Frames& one) { return one.has(frame); });
}

bool ClipLabels::is_silent(long frame) const {
  return std::ranges::any_of(silent, [&](const SilentFrames& one) { return one.sure() && one.has(frame); });
}

std::string label_error(const ClipLabels& clip, std::string_view what, std::string_view cause, std::string_view next) {
  return fmt::format("{}:{}: {}. Likely cause: {}. Next: {}", clip.file.string(), clip.line, what, cause, next);
}

std::optional<std::string> read_labels(const fs::path& file, std::vector<ClipLabels>& clips) {
  std::ifstream in;
  if (std::string wrong = drivers::open_file(file, "give the labels.csv that lies beside the clips", in);
      !wrong.empty()) {
    return wrong;
  }
  std::vector<std::string> header;
  ClipLabels clip;
  clip.file = file;
  std::string text;
  const std::size_t before = clips.size();
  std::map<std::string, std::size_t> seen;  // recording: its place in `clips`
  for (std::size_t c = 0; c < before; ++c) seen.emplace(place_of(clips[c]), c);
  while (std::getline(in, text)) {
    ++clip.line;
    if (clip.line == 1 && text.starts_with(kByteOrderMark)) text.erase(0, kByteOrderMark.size());
    if (text.ends_with('\r')) text.pop_back();
    if (text.empty()) continue;
    const std::vector<std::string> cells = cells_of(text);
    if (!header.empty()) {
      ClipLabels& next = clips.emplace_back(clip);
      if (Error bad = LabelRow(header, cells, next).read()) return bad;
      const auto [at, is_new] = seen.emplace(place_of(next), clips.size() - 1);
      if (!is_new) {
        const ClipLabels& first = clips[at->second];
        return label_error(next,
                           fmt::format("{} is labelled in {}:{} too and would count twice", next.name,
                                       first.file.string(), first.line),
                           "a line was copied, or two versions of one label file are given",
                           "label each recording once, or give only one of the files");
      }
      continue;
    }
    header = cells;
    if (const std::string_view other = other_table(text); !other.empty()) {
      return label_error(clip, fmt::format("{}, and commas in UTF-8 are read", other),
                         "a spreadsheet program saved it in its own way", "save it as CSV, UTF-8, with commas");
    }
    for (const LabelColumn& column : kLabelColumns) {
      if (std::ranges::count(header, column.name) < 2) continue;
      return label_error(clip, fmt::format("column '{}' is there twice", column.name), "a column was copied",
                         "keep one of the two");
    }
    for (const std::string& name : header) {
      const std::string_view meant = misspelt(name, header);
      if (meant.empty()) continue;
      return label_error(clip, fmt::format("column '{}' is none that is read", name), "a typing error",
                         fmt::format("name it {}, or give it a name that is farther from that", meant));
    }
    for (const LabelColumn& column : kLabelColumns) {
      if (!column.required || std::ranges::find(header, column.name) != header.end()) continue;
      return label_error(clip, fmt::format("column '{}' is missing", column.name),
                         "no label file, or one without a header",
                         "name the columns in the first line; holdfast evaluate --help lists them");
    }
  }
  if (clips.size() > before) return {};
  clip.line = std::max(clip.line, 1);
  return label_error(clip, "there are no clips", "the file is empty, or was cut off",
                     "give a label file with a line for each clip");
}

std::vector<std::string> contradictions(const ClipLabels& clip) {
  std::vector<std::string> found;
  const auto add = [&](std::string_view what, const Frames& one, std::string_view other_what, const Frames& other) {
    const std::string to = other.to == kUnknownEnd ? "" : std::to_string(other.to);
    found.push_back(fmt::format("{}:{}: {}: {} {}-{} and {} {}-{}", clip.file.string(), clip.line, clip.name, what,
                                one.from, one.to, other_what, other.from, to));
  };
  if (clip.contact) {
    for (const Frames& one : clip.empty) {
      if (overlap(one, *clip.contact)) add("empty", one, "in contact", *clip.contact);
    }
    if (clip.slip && !overlap(*clip.slip, *clip.contact)) add("slip", *clip.slip, "in contact", *clip.contact);
  }
  for (std::size_t a = 0; a < clip.silent.size(); ++a) {
    for (std::size_t b = a + 1; b < clip.silent.size(); ++b) {
      if (clip.silent[a].confidence == clip.silent[b].confidence || !overlap(clip.silent[a], clip.silent[b])) continue;
      add("silent", clip.silent[a], "silent with another confidence", clip.silent[b]);
    }
  }
  return found;
}

std::optional<std::string> check_length(const ClipLabels& clip, long frames) {
  std::vector<Frames> all(clip.silent.begin(), clip.silent.end());
  all.insert(all.end(), clip.empty.begin(), clip.empty.end());
  for (const auto* one : {&clip.contact, &clip.slip, &clip.release, &clip.event}) {
    if (*one && (*one)->to != kUnknownEnd) all.push_back(**one);
  }
  for (const Frames& one : all) {
    if (one.to < frames) continue;
    return label_error(
        clip, fmt::format("interval {}-{} ends after the last frame {} of {}", one.from, one.to, frames - 1, clip.name),
        "frames counted from 1, or another cut of the clip", "count the clip's frames from 0");
  }
  return {};
}

std::optional<std::string> check_length(const ClipLabels& clip) {
  auto opened = log::open_recording(clip.path);
  auto* const recording = std::get_if<sim::Recording>(&opened);
  if (recording == nullptr) return {};
  const auto last = recording->at("last");
  const auto* const frame = std::get_if<sim::RecordedFrame>(&last);
  return frame == nullptr ? std::nullopt : check_length(clip, frame->index + 1);
}

std::optional<fs::path> empty_picture(const ClipLabels& clip) {
  const std::string stem = fs::path(clip.name).stem().string();
  const std::size_t camera = stem.rfind("__");
  const fs::path picture =
      clip.file.parent_path() / fmt::format("empty_{}.png", camera == std::string::npos ? "" : stem.substr(camera + 2));
  std::error_code ignored;
  if (!fs::exists(picture, ignored)) return std::nullopt;
  return picture;
}

Rest rest_of(const ClipLabels& clip, const std::string& empty) {
  std::vector<Frames> intervals;
  for (const Frames& one : clip.empty) {
    if (one.to - one.from >= 3) intervals.push_back(one);
  }
  for (const Frames& one : intervals) {
    if (clip.contact && one.to <= clip.contact->from) return {std::to_string((one.from + one.to) / 2)};
  }
  if (!intervals.empty()) return {std::to_string(intervals.back().to - 1)};
  if (!empty.empty()) return {empty};
  if (const auto picture = empty_picture(clip)) return {picture->string()};
  return {"last", true};
}

}  // namespace holdfast::learn
