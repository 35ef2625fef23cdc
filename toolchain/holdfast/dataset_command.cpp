// SPDX-License-Identifier: Apache-2.0
// holdfast dataset: samples to learn from, of simulated grasps or of recordings with labels.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/file/words.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/labels.hpp"
#include "toolchain/learn/plan.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

struct DatasetOptions {
  std::string out;
  std::string recordings;
  learn::PlanOptions plan;
  std::string inject = "markers";
  std::optional<double> marker_noise_um, shear_modulus_mpa;
  std::string shard = "1/1";
  bool json = false;
};

double cpu_s() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

std::optional<std::string> simulate(const DatasetOptions& options, learn::Samples& samples) {
  const auto* const name = std::ranges::find(scene::kInjectNames, options.inject);
  const auto inject = static_cast<scene::Inject>(name - scene::kInjectNames.begin());
  learn::Plan plan;
  if (auto error = learn::make_plan(options.plan, plan)) return error;
  // The trials of the shards before this one keep their numbers: they are there, without rows.
  samples.trials.resize(static_cast<std::size_t>(plan.before));
  Progress progress("dataset", static_cast<long>(plan.grasps.size()));
  long done = 0;
  for (const learn::PlannedGrasp& grasp : plan.grasps) {
    learn::Planned planned = grasp.make();
    if (options.marker_noise_um) planned.scene.effects.marker_noise_um = *options.marker_noise_um;
    if (options.shear_modulus_mpa) planned.scene.gel.shear_modulus_mpa = *options.shear_modulus_mpa;
    learn::play_into(samples, planned, inject);
    progress.update(++done);
    if (interrupted()) return interrupted_line();
  }
  return {};
}

std::optional<std::string> read_clips(const DatasetOptions& options, learn::Samples& samples) {
  Progress progress("dataset", 1000);
  const auto error = learn::read_recordings(options.recordings, Params{}, samples, [&](int done, int all) {
    progress.update(1000L * done / std::max(all, 1));
    return !interrupted();
  });
  return interrupted() ? interrupted_line() : error;
}

// What the run reads, and may not change.
std::optional<std::string> inputs_of(const DatasetOptions& options, std::vector<std::string>& inputs) {
  if (options.recordings.empty()) return {};
  std::vector<learn::ClipLabels> clips;
  if (auto error = learn::read_labels(options.recordings, clips)) return error;
  inputs.push_back(options.recordings);
  for (const learn::ClipLabels& clip : clips) {
    inputs.push_back(clip.path.string());
    if (const auto picture = learn::empty_picture(clip)) inputs.push_back(picture->string());
  }
  return {};
}

void print_made(const DatasetOptions& options, const learn::Samples& samples, double spent_s) {
  struct {
    long hold = 0, slip = 0, empty = 0, open = 0, rejected = 0;
  } count;
  for (const learn::Row& row : samples.rows) {
    if (row.label == learn::Label::kOpen) {
      ++count.open;
    } else if (row.label == learn::Label::kEmpty) {
      ++count.empty;
    } else if (!row.accepted) {
      ++count.rejected;
    } else {
      ++(row.label == learn::Label::kSlip ? count.slip : count.hold);
    }
  }
  const auto trials = std::ranges::count_if(samples.trials, [](const learn::Trial& trial) { return trial.count > 0; });
  if (options.json) {
    nlohmann::json out;
    out["trials"] = trials;
    out["rows"] = samples.rows.size();
    out["hold"] = count.hold;
    out["slip"] = count.slip;
    out["empty"] = count.empty;
    out["open"] = count.open;
    out["rejected"] = count.rejected;
    out["cpu_s"] = spent_s;
    fmt::print("{}\n", text_of_json(out));
    return;
  }
  fmt::print("written   {}: {} trials, {} frames\n", options.out, trials, samples.rows.size());
  fmt::print("labels    {} hold, {} slip; not judged: {} empty, {} open, {} rejected by the firmware\n", count.hold,
             count.slip, count.empty, count.open, count.rejected);
  const std::string each = options.recordings.empty() && options.plan.repeats > 1
                               ? fmt::format(", {:.1f} s a seed", spent_s * options.plan.shards / options.plan.repeats)
                               : "";
  fmt::print("time      {:.1f} s of one core{}\n", spent_s, each);
}

int dataset(DatasetOptions options) {
  if (const std::string error = parse_shard(options.shard, options.plan.shard, options.plan.shards); !error.empty())
    return fail(error);
  std::vector<std::string> inputs;
  if (const auto error = inputs_of(options, inputs)) return fail(*error);
  OutputFiles out({{"--out", options.out}}, {inputs.begin(), inputs.end()}, "a label file, clip or picture");
  if (!out.error().empty()) return fail(out.error());
  const double start_s = cpu_s();
  learn::Samples samples;
  if (const auto error = options.recordings.empty() ? simulate(options, samples) : read_clips(options, samples)) {
    return fail(*error);
  }
  learn::write_csv(*out.stream("--out"), samples);
  if (const std::string error = out.commit(); !error.empty()) return fail(error);
  print_made(options, samples, cpu_s() - start_s);
  return 0;
}

}  // namespace

void add_dataset(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<DatasetOptions>();
  CLI::App* command = app.add_subcommand("dataset", "make samples to learn from: simulated grasps, or your recordings");
  command->add_option("--out", options->out, "the samples: CSV")->required()->check(not_empty);
  CLI::Option* recordings =
      command
          ->add_option("--recordings", options->recordings,
                       "label file beside its clips, instead of simulated grasps: CSV with the columns clip, "
                       "slip_start, slip_end, onset_recorded, silent_intervals, empty_intervals")
          ->check(not_empty);
  const auto only_simulated = [&](CLI::Option* option) {
    recordings->excludes(option);
    return option;
  };
  learn::PlanOptions& plan = options->plan;
  only_simulated(command->add_option("--seed", plan.seed, "of the first grasps"))->capture_default_str();
  only_simulated(command->add_option("--repeats", plan.repeats, "sets of grasps, each with the next seed"))
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  only_simulated(command->add_flag("--unseen", plan.unseen, "the three objects that training never sees"));
  only_simulated(command->add_option("--kinds", plan.kinds,
                                     fmt::format("of {}; all unless given; the paper has static,slip",
                                                 scene::file::names_of(scene::kGraspKinds))))
      ->delimiter(',');
  only_simulated(command->add_option("--objects", plan.objects, "some of them, as ball,box")->delimiter(','));
  only_simulated(command->add_option("--inject", options->inject, "where the grasp enters the firmware"))
      ->check(CLI::IsMember({"markers", "grey", "jpeg"}))
      ->capture_default_str();
  // Beyond 6 um the ten still frames that teach the rest position are not found still (0.75 px, 46 um).
  only_simulated(command->add_option("--marker-noise-um", options->marker_noise_um,
                                     "sigma of each marker's coordinate, up to 6 (1 to 2, by trial)"))
      ->check(number_from_to(0, 6));
  only_simulated(command->add_option("--shear-modulus-mpa", options->shear_modulus_mpa,
                                     "of the gel, under the motions of the unchanged one (0.045 to 0.11, by trial)"))
      ->check(number_from_to(0.01, 10));
  only_simulated(command->add_option("--shard", options->shard, "piece I of N of the set, for N runs side by side"))
      ->capture_default_str();
  command->add_flag("--json", options->json, "print the summary as JSON");
  command->footer(
      "The same options give the same bytes, on one core or in shards.\n"
      "Example:\n"
      "  holdfast dataset --seed 1 --repeats 5 --out train.csv\n"
      "  holdfast dataset --recordings clips/labels.csv --out clips.csv\n"
      "Side by side with GNU parallel, then merged into the bytes of the whole:\n"
      "  parallel holdfast dataset --repeats 5 --shard {}/8 --out part_{}.csv ::: {1..8}\n"
      "  awk 'FNR > 1 || NR == 1' part_{1..8}.csv > train.csv\n"
      "The same as a Slurm array:\n"
      "  sbatch --array=1-8 --wrap='holdfast dataset --repeats 5 --shard $SLURM_ARRAY_TASK_ID/8 "
      "--out part_$SLURM_ARRAY_TASK_ID.csv'");
  commands.push_back({command, [options] { return dataset(*options); }});
}

}  // namespace holdfast::tool
