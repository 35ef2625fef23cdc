// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "base/math.hpp"
#include "toolchain/holdfast/evaluate_recorded.hpp"
#include "toolchain/learn/pairs.hpp"
#include "toolchain/session/pair.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::tool {
namespace {

using learn::ClipLabels;
using learn::ClipScore;
using learn::FusionScore;

// Of a finger that raises alone, 1/256 octave. Steps of an eighth; beyond the last ones detections are lost.
std::vector<int> all_settings() {
  std::vector<int> settings;
  for (int alone_q8 = 0; alone_q8 <= 384; alone_q8 += 32) settings.push_back(alone_q8);
  return settings;
}

struct Pair {
  std::array<ClipLabels, 2> labels;
  std::array<FingerTrack, 2> tracks;
  std::string error;
  learn::Offset offset;
  ClipLabels hand;
  std::vector<FusionScore> scores;  // of each setting
};

ClipScore score_of(const Pair& pair, const std::vector<std::uint8_t>& slip) {
  ClipScore score;
  learn::add_clip(score, pair.hand, slip, nullptr);
  return score;
}

// What the right finger alone says, in the left's frames. Where its recording has none, it says nothing.
std::vector<std::uint8_t> right_slip(const Pair& pair) {
  std::vector<std::uint8_t> slip(pair.tracks[0].frames.size());
  for (int i = 0; i < static_cast<int>(slip.size()); ++i) {
    const int j = i + pair.offset.frames;
    if (j >= 0 && idx(j) < pair.tracks[1].slip.size()) slip[idx(i)] = pair.tracks[1].slip[idx(j)];
  }
  return slip;
}

FusionScore sum_of(const ClipScore& score) {
  FusionScore sum;
  sum.add(score);
  return sum;
}

fingers::Config with(fingers::Config config, int alone_q8) {
  config.fusion.alone_q8 = alone_q8;
  return config;
}

void play(const RecordedOptions& options, const fingers::Config& config, const std::vector<int>& settings, Pair& pair) {
  for (std::size_t i = 0; i < 2 && pair.error.empty(); ++i) {
    ReplayOptions replayed;
    replayed.input = pair.labels[i].path.string();
    replayed.reference = learn::rest_of(pair.labels[i], options.empty).reference;
    replayed.common.grid = options.grid;
    replayed.common.model = options.model;
    pair.error = play_finger(replayed, pair.tracks[i]);
  }
  if (!pair.error.empty()) pair.tracks = {};
  pair.offset = learn::find_offset(speeds_of(pair.tracks[0].frames), speeds_of(pair.tracks[1].frames));
  pair.hand = learn::merged(pair.labels[0], pair.labels[1], pair.offset.frames);
  for (const int setting : settings) {
    const auto slip = fused_slip(with(config, setting), pair.tracks[0], pair.tracks[1], pair.offset.frames);
    pair.scores.push_back(sum_of(score_of(pair, slip)));
  }
}

// The whole of the pairs but those of one object.
struct Sums {
  std::vector<FusionScore> settings;
  FusionScore left, right;
};
Sums sums_without(const std::vector<Pair>& pairs, std::size_t settings, const std::string& object) {
  Sums sums{std::vector<FusionScore>(settings), {}, {}};
  for (const Pair& pair : pairs) {
    if (pair.hand.object == object) continue;
    for (std::size_t s = 0; s < settings; ++s) sums.settings[s] += pair.scores[s];
    sums.left += sum_of(score_of(pair, pair.tracks[0].slip));
    sums.right += sum_of(score_of(pair, right_slip(pair)));
  }
  return sums;
}

learn::Table curve_table(const std::vector<int>& settings, const Sums& sums) {
  learn::Table table{
      .id = "pairs_curve",
      .title = "Thresholds of the fused decision",
      .note = "Octaves above the model's threshold for one finger alone; two that agree raise at the threshold.",
      .brief = true,
      .columns = {{"alone_q8", "alone, 1/256", "threshold", 0},
                  {"within_5", "5", "onsets within", 0},
                  {"within_10", "10", "onsets within", 0},
                  {"quiet", "silent, empty", "alarms", 0},
                  {"whole", "whole trial", "alarms", 0},
                  {"brief", "brief", "", 0, false}}};
  table.brief_id = "brief";
  table.brief_value = "yes";
  const auto add = [&](learn::Cell alone, const FusionScore& score, bool brief) {
    table.rows.push_back(
        {std::move(alone), score.within_5, score.within_10, score.quiet, score.whole, brief ? "yes" : "no"});
  };
  add("left alone", sums.left, true);
  add("right alone", sums.right, true);
  for (std::size_t s = 0; s < settings.size(); ++s) {
    add(settings[s], sums.settings[s], settings[s] % 64 == 0);
  }
  return table;
}

learn::Table offsets_table(const std::vector<Pair>& pairs, const std::vector<int>& chosen) {
  learn::Table table{.id = "pairs",
                     .title = "Pairs",
                     .note =
                         "Offset: the right recording's frame i + offset shows what the left's frame i does. Chosen: "
                         "by the pairs of all other objects.",
                     .columns = {{"pair", "pair", ""},
                                 {"frames", "frames", "", 0},
                                 {"offset", "offset", "", 0},
                                 {"correlation", "correlation", "", 2},
                                 {"alone_q8", "alone", "chosen, 1/256", 0},
                                 {"error", "error", ""}}};
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    const Pair& pair = pairs[p];
    table.rows.push_back({pair.hand.name, static_cast<int>(pair.tracks[0].frames.size()), pair.offset.frames,
                          pair.offset.correlation, chosen[p], pair.error});
  }
  return table;
}

}  // namespace

std::string evaluate_pairs(const RecordedOptions& options, learn::ReportFacts& facts, std::vector<learn::Table>& tables,
                           const std::function<void(long, long)>& progress) {
  std::vector<ClipLabels> clips;
  for (const std::string& file : options.labels) {
    if (auto error = learn::read_labels(file, clips)) return *error;
  }
  std::vector<Pair> pairs;
  for (const auto& [left, right] : learn::pairs_of(clips)) {
    pairs.push_back({{clips[left], clips[right]}, {}, {}, {}, {}, {}});
  }
  if (pairs.empty()) {
    return "--pairs: no two clips belong together. Likely cause: recordings of one finger, or label files of the other "
           "left out. Next: give the label files of both; names differ after the last __ alone, as "
           "mug__exp_num_1__camera_0 and mug__exp_num_1__camera_2";
  }
  CommonOptions common;
  common.grid = options.grid;
  common.model = options.model;
  Params params;
  bool auto_grid = false;
  std::unique_ptr<model::Tree> tree;
  std::string model_text;
  if (std::string error = settle(common, params, auto_grid, tree, model_text); !error.empty()) return error;
  const fingers::Config config =
      fingers::config_of(2, pipeline_config(params, auto_grid, tree.get()), supervisor_config(params));
  const std::vector<int> settings = all_settings();
  each_of(pairs.size(), options.jobs, progress, [&](std::size_t p) { play(options, config, settings, pairs[p]); });
  if (interrupted()) return interrupted_line();
  for (const Pair& pair : pairs) {
    if (!pair.error.empty()) facts.warnings.push_back("not replayed: " + pair.error);
    for (std::size_t i = 0; i < 2; ++i) {
      const auto frames = static_cast<long>(pair.tracks[i].frames.size());
      if (auto error =
              pair.error.empty() ? learn::check_length(pair.labels[i], frames) : learn::check_length(pair.labels[i])) {
        return *error;
      }
    }
  }

  std::set<std::string> objects;
  for (const Pair& pair : pairs) objects.insert(pair.hand.object);
  std::map<std::string, int> unseen;
  for (const std::string& object : objects) {
    const Sums sums = sums_without(pairs, settings.size(), object);
    unseen[object] = settings[learn::choose(sums.settings, sums.left, sums.right)];
  }
  const Sums all = sums_without(pairs, settings.size(), {});
  const int best = settings[learn::choose(all.settings, all.left, all.right)];

  std::array<ScoreRow, 5> rows{{{"left alone", "all", {}},
                                {"right alone", "all", {}},
                                {"hand (compiled)", "all", {}},
                                {"hand (leave-one-out)", "all", {}},
                                {"hand (chosen on all)", "all", {}}}};
  std::vector<int> chosen;
  for (const Pair& pair : pairs) {
    const auto fused = [&](const fingers::Config& by) {
      return fused_slip(by, pair.tracks[0], pair.tracks[1], pair.offset.frames);
    };
    chosen.push_back(unseen.at(pair.hand.object));
    const std::array slips{pair.tracks[0].slip, right_slip(pair), fused(config), fused(with(config, chosen.back())),
                           fused(with(config, best))};
    for (std::size_t r = 0; r < rows.size(); ++r) learn::add_clip(rows[r].score, pair.hand, slips[r], nullptr);
  }
  const std::vector<ScoreRow> listed(rows.begin(), rows.end());

  facts.source = "recorded";
  facts.facts = {
      {"model", model_text},
      {"labels", fmt::format("{}", fmt::join(options.labels, ", "))},
      {"pairs", fmt::format("{} of {} objects, by their names", pairs.size(), objects.size())},
      {"truth",
       "of both fingers, in the left's frames: slip where either's labels say so, from the earlier onset on; "
       "silent or empty where both do; the lower confidence. Every row is scored against it"},
      {"compiled", fmt::format("alone {}", config.fusion.alone_q8)},
      {"chosen on all", fmt::format("alone {}: no fewer onsets than the better finger, fewest "
                                    "alarms in silence, earliest within a standard error of the fewest alarms",
                                    best)}};
  tables = {silence_table("pairs_silence", "Labelled silence of both fingers", listed),
            trial_table("pairs_trials", "Whole trials by phase", listed), curve_table(settings, all),
            offsets_table(pairs, chosen)};
  return {};
}

}  // namespace holdfast::tool
