// SPDX-License-Identifier: Apache-2.0
// holdfast evaluate: the paper's tables and what they leave out, on samples; or labelled recordings through the
// firmware. Every output at the end, or none.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <system_error>
#include <thread>
#include <tuple>

#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/evaluate_recorded.hpp"
#include "toolchain/learn/evaluate.hpp"
#include "toolchain/learn/evaluate_report.hpp"
#include "toolchain/learn/labels.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 4> kParts{"unseen", "events", "curve", "tsne"};

struct EvaluateOptions {
  std::vector<std::string> data;
  RecordedOptions recorded;
  bool pairs = false;
  std::vector<std::string> models;
  bool held_out = false;
  std::string out;
  std::string report;
  std::string json;
  int seeds = 5;
  std::vector<std::string> sets;
  std::vector<std::string> kinds;
  std::vector<std::string> without;
  bool quick = false;
  learn::Settings tree;
  std::string criterion = "information";
  std::string shard = "1/1";
  std::string piece;
  std::vector<std::string> pieces;

  [[nodiscard]] bool leaves_out(std::string_view part) const {
    return std::find(without.begin(), without.end(), part) != without.end();
  }
  [[nodiscard]] std::vector<std::string> inputs() const {
    std::vector<std::string> all = data;
    all.insert(all.end(), recorded.labels.begin(), recorded.labels.end());
    if (!recorded.empty.empty()) all.push_back(recorded.empty);
    all.insert(all.end(), models.begin(), models.end());
    all.insert(all.end(), pieces.begin(), pieces.end());
    return all;
  }
};

// What cannot end well, before the long run. Empty: nothing.
std::string refused(const EvaluateOptions& options) {
  const bool tables = !options.out.empty() || !options.report.empty() || !options.json.empty();
  if (options.piece.empty() && !tables && options.recorded.labels.empty()) {
    return "no output is asked for. Likely cause: --out forgotten. Next: give --out FOLDER, --report R.html or --json "
           "J.json";
  }
  if (options.piece.empty() != (options.shard == "1/1")) {
    return "--shard and --piece belong together. Likely cause: one of them forgotten. Next: give --shard I/N, N at "
           "least 2, and --piece FILE; then --pieces with all files";
  }
  if (!options.piece.empty() && (tables || !options.pieces.empty())) {
    return "--piece: a piece has no tables. Likely cause: --out, --report, --json or --pieces given to a piece. Next: "
           "give them to a run that has all --pieces";
  }
  for (const std::string& input : options.inputs()) {
    for (const std::string& output : {options.report, options.json, options.piece}) {
      if (output.empty() || !same_place(input, output)) continue;
      return fmt::format(
          "{}: an output would overwrite an input. Likely cause: the same name given twice. Next: give "
          "another name for the output",
          output);
    }
    if (!options.out.empty() && same_place(fs::absolute(input).parent_path(), options.out)) {
      return fmt::format(
          "{}: an input lies in the folder of the outputs, which may replace it. Likely cause: --out is the data's own "
          "folder. Next: give a folder of its own",
          input);
    }
  }
  if (!options.report.empty() && !options.json.empty() && same_place(options.report, options.json)) {
    return fmt::format(
        "{}: given for both --report and --json. Likely cause: a typing error. Next: give each output a file of its "
        "own",
        options.report);
  }
  return options.out.empty() ? "" : refuse_folder(options.out);
}

using Grasp = std::tuple<learn::Source, std::string, std::string, std::string, std::uint64_t>;

// Appends one file's trials. Empty, or an error line.
std::string load(const std::string& path, learn::Samples& all, std::map<Grasp, std::string>& seen) {
  std::ifstream in(path, std::ios::binary);
  std::error_code ignored;
  if (!in || fs::is_directory(path, ignored)) {
    return fmt::format(
        "{}: cannot be read. Likely cause: no such file, or no right to read it. Next: make samples with holdfast "
        "dataset",
        path);
  }
  learn::Samples some;
  if (auto error = learn::read_csv(in, path, some)) return *error;
  for (const learn::Trial& trial : some.trials) {
    const Grasp grasp{trial.source, trial.object, trial.primitive, trial.kind, trial.seed};
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

template <typename Item, typename Name>
std::string names_of(const std::vector<Item>& items, const Name& name) {
  std::string names;
  for (const Item& item : items) names += fmt::format("{}{}", names.empty() ? "" : ", ", name(item));
  return names;
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
      const std::vector<FeatureSet> all(kFeatureSets.begin(), kFeatureSets.end());
      return fmt::format("--sets '{}': no such set. Likely cause: a typing error. Next: give some of {}", name,
                         names_of(all, [](const FeatureSet& known) { return known.name; }));
    }
    options.sets.push_back(set);
  }
  using learn::Kind;
  const std::vector<Kind> all{Kind::kTree, Kind::kTreeCv, Kind::kForest, Kind::kSvm, Kind::kKnn};
  for (const std::string& name : asked.kinds) {
    const auto kind = learn::find_kind(name);
    if (!kind) {
      return fmt::format("--kinds '{}': no such classifier. Likely cause: a typing error. Next: give some of {}", name,
                         names_of(all, [](Kind known) { return learn::name_of(known); }));
    }
    options.kinds.push_back(*kind);
  }
  options.left_out_kinds = options.kinds;
  if (asked.kinds.empty()) {
    options.kinds = all;
    options.left_out_kinds = {Kind::kKnn, Kind::kTree};  // the paper's, and the one that is deployed
  }
  options.tree = asked.tree;
  options.tree.criterion = asked.criterion == "gini" ? learn::Criterion::kGini : learn::Criterion::kInformationGain;
  options.seeds = asked.seeds;
  options.unseen = !asked.leaves_out("unseen");
  options.events = !asked.leaves_out("events");
  if (asked.quick) {
    options.svm_rows = 2000;
    options.slip_weights = {0.1, 1.0};
    options.tsne_points = 600;
    options.tsne_iterations = 300;
  }
  if (asked.leaves_out("curve")) options.slip_weights.clear();
  if (asked.leaves_out("tsne")) options.tsne_points = 0;
  for (const std::string& path : asked.models) {
    treec::Model model;
    if (std::string error = read_model(path, model); !error.empty()) return error;
    options.models.push_back(
        {fmt::format("{} ({})", model.name, fs::path(path).filename().string()), treec::to_table(model)});
  }
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
  const auto as_is = [](const auto& name) { return name; };
  facts.facts = {
      {"data", fmt::format("{}: {}", facts.source, names_of(asked.data, as_is))},
      {"samples", rows(samples)},
      {"objects",
       names_of(objects, [](const std::string& name) { return learn::is_unseen(name) ? name + " (unseen)" : name; })},
      {"kinds of grasp", names_of(kinds, as_is)}};
  facts.facts.emplace_back("seeds", fmt::format("{}", options.seeds));
  const learn::Settings& tree = options.tree;
  facts.facts.emplace_back(
      "own tree",
      fmt::format("depth at most {}, leaves of at least {} rows, prune {:g}, slip_weight {:g}, criterion {}",
                  tree.max_depth, tree.min_leaf, tree.prune, tree.slip_weight, asked.criterion));
  facts.held_out = asked.held_out;
  if (asked.quick) {
    facts.warnings.push_back(
        fmt::format("A quick look: SVM learned from at most {} rows, curve and t-SNE are coarse. Not for a claim.",
                    options.svm_rows));
  }
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

// Writes what was asked for, and prints it. The exit status.
int put_out(const EvaluateOptions& asked, const learn::ReportFacts& facts, const std::vector<learn::Table>& tables,
            const std::vector<learn::Chart>& charts) {
  const std::string page = learn::html(facts, tables, charts);
  std::vector<std::pair<fs::path, std::string>> outputs;
  if (!asked.out.empty()) {
    const fs::path folder = asked.out;
    for (const learn::Table& table : tables) outputs.emplace_back(folder / (table.id + ".csv"), learn::csv(table));
    for (const learn::Chart& chart : charts) outputs.emplace_back(folder / (chart.id + ".svg"), chart.svg);
    outputs.emplace_back(folder / "report.html", page);
  }
  if (!asked.report.empty()) outputs.emplace_back(asked.report, page);
  if (!asked.json.empty()) outputs.emplace_back(asked.json, json_of(facts, tables));
  if (const std::string error = write_all(asked.out, outputs); !error.empty()) return fail(error);

  for (const auto& [name, value] : facts.facts) fmt::print("{:15} {}\n", name, value);
  for (const std::string& warning : facts.warnings) fmt::print("{:15} {}\n", "note", warning);
  for (const learn::Table& table : tables) {
    if (table.brief) fmt::print("\n{}", learn::text(table));
  }
  fmt::print("\n");
  if (!asked.out.empty()) fmt::print("written   tables, pictures and report.html: {}\n", asked.out);
  if (!asked.report.empty()) fmt::print("written   report: {}\n", asked.report);
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
  return put_out(asked, facts, tables, {});
}

int evaluate_samples(const EvaluateOptions& asked) {
  learn::Options options;
  if (const std::string error = settle(asked, options); !error.empty()) return fail(error);
  learn::Samples samples;
  std::map<Grasp, std::string> seen;
  for (const std::string& path : asked.data) {
    if (const std::string error = load(path, samples, seen); !error.empty()) return fail(error);
  }

  learn::Piece said;
  for (const std::string& path : asked.pieces) {
    std::ifstream in(path, std::ios::binary);
    std::error_code ignored;
    if (!in || fs::is_directory(path, ignored)) {
      return fail(fmt::format(
          "{}: cannot be read. Likely cause: no such file, or no right to read it. Next: give what holdfast evaluate "
          "--piece wrote",
          path));
    }
    if (const auto error = learn::read_piece(in, path, said)) return fail(*error);
  }
  if (!asked.pieces.empty()) options.pieces = &said;
  OutputFiles piece({{"--piece", asked.piece}});
  if (!asked.piece.empty()) {
    if (const std::string error = parse_shard(asked.shard, options.shard, options.shards); !error.empty())
      return fail(error);
    if (!piece.error().empty()) return fail(piece.error());
    options.piece = &said;
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
  if (std::ostream* const out = piece.stream("--piece")) {
    learn::write_piece(*out, said);
    if (const std::string error = piece.commit(); !error.empty()) return fail(error);
    fmt::print("written   what {} classifiers said: {}\n", said.said.size(), asked.piece);
    return 0;
  }

  const learn::ReportFacts facts = facts_of(asked, options, samples);
  const std::vector<learn::Table> tables = learn::tables_of(evaluation, facts);
  const std::vector<learn::Chart> charts = learn::charts_of(samples, evaluation, facts);
  return put_out(asked, facts, tables, charts);
}

int evaluate(const EvaluateOptions& asked) {
  if (asked.data.empty() == asked.recorded.labels.empty()) {
    return fail(
        "give either samples or --recorded with label files. Likely cause: neither or both are given. Next: holdfast "
        "evaluate --help shows how");
  }
  if (asked.pairs && asked.recorded.labels.empty()) {
    return fail(
        "--pairs: samples have no fingers. Likely cause: --recorded forgotten. Next: give --recorded with label "
        "files");
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
  command
      ->add_option("--recorded", recorded.labels,
                   "instead of samples: label files beside their clips, each of which is replayed; detection and false "
                   "alarms in labelled silence and by phase of the whole trial")
      ->check(not_empty);
  command
      ->add_option("--empty", recorded.empty,
                   "with --recorded: picture of the empty gel for clips that never show it; else empty_CAMERA.png "
                   "beside the labels, CAMERA being what follows the last __ of the clip's name")
      ->check(not_empty);
  command->add_flag(
      "--pairs", options->pairs,
      "with --recorded: clips whose names differ after the last __ alone are the left and the right finger "
      "of a hand; each alone, both fused, and the thresholds of the fused decision");
  command->add_option("--grid", recorded.grid, "with --recorded: as of replay")->capture_default_str();
  recorded.jobs = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  command->add_option("--jobs", recorded.jobs, "with --recorded: clips replayed at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      ->add_option("--model", options->models,
                   "models to judge as they are: texts, as slip_v2.tree; with --recorded the one that decides")
      ->check(not_empty);
  command->add_flag("--held-out", options->held_out, "the given models were not trained on these samples");
  command->add_option("--out", options->out, "folder for all tables (CSV), pictures (SVG) and the report")
      ->check(not_empty);
  command->add_option("--report", options->report, "the report alone: HTML")->check(not_empty);
  command->add_option("--json", options->json, "all tables: JSON")->check(not_empty);
  command->add_option("--seeds", options->seeds, "repetitions with other folds: intervals are over these")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command
      ->add_option("--sets", options->sets,
                   "sets of features, as entropy,paper; unless given, all that do not read the imprint")
      ->delimiter(',');
  command
      ->add_option("--kinds", options->kinds,
                   "classifiers, as tree,knn; all in Table I, knn and tree elsewhere unless given")
      ->delimiter(',');
  command->add_option("--without", options->without, "leave out some of unseen, events, curve, tsne")
      ->delimiter(',')
      ->check(CLI::IsMember(std::vector<std::string>(kParts.begin(), kParts.end())));
  command->add_flag("--quick", options->quick, "a coarse look: SVM on few rows, short curve, small t-SNE");
  command->add_option("--depth", options->tree.max_depth, "of our tree")
      ->check(CLI::Range(1, treec::kMaxDepth))
      ->capture_default_str();
  command->add_option("--min-leaf", options->tree.min_leaf, "rows of a leaf of our tree")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command->add_option("--prune", options->tree.prune, "share of the weight that a leaf of our tree must pay")
      ->check(number_from_to(0.0, 1.0))
      ->capture_default_str();
  command
      ->add_option("--slip-weight", options->tree.slip_weight,
                   "of a slip row of our tree; below 1: fewer false alarms, later detection")
      ->check(number_from_to(0.001, 1000.0))
      ->capture_default_str();
  command->add_option("--criterion", options->criterion, "what a split of our tree must lessen: information or gini")
      ->check(CLI::IsMember({"information", "gini"}))
      ->capture_default_str();
  command->add_option("--shard", options->shard,
                      "learn piece I of N of the classifiers alone, for N runs side by side");
  command->add_option("--piece", options->piece, "with --shard: what they say, for --pieces")->check(not_empty);
  command
      ->add_option("--pieces", options->pieces,
                   "all pieces of a run with the same data and options: nothing learns again")
      ->check(not_empty);
  command->footer("Columns of a label file, one clip a line; frames count from 0, intervals include both ends:\n" +
                  label_columns() +
                  "Examples:\n"
                  "  holdfast evaluate --recorded clips/labels.csv --out evaluation\n"
                  "  holdfast evaluate --recorded clips/labels.csv --pairs\n"
                  "  holdfast evaluate train.csv unseen.csv --out evaluation\n"
                  "A look in a minute:\n"
                  "  holdfast evaluate train.csv unseen.csv --seeds 1 --quick --report look.html\n"
                  "On all cores with GNU parallel, and then put together (the same as one run, but for the timing):\n"
                  "  parallel holdfast evaluate train.csv --shard {}/8 --piece part_{}.txt ::: {1..8}\n"
                  "  holdfast evaluate train.csv --pieces part_*.txt --out evaluation\n"
                  "On a cluster with Slurm:\n"
                  "  sbatch --array=1-8 --wrap='holdfast evaluate train.csv --shard $SLURM_ARRAY_TASK_ID/8 "
                  "--piece part_$SLURM_ARRAY_TASK_ID.txt'");
  commands.push_back({command, [options] { return evaluate(*options); }});
}

}  // namespace holdfast::tool
