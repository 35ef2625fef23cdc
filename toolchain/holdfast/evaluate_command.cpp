// SPDX-License-Identifier: Apache-2.0
// holdfast evaluate: the paper's tables and what they leave out, on samples; or labelled recordings through the
// firmware. Every output at the end, or none.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <thread>
#include <tuple>

#include "drivers/common/input_file.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/evaluate_recorded.hpp"
#include "toolchain/learn/evaluate.hpp"
#include "toolchain/learn/evaluate_report.hpp"
#include "toolchain/learn/labels.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/printable.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

using scene::file::joined;
using scene::file::names_of;

namespace fs = std::filesystem;

struct EvaluateOptions {
  std::vector<std::string> data;
  RecordedOptions recorded;
  bool pairs = false;
  std::vector<std::string> models;
  std::string out;
  std::string json;
  int seeds = 5;
  std::vector<std::string> sets;
  bool without_unseen = false;
  learn::Settings tree;

  [[nodiscard]] std::vector<std::string> inputs() const {
    std::vector<std::string> all = data;
    all.insert(all.end(), recorded.labels.begin(), recorded.labels.end());
    if (!recorded.empty.empty()) all.push_back(recorded.empty);
    all.insert(all.end(), models.begin(), models.end());
    return all;
  }
};

// What cannot end well, before the long run. Empty: nothing.
std::string refused(const EvaluateOptions& options) {
  if (options.out.empty() && options.json.empty() && options.recorded.labels.empty()) {
    return "no output is asked for. Likely cause: --out forgotten. Next: give --out FOLDER or --json J.json";
  }
  const std::vector<std::string> inputs = options.inputs();
  for (const std::string& input : inputs) {
    if (!options.out.empty() && same_place(fs::absolute(input).parent_path(), options.out)) {
      return fmt::format(
          "{}: an input lies in the folder of the outputs, which may replace it. Likely cause: --out is the data's own "
          "folder. Next: give a folder of its own",
          input);
    }
  }
  if (const OutputFiles early({{"--json", options.json}}, {inputs.begin(), inputs.end()}); !early.error().empty()) {
    return early.error();
  }
  return options.out.empty() ? "" : refuse_folder(options.out);
}

using GraspKey = std::tuple<learn::Source, std::string, std::string, std::string, std::uint64_t>;

// Appends one file's trials. Empty, or an error line.
std::string load(const std::string& path, learn::Samples& all, std::map<GraspKey, std::string>& seen) {
  constexpr std::string_view kMake = "make samples with holdfast dataset";
  std::ifstream in;
  if (std::string wrong = drivers::open_file(path, kMake, in); !wrong.empty()) return wrong;
  learn::Samples some;
  if (auto error = learn::read_csv(in, path, some)) return *error;
  for (const learn::Trial& trial : some.trials) {
    const GraspKey grasp{trial.source, trial.object, trial.primitive, trial.kind, trial.seed};
    const auto [at, fresh] = seen.try_emplace(grasp, path);
    if (!fresh && at->second != path) {
      return fmt::format(
          "{}: the grasp {} {} {} of seed {} is in {} too, so it would be learned from and judged. Likely cause: the "
          "same file twice, or files made from the same seeds. Next: give each grasp once",
          path, trial.object, trial.primitive, trial.kind, trial.seed, at->second);
    }
  }
  learn::append(all, std::move(some));
  return {};
}

// The options of the work from those of the command line. Empty, or an error line.
std::string settle(const EvaluateOptions& asked, learn::Options& options) {
  // The paper's way to look at grasps: by the markers alone, each feature for itself. The others on request.
  for (const FeatureSet& set : kFeatureSets) {
    if (asked.sets.empty() && !reads(set, Stage::kImprint)) options.sets.push_back(&set);
  }
  for (const std::string& name : asked.sets) {
    const FeatureSet* set = find_feature_set(name);
    if (set == nullptr) {
      return fmt::format("--sets '{}': no such set. Likely cause: a typing error. Next: give some of {}", name,
                         names_of(kFeatureSets));
    }
    options.sets.push_back(set);
  }
  options.tree = asked.tree;
  options.seeds = asked.seeds;
  options.unseen = !asked.without_unseen;
  return {};
}

learn::ReportFacts facts_of(const EvaluateOptions& asked, const learn::Options& options,
                            const learn::Samples& samples) {
  learn::ReportFacts facts;
  std::set<std::string_view> sources;
  std::vector<std::string> objects;
  std::vector<std::string> kinds;
  for (const learn::Trial& trial : samples.trials) {
    sources.insert(learn::name_of(trial.source));
    const auto add = [](std::vector<std::string>& names, const std::string& name) {
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    };
    add(objects, trial.object);
    add(kinds, trial.kind);
  }
  for (const std::string_view source : sources)
    facts.source += fmt::format("{}{}", facts.source.empty() ? "" : " and ", source);
  const auto rows = [](const learn::Samples& of) {
    const auto count = [&](learn::Label label) {
      return std::count_if(of.rows.begin(), of.rows.end(),
                           [&](const learn::Row& row) { return learn::judged(row) && row.label == label; });
    };
    const long hold = count(learn::Label::kHold);
    const long slip = count(learn::Label::kSlip);
    return fmt::format("{} trials, {} frames judged: {} hold, {} slip; {} more not judged", of.trials.size(),
                       hold + slip, hold, slip, static_cast<long>(of.rows.size()) - hold - slip);
  };
  facts.facts = {
      {"data", fmt::format("{}: {}", facts.source, joined(asked.data))},
      {"samples", rows(samples)},
      {"objects", joined(objects, ", ",
                         [](const std::string& name) { return learn::is_unseen(name) ? name + " (unseen)" : name; })},
      {"kinds of grasp", joined(kinds)}};
  facts.facts.emplace_back("seeds", fmt::format("{}", options.seeds));
  const learn::Settings& tree = options.tree;
  facts.facts.emplace_back("own tree",
                           fmt::format("depth at most {}, leaves of at least {} rows, prune {:g}, slip_weight {:g}",
                                       tree.max_depth, tree.min_leaf, tree.prune, tree.slip_weight));
  if (options.seeds == 1) facts.warnings.emplace_back("One seed: no intervals over seeds.");
  return facts;
}

std::string json_of(const learn::ReportFacts& facts, const std::vector<learn::Table>& tables) {
  nlohmann::ordered_json out;
  out["source"] = facts.source;
  for (const auto& [name, value] : facts.facts) out["facts"][name] = value;
  out["warnings"] = facts.warnings;
  for (const learn::Table& table : tables) {
    nlohmann::ordered_json& rows = out["tables"][table.id] = nlohmann::ordered_json::array();
    for (const auto& cells : table.rows) {
      nlohmann::ordered_json row;
      for (std::size_t c = 0; c < cells.size(); ++c) {
        const learn::Cell& cell = cells[c];
        nlohmann::ordered_json& at = row[table.columns[c].id];
        if (cell.number) {
          at = *cell.number;
        } else if (!cell.text.empty()) {
          at = cell.text;
        }
        if (cell.half > 0.0) row[table.columns[c].id + "_ci95"] = cell.half;
      }
      rows.push_back(std::move(row));
    }
  }
  // Names of files need not be UTF-8.
  return out.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + '\n';
}

// All that was asked for, or nothing. Empty, or an error line.
std::string write(const EvaluateOptions& asked, const learn::ReportFacts& facts,
                  const std::vector<learn::Table>& tables) {
  std::error_code failed;
  const bool made = !asked.out.empty() && fs::create_directory(asked.out, failed);
  if (failed) return asked.out + ": cannot be made: " + failed.message() + ". Next: check the folder above it";
  std::vector<OutputFiles::Asked> places{{"--json", asked.json}};
  for (const learn::Table& table : tables) {
    if (!asked.out.empty()) places.push_back({table.id, fs::path(asked.out) / (table.id + ".csv")});
  }
  std::string problem;
  {
    OutputFiles files(places);
    if (std::ostream* const json = files.stream("--json")) *json << json_of(facts, tables);
    for (const learn::Table& table : tables) {
      if (std::ostream* const csv = files.stream(table.id)) *csv << learn::csv(table);
    }
    problem = files.commit();
  }
  if (!problem.empty() && made) fs::remove(asked.out, failed);  // stays unless empty
  return problem;
}

// Writes what was asked for, and prints it. The exit status.
int put_out(const EvaluateOptions& asked, const learn::ReportFacts& facts, const std::vector<learn::Table>& tables) {
  if (const std::string error = write(asked, facts, tables); !error.empty()) return fail(error);
  for (const auto& [name, value] : facts.facts) fmt::print("{:15} {}\n", name, printable(value));
  for (const std::string& warning : facts.warnings) fmt::print("{:15} {}\n", "note", printable(warning));
  for (const learn::Table& table : tables) {
    if (table.brief) fmt::print("\n{}", learn::text(table));
  }
  fmt::print("\n");
  if (!asked.out.empty()) fmt::print("written   tables: {}\n", asked.out);
  if (!asked.json.empty()) fmt::print("written   JSON: {}\n", asked.json);
  return 0;
}

int evaluate_clips(const EvaluateOptions& asked) {
  if (asked.models.size() > 1) {
    return fail(
        "--model: more than one. Likely cause: recordings are replayed with one model. Next: run it once for each "
        "model");
  }
  RecordedOptions options = asked.recorded;
  if (!asked.models.empty()) options.model = asked.models.front();
  learn::ReportFacts facts;
  std::vector<learn::Table> tables;
  {
    Progress progress("evaluate", 1000);
    const auto judge = asked.pairs ? evaluate_pairs : evaluate_recorded;
    const std::string error =
        judge(options, facts, tables, [&](long done, long all) { progress.update(1000 * done / std::max(all, 1L)); });
    if (!error.empty()) return fail(error);
  }
  return put_out(asked, facts, tables);
}

int evaluate_samples(const EvaluateOptions& asked) {
  learn::Options options;
  if (const std::string error = settle(asked, options); !error.empty()) return fail(error);
  learn::Samples samples;
  std::map<GraspKey, std::string> seen;
  for (const std::string& path : asked.data) {
    if (const std::string error = load(path, samples, seen); !error.empty()) return fail(error);
  }

  learn::Evaluation evaluation;
  {
    Progress progress("evaluate", 1000);
    options.progress = [&](long done, long all) {
      progress.update(1000 * done / std::max(all, 1L));
      return !interrupted();
    };
    const auto error = learn::evaluate(samples, options, evaluation);
    if (interrupted()) return fail(interrupted_line());
    if (error) return fail(*error);
  }
  const learn::ReportFacts facts = facts_of(asked, options, samples);
  return put_out(asked, facts, learn::tables_of(evaluation, facts));
}

int evaluate(const EvaluateOptions& asked) {
  if (asked.data.empty() == asked.recorded.labels.empty()) {
    return fail(
        "give either samples or --recorded with label files. Likely cause: neither or both are given. Next: holdfast "
        "evaluate --help shows how");
  }
  if (const std::string error = refused(asked); !error.empty()) return fail(error);
  return asked.data.empty() ? evaluate_clips(asked) : evaluate_samples(asked);
}

// The columns of a label file, for --help.
std::string label_columns() {
  std::string lines;
  for (const learn::LabelColumn& column : learn::kLabelColumns) {
    lines += fmt::format("  {:17} {}{}\n", column.name, column.help, column.required ? "" : " (optional)");
  }
  return lines;
}

}  // namespace

void add_evaluate(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<EvaluateOptions>();
  CLI::App* command =
      app.add_subcommand("evaluate", "the paper's tables on your samples, or the firmware on labelled recordings");
  command->add_option("DATA", options->data, "samples of holdfast dataset: CSV files")->check(not_empty);
  RecordedOptions& recorded = options->recorded;
  CLI::Option* const clips =
      command
          ->add_option("--recorded", recorded.labels,
                       "instead of samples: label files beside their clips, each of which is replayed; detection and "
                       "false alarms in labelled silence and by phase of the whole trial")
          ->check(not_empty);
  command
      ->add_option("--empty", recorded.empty,
                   "with --recorded: picture of the empty gel for clips that never show it; else empty_CAMERA.png "
                   "beside the labels, CAMERA being what follows the last __ of the clip's name")
      ->check(not_empty)
      ->needs(clips);
  command
      ->add_flag("--pairs", options->pairs,
                 "with --recorded: clips whose names differ after the last __ alone are the left and the right finger "
                 "of a hand; each alone, both fused, and the thresholds of the fused decision")
      ->needs(clips);
  command->add_option("--grid", recorded.grid, "with --recorded: as of replay")->capture_default_str()->needs(clips);
  recorded.jobs = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  command->add_option("--jobs", recorded.jobs, "with --recorded: clips replayed at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str()
      ->needs(clips);
  command->add_option("--model", options->models, "with --recorded: the model that decides, as slip_v6.tree")
      ->check(not_empty)
      ->needs(clips);
  command->add_option("--out", options->out, "folder for all tables: CSV")->check(not_empty);
  command->add_option("--json", options->json, "all tables: JSON")->check(not_empty);
  command->add_option("--seeds", options->seeds, "repetitions with other folds: intervals are over these")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str()
      ->excludes(clips);
  command
      ->add_option("--sets", options->sets,
                   "sets of features, as entropy,paper; unless given, all that do not read the imprint")
      ->delimiter(',')
      ->excludes(clips);
  command->add_flag("--without-unseen", options->without_unseen, "leave Table III out: the data has no unseen objects")
      ->excludes(clips);
  command->add_option("--depth", options->tree.max_depth, "of our tree")
      ->check(CLI::Range(1, treec::kMaxDepth))
      ->capture_default_str()
      ->excludes(clips);
  command->add_option("--min-leaf", options->tree.min_leaf, "rows of a leaf of our tree")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str()
      ->excludes(clips);
  command->add_option("--prune", options->tree.prune, "share of the weight that a leaf of our tree must pay")
      ->check(number_from_to(0.0, 1.0))
      ->capture_default_str()
      ->excludes(clips);
  command
      ->add_option("--slip-weight", options->tree.slip_weight,
                   "of a slip row of our tree; below 1: fewer false alarms, later detection")
      ->check(number_from_to(0.001, 1000.0))
      ->capture_default_str()
      ->excludes(clips);
  command->footer("Columns of a label file, one clip a line; frames count from 0, intervals include both ends:\n" +
                  label_columns() +
                  "Examples:\n"
                  "  holdfast evaluate --recorded clips/labels.csv --out evaluation\n"
                  "  holdfast evaluate --recorded clips/labels.csv --pairs\n"
                  "  holdfast evaluate train.csv unseen.csv --out evaluation\n"
                  "  holdfast evaluate train.csv --without-unseen --seeds 1 --json look.json");
  commands.push_back({command, [options] { return evaluate(*options); }});
}

}  // namespace holdfast::tool
