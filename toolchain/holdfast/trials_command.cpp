// SPDX-License-Identifier: Apache-2.0
// holdfast trials: simulated grasps by seed through the firmware, counted.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/play/trials.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

struct TrialsOptions {
  std::string kind;
  int count = 60;
  int first = 0;
  std::uint64_t seed = 1;
  std::string csv;
  int scene = -1;
  CommonOptions common;  // of which the model and its like are used
};

nlohmann::json to_json(const TrialTally& tally) {
  const auto median = tally.median_delay();
  return {{"group", tally.group},
          {"trials", tally.trials},
          {"unreferenced", tally.unreferenced},
          {"onsets", tally.onsets},
          {"detected_in_time", tally.detected},
          {"detected", tally.delays.size()},
          {"median_delay_frames", median ? nlohmann::json(*median) : nlohmann::json()},
          {"alarms_closing", tally.alarms[0]},
          {"alarms_held", tally.alarms[1]},
          {"alarms_moved", tally.alarms[2]},
          {"alarms_partial", tally.partial_alarms},
          {"trials_with_alarm", tally.alarmed},
          {"contact_s", tally.contact_s},
          {"alarms_per_hour", tally.alarms_per_hour()}};
}

std::string csv_line(int number, const Trial& trial, const TrialResult& result) {
  return fmt::format("{},{},\"{}\",{},{},{:.3f},{},{},{},{:.2f},{}\n", number, trial.scene.name, trial.group,
                     result.onset_s ? fmt::format("{:.3f}", *result.onset_s) : "",
                     result.delay_frames ? fmt::format("{}", *result.delay_frames) : "", trial.closed_s,
                     result.alarms[0], result.alarms[1], result.alarms[2], result.contact_s, result.partial_alarms);
}

int trials(const TrialsOptions& options) {
  const auto kind =
      static_cast<TrialKind>(std::ranges::find(kTrialNames, std::string_view(options.kind)) - kTrialNames.begin());
  if (options.scene >= 0) {
    fmt::print("{}", scene::write_scene(make_trial(kind, options.seed, options.scene).scene));
    return 0;
  }
  Params params;
  bool auto_grid = false;
  std::unique_ptr<model::Tree> tree;
  std::string model_text;
  if (const std::string error = settle(options.common, params, auto_grid, tree, model_text); !error.empty())
    return fail(error);
  OutputFiles outputs({{"--csv", options.csv}}, {options.common.model}, "a model");
  if (!outputs.error().empty()) return fail(outputs.error());
  std::string lines =
      "trial,scene,group,onset_s,delay_frames,closed_s,alarms_closing,alarms_held,alarms_moved,contact_s,alarms_"
      "partial\n";
  TrialTable table;
  TrialTable alone;  // of hands: the left finger
  {
    Progress progress("trials", options.count);
    for (int k = 0; k < options.count; ++k) {
      const Trial trial = make_trial(kind, options.seed, options.first + k);
      TrialResult result;
      if (trial.right) {
        const HandResult both = run_hand(trial, params, tree.get());
        alone.add(trial, both.left);
        Trial left = trial;
        left.group += ", left alone";
        lines += csv_line(options.first + k, left, both.left);
        result = both.hand;
      } else {
        result = run_trial(trial, params, tree.get());
      }
      table.add(trial, result);
      lines += csv_line(options.first + k, trial, result);
      progress.update(k + 1);
      if (interrupted()) return fail(interrupted_line());
    }
  }
  if (std::ostream* const csv = outputs.stream("--csv")) *csv << lines;
  if (const std::string error = outputs.commit(); !error.empty()) return fail(error);
  if (options.common.json) {
    nlohmann::json out;
    out["kind"] = options.kind;
    out["seed"] = options.seed;
    out["model"] = model_text;
    for (const TrialTally& tally : table.groups()) out["groups"].push_back(to_json(tally));
    out["all"] = to_json(table.all());
    for (const TrialTally& tally : alone.groups()) out["left_alone"].push_back(to_json(tally));
    fmt::print("{}\n", text_of_json(out));
    return 0;
  }
  fmt::print("{} {} of seed {}, {}\n{}", options.count, options.kind, options.seed, model_text, table_text(table));
  if (!alone.groups().empty()) fmt::print("\nThe left finger alone, of the same frames\n{}", table_text(alone));
  return 0;
}

}  // namespace

void add_trials(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<TrialsOptions>();
  CLI::App* command =
      app.add_subcommand("trials", "simulated grasps by seed through the firmware: detections, latency, false alarms");
  command->add_option("KIND", options->kind, fmt::format("{}", fmt::join(kTrialNames, ", ")))
      ->required()
      ->check(CLI::IsMember(std::vector<std::string>(kTrialNames.begin(), kTrialNames.end())));
  command->add_option("--count", options->count, "how many")->check(CLI::Range(1, 100'000))->capture_default_str();
  command->add_option("--first", options->first, "number of the first")->check(CLI::Range(0, 1'000'000));
  command->add_option("--seed", options->seed, "of all of them")->capture_default_str();
  CLI::Option* const scene =
      command->add_option("--scene", options->scene, "print this trial's scene, for holdfast sim, and run nothing")
          ->check(CLI::Range(0, 1'000'000));
  command->add_option("--csv", options->csv, "a line for each trial: CSV")->check(not_empty)->excludes(scene);
  command->add_option("--model", options->common.model, "a model text or a compiled one, instead of the committed")
      ->check(not_empty)
      ->excludes(scene);
  command->add_option("--feature-set", options->common.feature_set, "what the model reads: paper has its own tree")
      ->excludes(scene);
  command->add_flag("--json", options->common.json, "print the table as JSON")->excludes(scene);
  command->footer(
      "closing        a gripper closes on a body at 5 to 100 mm/s and holds it; half are then shaken. Nothing slips\n"
      "closing_slip   the same, and 100 ms later the object is dragged away\n"
      "easing         the same, bonded, and the grip is eased. Nothing slips\n"
      "turn           a held object turns about the normal at 15, 40, 90 degrees a second\n"
      "turn_held      the same grasps, turned there and back by less than brings half-slip. Nothing slips\n"
      "slide          a sphere slides at 2 to 100 mm/s under five reliefs\n"
      "shaken         a bonded sphere with relief is shaken, 15 s each\n"
      "smooth, grasp  the paper's objects without and with their relief, all motions and outcomes in each 600\n"
      "hand           slides and closings between two fingers, the right one's contact smooth in half of them\n"
      "Example:\n"
      "  holdfast trials closing --count 500\n"
      "  holdfast trials turn --count 180 --model mine.tree --csv turn.csv\n"
      "  holdfast trials turn --scene 7 > turn_7.json && holdfast sim turn_7.json --report turn_7.html");
  commands.push_back({command, [options] { return trials(*options); }});
}

}  // namespace holdfast::tool
