// SPDX-License-Identifier: Apache-2.0
// Recordings with labels to samples, each clip through the firmware as `holdfast replay` does it.
//
// Label file: CSV with a header, one clip a line, inclusive frame numbers from 0; other columns are left alone.
//   clip              name of the recording beside the label file, without .avi or .mjpg, or with any ending
//   slip_start, _end  frames in which the object moves on the gel; empty: it never does
//   onset_recorded    0: it slides already when the clip begins
//   silent_intervals  a-b:high;c-d:medium;e-f:low  in contact and surely no slip; low is not sure enough to learn from
//   empty_intervals   a-b;c-d  nothing touches the gel
// Labels: slip from slip_start to slip_end, else hold in silent intervals of high or medium confidence, else open.
//
// Onsets: one counts when a hold row comes before it in the trial. A clip with onset_recorded = 0 keeps that rule: what
// comes before its slip is open, so its slip rows are judged as frames and never as an event. (Of the 27 real clips'
// 14 recorded onsets 13 count: in blue_box 2 nothing before the slip is sure.)
//
// Rest position, the first of these that there is: the clip's last frame if it is in an empty interval (nothing of
// the grasp is left then, and a late frame shows the gel as this trial left it); its first frame likewise;
// empty_CAMERA.png beside the label file, CAMERA being what follows the last "__" of the clip's name; else the first
// frame: displacements then count from the grip as it was when the clip began, which leaves rates as they are and the
// level of the entropy too low.
//
// The empty gel between the dots: the same picture and up to 32 beside it in that empty interval.
//
// Object: the clip's name up to "__exp". The trial's seed is the number after "__exp_num_", to tell clips apart.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <iterator>
#include <memory>
#include <system_error>
#include <utility>
#include <variant>

#include "app/pipeline.hpp"
#include "drivers/sim/recording.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/learn/firmware_row.hpp"
#include "toolchain/learn/number_text.hpp"
#include "toolchain/play/reference_picture.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::learn {
namespace {

namespace fs = std::filesystem;

using Error = std::optional<std::string>;

struct Interval {
  int from = 0;
  int to = 0;

  [[nodiscard]] bool has(long frame) const { return frame >= from && frame <= to; }
};

bool any_has(const std::vector<Interval>& intervals, long frame) {
  return std::ranges::any_of(intervals, [&](const Interval& one) { return one.has(frame); });
}

struct Clip {
  int line = 0;  // of the label file
  std::string name;
  fs::path path;
  std::optional<Interval> slip;
  bool onset_recorded = false;
  std::vector<Interval> silent;  // of high or medium confidence
  std::vector<Interval> empty;
};

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

class LabelFile {
 public:
  explicit LabelFile(fs::path path) : path_(std::move(path)) {}

  Error read(std::vector<Clip>& clips) {
    std::error_code ignored;
    std::ifstream in(path_, std::ios::binary);
    if (!in || fs::is_directory(path_, ignored)) {
      return fmt::format(
          "{}: cannot be read as a label file. Likely cause: no such file, a folder, or no right to read it. Next: "
          "give the labels.csv that lies beside the clips",
          path_.string());
    }
    std::string text;
    for (line_ = 1; std::getline(in, text); ++line_) {
      if (text.ends_with('\r')) text.pop_back();
      if (text.empty()) continue;
      const std::vector<std::string> cells = cells_of(text);
      if (line_ == 1) {
        if (Error bad = header(cells)) return bad;
        continue;
      }
      Clip clip;
      if (Error bad = row(cells, clip)) return bad;
      clips.push_back(std::move(clip));
    }
    if (!clips.empty()) return {};
    line_ = std::max(line_ - 1, 1);
    return error("there are no clips", "the file is empty, or was cut off",
                 "give a label file with a line for each clip");
  }

  [[nodiscard]] Error error(int line, const std::string& what, std::string_view cause, std::string_view next) const {
    return fmt::format("{}:{}: {}. Likely cause: {}. Next: {}", path_.string(), line, what, cause, next);
  }
  [[nodiscard]] Error error(int line, const std::string& whole) const {
    return fmt::format("{}:{}: {}", path_.string(), line, whole);
  }

 private:
  enum Column : std::size_t { kClip, kSlipStart, kSlipEnd, kOnset, kSilent, kEmpty };
  static constexpr std::array<std::string_view, 6> kColumns{"clip",           "slip_start",       "slip_end",
                                                            "onset_recorded", "silent_intervals", "empty_intervals"};

  [[nodiscard]] Error error(const std::string& what, std::string_view cause, std::string_view next) const {
    return error(line_, what, cause, next);
  }

  Error header(const std::vector<std::string>& cells) {
    width_ = cells.size();
    for (std::size_t i = 0; i < kColumns.size(); ++i) {
      const auto found = std::ranges::find(cells, kColumns[i]);
      if (found == cells.end()) {
        return error(fmt::format("column '{}' is missing", kColumns[i]), "no label file, or one without a header",
                     "name the columns in the first line; holdfast dataset --help lists them");
      }
      where_[i] = static_cast<std::size_t>(found - cells.begin());
    }
    return {};
  }

  Error row(const std::vector<std::string>& cells, Clip& clip) const {
    if (cells.size() != width_) {
      return error(fmt::format("{} cells where {} are due", cells.size(), width_),
                   "a comma that stands in no quotes, or a line that was cut", "mend the line");
    }
    const auto cell = [&](Column column) -> const std::string& { return cells[where_[column]]; };
    clip.line = line_;
    clip.name = cell(kClip);
    if (Error bad = find(clip)) return bad;
    if (cell(kOnset) != "0" && cell(kOnset) != "1") {
      return error(fmt::format("onset_recorded '{}' is neither 0 nor 1", cell(kOnset)), "cells were shifted",
                   "write 1 when the slip begins inside of the clip, else 0");
    }
    clip.onset_recorded = cell(kOnset) == "1";
    if (!cell(kSlipStart).empty() || !cell(kSlipEnd).empty()) {
      clip.slip.emplace();
      if (Error bad = interval(cell(kSlipStart) + "-" + cell(kSlipEnd), *clip.slip)) return bad;
    }
    for (const std::string_view part : parts_of(cell(kSilent))) {
      const std::size_t colon = std::min(part.find(':'), part.size());
      const std::string_view confidence = part.substr(std::min(colon + 1, part.size()));
      if (confidence != "high" && confidence != "medium" && confidence != "low") {
        return error(fmt::format("silent interval '{}' has no confidence", part), "a typing error",
                     "write it as from-to:high, :medium or :low");
      }
      Interval silent;
      if (Error bad = interval(part.substr(0, colon), silent)) return bad;
      if (confidence != "low") clip.silent.push_back(silent);
    }
    for (const std::string_view part : parts_of(cell(kEmpty))) {
      clip.empty.emplace_back();
      if (Error bad = interval(part, clip.empty.back())) return bad;
    }
    return {};
  }

  Error find(Clip& clip) const {
    std::error_code ignored;
    for (const std::string_view ending : {"", ".avi", ".mjpg"}) {
      clip.path = path_.parent_path() / (clip.name + std::string(ending));
      if (!clip.name.empty() && fs::exists(clip.path, ignored)) return {};
    }
    return error(fmt::format("clip '{}' is not beside the label file", clip.name),
                 "it was moved, or the label file was taken alone", "put the clips into the label file's folder");
  }

  Error interval(std::string_view text, Interval& interval) const {
    const std::size_t dash = std::min(text.find('-'), text.size());
    if (to_number(text.substr(0, dash), interval.from) &&
        to_number(text.substr(std::min(dash + 1, text.size())), interval.to) && interval.from >= 0 &&
        interval.to >= interval.from) {
      return {};
    }
    return error(fmt::format("'{}' is no interval of frames", text), "a typing error, or one end is missing",
                 "write the first and the last frame, counted from 0");
  }

  fs::path path_;
  int line_ = 0;
  std::size_t width_ = 0;
  std::array<std::size_t, kColumns.size()> where_{};
};

Trial trial_of(const Clip& clip) {
  constexpr std::string_view kNumber = "__exp_num_";
  Trial trial;
  trial.source = Source::kRecorded;
  const std::string stem = fs::path(clip.name).stem().string();
  trial.object = stem.substr(0, stem.find("__exp"));
  if (trial.object.empty()) trial.object = stem;
  trial.kind = "clip";
  if (const std::size_t at = stem.find(kNumber); at != std::string::npos) {
    (void)std::from_chars(stem.data() + at + kNumber.size(), stem.data() + stem.size(), trial.seed);
  }
  return trial;
}

Label label_of(const Clip& clip, long frame) {
  if (clip.slip && clip.slip->has(frame)) return Label::kSlip;
  const bool before_unseen_onset = clip.slip && !clip.onset_recorded && frame < clip.slip->from;
  if (any_has(clip.empty, frame)) return Label::kEmpty;
  return any_has(clip.silent, frame) && !before_unseen_onset ? Label::kHold : Label::kOpen;
}

// See the top of this file. `last` is the recording's last frame.
sim::Result<sim::RecordedFrame> rest_picture(const Clip& clip, const sim::Recording& recording, sim::RecordedFrame last,
                                             const luma_input::Config& luma) {
  if (any_has(clip.empty, last.index)) return last;
  if (!any_has(clip.empty, 0)) {
    const std::string stem = fs::path(clip.name).stem().string();
    const std::size_t camera = stem.rfind("__");
    const fs::path picture = clip.path.parent_path() /
                             fmt::format("empty_{}.png", camera == std::string::npos ? "" : stem.substr(camera + 2));
    std::error_code ignored;
    if (fs::exists(picture, ignored)) return tool::reference_picture(recording, picture.string(), luma);
  }
  return recording.at("first");
}

// More pictures of the empty gel that rest_picture() shows, for its mean and its noise: the others of its interval, or,
// of a picture that is a mean already, itself.
Error find_empty(const Clip& clip, RecordedClip& out) {
  constexpr int kMost = 32;
  const auto interval = std::ranges::find_if(clip.empty, [&](const Interval& one) { return one.has(out.rest.index); });
  if (interval == clip.empty.end()) {
    out.empty.assign(kMost, out.rest);
    return {};
  }
  const long first = std::max<long>(interval->from, out.rest.index - kMost);
  for (const sim::RecordedFrame& frame : out.frames) {
    if (interval->has(frame.index) && frame.index >= first && frame.index < first + kMost) out.empty.push_back(frame);
  }
  return {};
}

Error load_clip(const LabelFile& file, const Clip& clip, const luma_input::Config& luma, RecordedClip& out) {
  auto opened = sim::Recording::open(clip.path);
  if (const auto* error = std::get_if<sim::Error>(&opened)) return error->line;
  auto& recording = std::get<sim::Recording>(opened);
  auto end = recording.at("last");
  if (const auto* error = std::get_if<sim::Error>(&end)) return error->line;
  auto& last = std::get<sim::RecordedFrame>(end);
  std::vector<Interval> all = clip.silent;
  all.insert(all.end(), clip.empty.begin(), clip.empty.end());
  if (clip.slip) all.push_back(*clip.slip);
  for (const Interval& interval : all) {
    if (interval.to <= last.index) continue;
    return file.error(clip.line,
                      fmt::format("interval {}-{} ends after the last frame {} of {}", interval.from, interval.to,
                                  last.index, clip.name),
                      "frames counted from 1, or another cut of the clip", "count the clip's frames from 0");
  }
  auto picture = rest_picture(clip, recording, std::move(last), luma);
  if (const auto* error = std::get_if<sim::Error>(&picture)) return error->line;
  out.rest = std::get<sim::RecordedFrame>(std::move(picture));
  sim::RecordedFrame frame;
  sim::Read read = sim::Read::kFrame;
  while ((read = recording.next(frame)) == sim::Read::kFrame) {
    out.labels.push_back(label_of(clip, frame.index));
    out.frames.push_back(frame);
  }
  if (read == sim::Read::kError) return recording.error();
  out.trial = trial_of(clip);
  return find_empty(clip, out);
}

}  // namespace

std::optional<std::string> load_recordings(const fs::path& labels, const luma_input::Config& luma,
                                           const std::function<Error(const RecordedClip&)>& visit,
                                           const std::function<bool(int, int)>& progress) {
  LabelFile file(labels);
  std::vector<Clip> clips;
  if (Error bad = file.read(clips)) return bad;
  const int all = static_cast<int>(clips.size());
  for (int done = 0; done < all; ++done) {
    const Clip& clip = clips[idx(done)];
    RecordedClip loaded;
    if (Error bad = load_clip(file, clip, luma, loaded)) return bad;
    if (Error bad = visit(loaded)) return file.error(clip.line, fmt::format("{}: {}", clip.path.string(), *bad));
    if (progress && !progress(done + 1, all)) {
      return fmt::format("{}: stopped after clip {} of {}. Likely cause: you asked for it. Next: run it again",
                         labels.string(), done + 1, all);
    }
  }
  return {};
}

std::optional<std::string> learn_rest(const RecordedClip& clip, const pipeline::Config& config, JpegDecoder& jpeg,
                                      pipeline::State& state) {
  if (const Status s = pipeline::learn(state, config, jpeg, sim::as_frame(clip.rest)); !s.ok()) {
    const ReasonInfo& why = info(s.reason);
    return fmt::format("no rest position: {}. Likely cause: {}. Next: {}", why.what, why.cause, why.next);
  }
  for (const sim::RecordedFrame& frame : clip.empty) {
    (void)pipeline::learn_more(state, config, jpeg, sim::as_frame(frame));
  }
  return {};
}

std::optional<std::string> read_recordings(const fs::path& labels, const Params& params, Samples& samples,
                                           const std::function<bool(int, int)>& progress) {
  const pipeline::Config config = pipeline_config(with_all_features(params));
  tool::OneThreadDecoder jpeg(params);
  const auto play = [&](const RecordedClip& clip) -> Error {
    const auto state = std::make_unique<pipeline::State>();
    if (Error bad = learn_rest(clip, config, jpeg.get(), *state)) return bad;
    Trial trial = clip.trial;
    trial.first = static_cast<int>(samples.rows.size());
    trial.count = static_cast<int>(clip.frames.size());
    for (std::size_t k = 0; k < clip.frames.size(); ++k) {
      const sim::RecordedFrame& recorded = clip.frames[k];
      Row row = firmware_row(pipeline::update(*state, config, jpeg.get(), sim::as_frame(recorded)));
      row.trial = static_cast<int>(samples.trials.size());
      row.frame = static_cast<int>(recorded.index);
      row.t_s = static_cast<double>(recorded.time.count()) * 1e-6;
      row.label = clip.labels[k];
      row.slip_fraction = row.label == Label::kSlip ? 1.0 : 0.0;
      samples.rows.push_back(row);
    }
    samples.trials.push_back(std::move(trial));
    return {};
  };
  Error bad = load_recordings(labels, config.luma, play, progress);
  if (bad) samples = {};
  return bad;
}

}  // namespace holdfast::learn
