// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/evaluate_recorded.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <utility>

#include "base/math.hpp"
#include "toolchain/learn/clip_score.hpp"
#include "toolchain/learn/evaluate.hpp"
#include "toolchain/learn/labels.hpp"
#include "toolchain/learn/recorded.hpp"
#include "toolchain/learn/threshold.hpp"
#include "toolchain/session/replay.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;
using learn::Cell;
using learn::ClipLabels;
using learn::ClipScore;

// One replay. The decision, its state and its reason are all that the report is about; the two numbers are what the
// detectors for comparison decide by.
struct Trace {
  std::vector<std::uint8_t> slip;  // one a frame; none: the clip could not be replayed
  std::vector<DeviceState> state;
  std::vector<Reason> reason;
  std::vector<std::uint8_t> touching;
  std::vector<std::uint8_t> lost;  // the contact ended, and is reported as lost
  std::vector<double> speed_mm_s;  // of the markers' mean
  std::vector<double> imprint_um;  // motion of the imprint against the gel while its relief does not grow
  long accepted = 0;
  std::string error;

  void add(const App& app) {
    const pipeline::Result& result = app.result();
    const bool known = result.quality.ok() && result.referenced;
    const Features& f = result.features;
    slip.push_back(app.outputs().slip ? 1 : 0);
    state.push_back(app.outputs().state);
    reason.push_back(result.quality.ok() ? app.outputs().reason : result.quality.reason);
    touching.push_back(result.contact.touching ? 1 : 0);
    lost.push_back(result.contact.event == contact::Event::kLost ? 1 : 0);
    speed_mm_s.push_back(known ? std::hypot(f.vx.raw(), f.vy.raw()) / 1000.0 : 0.0);
    const bool moves = known && f.imprint.motion.raw() > 0 && f.imprint.growth.raw() <= learn::kMostGrowth;
    imprint_um.push_back(moves ? std::exp2(f.imprint.motion.raw() / 256.0) : 0.0);
    accepted += result.quality.ok() ? 1 : 0;
  }
};

struct Clip {
  ClipLabels labels;
  std::string folder;  // label file, as "real/labels.csv"
  learn::Rest rest;
  Trace ours;
  Trace paper;
};

void play(const RecordedOptions& options, Clip& clip) {
  ReplayOptions replayed;
  replayed.input = clip.labels.path.string();
  replayed.reference = clip.rest.reference;
  replayed.common.grid = options.grid;
  replayed.common.model = options.model;
  const auto run = [&](Trace& trace) {
    trace.error = replay_quietly(replayed, [&](const App& app) { trace.add(app); });
    if (!trace.error.empty()) trace.slip.clear();
  };
  run(clip.ours);
  replayed.common.model.clear();
  replayed.common.feature_set = "paper";
  run(clip.paper);
}

struct Detector {
  std::string name;
  std::vector<std::vector<std::uint8_t>> slip;  // of each clip
};

std::vector<Detector> detectors_of(const std::vector<Clip>& clips) {
  Detector ours{"holdfast", {}};
  Detector paper{"the paper's four features", {}};
  std::vector<learn::ClipValues> imprint;
  std::vector<learn::ClipValues> motion;
  for (const Clip& clip : clips) {
    ours.slip.push_back(clip.ours.slip);
    paper.slip.push_back(clip.paper.slip);
    const bool played = !clip.ours.slip.empty();
    using Values = std::vector<double>;
    imprint.push_back({&clip.labels, clip.ours.slip, played ? clip.ours.imprint_um : Values{}});
    motion.push_back({&clip.labels, clip.ours.slip, played ? clip.ours.speed_mm_s : Values{}});
  }
  return {std::move(ours),
          std::move(paper),
          {"imprint alone", learn::leave_one_object_out(imprint)},
          {"motion start", learn::leave_one_object_out(motion)}};
}

// --- tables ---

struct Group {
  std::string name;
  std::vector<std::size_t> clips;
};

std::vector<Group> groups_by(const std::vector<Clip>& clips, const std::function<std::string(const Clip&)>& name) {
  std::vector<Group> groups;
  for (std::size_t c = 0; c < clips.size(); ++c) {
    const std::string of = name(clips[c]);
    auto at = std::ranges::find(groups, of, &Group::name);
    if (at == groups.end()) at = groups.insert(at, {of, {}});
    at->clips.push_back(c);
  }
  return groups;
}

ClipScore score_of(const std::vector<Clip>& clips, const Group& group, const Detector& detector) {
  ClipScore score;
  for (const std::size_t c : group.clips) learn::add_clip(score, clips[c].labels, detector.slip[c], nullptr);
  return score;
}

void add_alarms(std::vector<learn::Column>& columns, const std::string& id, const std::string& group) {
  columns.push_back({id + "_alarms", "alarms", group, 0});
  columns.push_back({id + "_min", "in min", group, 1});
  columns.push_back({id + "_per_min", "a minute", group, 2});
  columns.push_back({id + "_low", "from", group, 2});
  columns.push_back({id + "_high", "to", group, 2});
}

void add_alarms(std::vector<Cell>& row, const learn::Alarms& alarms) {
  const learn::PoissonInterval interval = learn::poisson_interval(alarms.count);
  const double minutes = alarms.minutes();
  const auto rate = [&](double count) { return minutes > 0.0 ? std::optional(count / minutes) : std::nullopt; };
  row.insert(row.end(), {alarms.count, minutes, alarms.per_minute(), rate(interval.low), rate(interval.high)});
}

void add_share(std::vector<learn::Column>& columns, const std::string& id, const std::string& group) {
  columns.push_back({id + "_low", "from %", group, 0});
  columns.push_back({id + "_high", "to %", group, 0});
}

void add_share(std::vector<Cell>& row, int hits, int count) {
  const learn::ShareInterval share = learn::share_interval(hits, count);
  row.insert(row.end(), {100.0 * share.low, 100.0 * share.high});
}

std::optional<double> median(std::vector<int> values) {
  if (values.empty()) return std::nullopt;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

learn::Table silence_table(const std::string& id, const std::string& title, const std::vector<ScoreRow>& rows) {
  learn::Table table{
      .id = id,
      .title = title,
      .note =
          "Alarm: slip rises. An onset is detected when an alarm comes after the last silent frame before it, at most "
          "6 frames early, and at most 5, 10 or 15 frames late. Silence of high and medium confidence; shaken: its "
          "frames 100 to 250, without artificial_strawberry. Second slips: to loss, after a first slip. Intervals: 95 "
          "%, Clopper and Pearson for shares, Garwood for rates. A minute has 1500 frames.",
      .brief = true,
      .columns = {{"detector", "detector", ""},
                  {"of", "clips of", ""},
                  {"onsets", "onsets", "", 0},
                  {"within_5", "5", "detected within", 0},
                  {"within_10", "10", "detected within", 0},
                  {"within_15", "15", "detected within", 0}}};
  add_share(table.columns, "within_10", "detected within");
  table.columns.push_back({"delay", "median delay", "", 0});
  table.columns.push_back({"seconds", "onsets", "second slips", 0, false});
  table.columns.push_back({"seconds_10", "within 10", "second slips", 0, false});
  add_alarms(table.columns, "silent", "labelled silence");
  add_alarms(table.columns, "shaken", "of it shaken");
  add_alarms(table.columns, "empty", "empty gel");
  for (const auto& [detector, of, score] : rows) {
    std::vector<Cell>& row = table.rows.emplace_back();
    row = {detector, of, score.onsets.count, score.onsets.within[0], score.onsets.within[1], score.onsets.within[2]};
    add_share(row, score.onsets.within[1], score.onsets.count);
    row.emplace_back(median(score.onsets.delays));
    row.insert(row.end(), {score.seconds.count, score.seconds.within[1]});
    add_alarms(row, score.silent);
    add_alarms(row, score.shaken);
    add_alarms(row, score.empty);
  }
  return table;
}

learn::Table trial_table(const std::string& id, const std::string& title, const std::vector<ScoreRow>& rows) {
  learn::Table table{
      .id = id,
      .title = title,
      .note =
          "Alarms in clips whose labels are of high or medium confidence, outside of slips (3 frames before to 15 "
          "after), by phase. Touch: 1 frame before to 12 after the first contact; shake: frames 100 to 250 of clips of "
          "400 and more; load step and release: 5 frames beyond either end, not part of the whole; hold: all other "
          "frames. Where contact begins later than frame 3 the first 13 frames are left out.",
      .brief = true,
      .columns = {{"detector", "detector", ""}, {"of", "clips of", ""}, {"trials", "trials", "", 0}}};
  add_alarms(table.columns, "whole", "whole trial");
  table.columns.push_back({"per_trial", "a trial", "whole trial", 2});
  for (std::size_t p = 0; p < learn::kScoredPhases; ++p) {
    std::string name(learn::kPhaseNames[p]);
    std::ranges::replace(name, ' ', '_');
    table.columns.push_back({name + "_alarms", std::string(learn::kPhaseNames[p]), "alarms", 0});
    table.columns.push_back({name + "_min", std::string(learn::kPhaseNames[p]) + ", min", "alarms", 2, false});
  }
  table.columns.push_back({"touches", "clips", "touch", 0});
  table.columns.push_back({"touches_alarmed", "alarmed", "touch", 0});
  add_share(table.columns, "touches_alarmed", "touch");
  for (const auto& [detector, of, score] : rows) {
    std::vector<Cell>& row = table.rows.emplace_back();
    row = {detector, of, score.trials};
    const learn::Alarms whole = score.whole();
    add_alarms(row, whole);
    row.emplace_back(score.trials > 0 ? std::optional(double(whole.count) / score.trials) : std::nullopt);
    for (const learn::Alarms& phase : score.phases) row.insert(row.end(), {phase.count, phase.minutes()});
    row.insert(row.end(), {score.touches, score.touches_alarmed});
    add_share(row, score.touches_alarmed, score.touches);
  }
  return table;
}

namespace {

// Every missed onset and every alarm of one detector.
void add_findings(learn::Table& table, const std::vector<Clip>& clips, const Detector& detector, bool full) {
  for (std::size_t c = 0; c < clips.size(); ++c) {
    const Clip& clip = clips[c];
    std::vector<learn::Finding> findings;
    ClipScore unused;
    learn::add_clip(unused, clip.labels, detector.slip[c], &findings);
    for (const learn::Finding& one : findings) {
      const bool counted = one.missed || one.silent || one.phase < learn::Phase::kSlip;
      const bool listed = full && counted;
      const auto t = idx(one.frame);
      const bool known = full && !one.missed && t < clip.ours.slip.size();
      table.rows.push_back(
          {detector.name, clip.folder, clip.labels.name, one.frame, learn::kPhaseNames[idx(int(one.phase))],
           one.missed   ? "missed"
           : one.silent ? "false alarm"
           : counted    ? "alarm"
                        : "not counted",
           one.what, known ? info(clip.ours.state[t]).name : std::string_view(),
           known ? info(clip.ours.reason[t]).name : std::string_view(), listed ? "yes" : "no", clip.labels.note});
    }
  }
}

learn::Table findings_table(const std::vector<Clip>& clips, const std::vector<Detector>& detectors) {
  learn::Table table{
      .id = "findings",
      .title = "Missed onsets and alarms",
      .note =
          "False alarm: in labelled silence or on the empty gel. Alarm: elsewhere in the whole trial. Not "
          "counted: at a slip, or where labels are not sure.",
      .brief = true,
      .brief_id = "listed",
      .brief_value = "yes",
      .columns = {{"detector", "detector", "", 1, false},
                  {"of", "clips of", ""},
                  {"clip", "clip", ""},
                  {"frame", "frame", "", 0},
                  {"phase", "phase", ""},
                  {"counts_as", "counts as", ""},
                  {"what", "what", ""},
                  {"state", "state", "", 1, false},
                  {"reason", "reason", "", 1, false},
                  {"listed", "listed", "", 1, false},
                  {"note", "note of the labels", "", 1, false}}};
  for (const Detector& detector : detectors) {
    add_findings(table, clips, detector, &detector == &detectors.front());
  }
  return table;
}

learn::Table clips_table(const std::vector<Clip>& clips) {
  learn::Table table{.id = "clips",
                     .title = "Clips",
                     .note = "How each was replayed. A clip that could not be replayed has detected nothing.",
                     .columns = {{"of", "clips of", ""},
                                 {"clip", "clip", ""},
                                 {"object", "object", ""},
                                 {"reference", "reference", ""},
                                 {"rest", "rest", ""},
                                 {"frames", "frames", "", 0},
                                 {"accepted", "accepted", "", 0},
                                 {"error", "error", ""}}};
  for (const Clip& clip : clips) {
    table.rows.push_back({clip.folder, clip.labels.name, clip.labels.object, clip.rest.reference,
                          clip.rest.in_contact ? "in contact" : "empty", static_cast<int>(clip.ours.slip.size()),
                          static_cast<int>(clip.ours.accepted), clip.ours.error});
  }
  return table;
}

// A loss of contact is SLIP as well, though `slip` does not rise: those where the labels know of none.
std::string losses_of(const std::vector<Clip>& clips) {
  int silent = 0, empty = 0;
  for (const Clip& clip : clips) {
    bool began_empty = false;
    for (std::size_t t = 0; t < clip.ours.lost.size(); ++t) {
      const int frame = static_cast<int>(t);
      if (clip.ours.touching[t] != 0 && t > 0 && clip.ours.touching[t - 1] == 0) {
        began_empty = clip.labels.is_empty(frame);
      }
      if (clip.ours.lost[t] == 0) continue;
      silent += clip.labels.is_silent(frame) ? 1 : 0;
      empty += began_empty && clip.labels.is_empty(frame) ? 1 : 0;
    }
  }
  return fmt::format(
      "SLIP (contact_lost) is no alarm in these tables. It came {} times in labelled silence, and {} times "
      "of what seemed to touch a gel that is labelled empty",
      silent, empty);
}

// What a reader has to know before the figures.
void warn(const std::vector<Clip>& clips, learn::ReportFacts& facts) {
  int count = 0;
  for (const Clip& clip : clips) {
    if (!clip.ours.error.empty()) facts.warnings.push_back("not replayed: " + clip.ours.error);
    for (const std::string& one : learn::contradictions(clip.labels)) {
      facts.warnings.push_back("the labels contradict each other: " + one);
    }
    count += clip.rest.in_contact ? 1 : 0;
  }
  if (count == 0) return;
  facts.warnings.push_back(
      fmt::format("rest in contact, by --reference last, in {} clips: they never show the empty gel, and there is no "
                  "empty_CAMERA.png beside the labels; the table clips names them",
                  count));
}

}  // namespace

void each_of(std::size_t count, int jobs, const std::function<void(long, long)>& progress,
             const std::function<void(std::size_t)>& work) {
  std::mutex mutex;
  std::size_t next = 0;
  long done = 0;
  const auto take = [&] {
    for (std::unique_lock lock(mutex); next < count && !interrupted();) {
      const std::size_t one = next++;
      lock.unlock();
      work(one);
      lock.lock();
      progress(++done, static_cast<long>(count));
    }
  };
  std::vector<std::jthread> workers;
  for (int job = 1; job < jobs; ++job) workers.emplace_back(take);
  take();
}

std::string evaluate_recorded(const RecordedOptions& options, learn::ReportFacts& facts,
                              std::vector<learn::Table>& tables, const std::function<void(long, long)>& progress) {
  std::vector<ClipLabels> labels;
  for (const std::string& file : options.labels) {
    if (auto error = learn::read_labels(file, labels)) return *error;
  }
  std::vector<Clip> clips;
  for (ClipLabels& clip : labels) {
    const fs::path path = fs::absolute(clip.file);
    const std::string folder = (path.parent_path().filename() / path.filename()).string();
    learn::Rest rest = learn::rest_of(clip, options.empty);
    clips.push_back({std::move(clip), folder, std::move(rest), {}, {}});
  }
  // A wrong model or option is wrong for every clip.
  CommonOptions common;
  common.grid = options.grid;
  common.model = options.model;
  Params params;
  bool auto_grid = false;
  std::unique_ptr<model::Tree> tree;
  std::string model_text;
  if (std::string error = settle(common, params, auto_grid, tree, model_text); !error.empty()) return error;

  each_of(clips.size(), options.jobs, progress, [&](std::size_t c) { play(options, clips[c]); });
  if (interrupted()) return interrupted_line();
  for (const Clip& clip : clips) {
    const auto frames = static_cast<long>(clip.ours.slip.size());
    if (auto error = frames > 0 ? learn::check_length(clip.labels, frames) : learn::check_length(clip.labels)) {
      return *error;
    }
  }

  const std::vector<Detector> detectors = detectors_of(clips);
  Group all{"all", {}};
  for (std::size_t c = 0; c < clips.size(); ++c) all.clips.push_back(c);
  const std::vector<Group> folders = groups_by(clips, [](const Clip& clip) { return clip.folder; });
  const std::vector<Group> objects = groups_by(clips, [](const Clip& clip) { return clip.labels.object; });
  std::vector<ScoreRow> by_folder;
  for (const Detector& detector : detectors) {
    if (folders.size() > 1) by_folder.push_back({detector.name, all.name, score_of(clips, all, detector)});
    for (const Group& group : folders)
      by_folder.push_back({detector.name, group.name, score_of(clips, group, detector)});
  }
  std::vector<ScoreRow> by_object;
  by_object.reserve(objects.size());
  for (const Group& group : objects) {
    by_object.push_back({detectors.front().name, group.name, score_of(clips, group, detectors.front())});
  }

  facts.source = "recorded";
  facts.facts = {
      {"model", model_text},
      {"labels", fmt::format("{}", fmt::join(options.labels, ", "))},
      {"clips", fmt::format("{} of {} objects, each as holdfast replay CLIP --grid {} --reference FRAME plays "
                            "it",
                            clips.size(), objects.size(), options.grid)},
      {"comparison",
       "imprint alone and motion start: one threshold each, for each object by the clips of the others, at no "
       "more alarms in their silence than holdfast raises there"},
      {"losses of contact", losses_of(clips)}};
  warn(clips, facts);
  tables = {silence_table("silence", "Labelled silence", by_folder),
            trial_table("trials", "Whole trials by phase", by_folder),
            silence_table("silence_objects", "Labelled silence by object", by_object),
            trial_table("trials_objects", "Whole trials by object", by_object),
            findings_table(clips, detectors),
            clips_table(clips)};
  return {};
}

}  // namespace holdfast::tool
