// SPDX-License-Identifier: Apache-2.0
// holdfast train: samples to a tree, judged by trials that it has not seen; the tree becomes a model text.
//
// Everything that is reported comes from folds of whole trials. A model is fitted to all rows afterwards, so what it
// does on them says nothing; its text carries the folds' figures.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/crc32.hpp"
#include "base/math.hpp"
#include "drivers/common/input_file.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "slip/decision.hpp"
#include "slip/model.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/evaluate.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/learn/splits.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/support/progress.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::tool {
namespace {

using learn::Interval;
using learn::Settings;

struct TrainOptions {
  std::vector<std::string> files;
  std::string set;
  std::string model;
  std::string name;
  Settings settings;
  int folds = 5;
  bool json = false;
};

// Empty, or one line.
using Error = std::string;

// --- what is learned from ---

struct DataFile {
  std::string name;  // without its folders
  int trials = 0;
  long rows = 0;
  long judged = 0;
  long slip = 0;
  std::uint32_t crc = 0;
};

struct Data {
  std::vector<DataFile> files;
  learn::Samples samples;
  std::vector<int> trials;  // those with judged rows

  [[nodiscard]] std::string names() const {
    return files.size() == 1 ? files[0].name : fmt::format("{} and {} more", files[0].name, files.size() - 1);
  }
};

Error read(const std::vector<std::string>& paths, Data& data) {
  for (const std::string& path : paths) {
    std::ifstream in;
    if (std::string wrong = drivers::open_file(path, "make samples with holdfast dataset", in); !wrong.empty()) {
      return wrong;
    }
    const std::string bytes(std::istreambuf_iterator<char>(in), {});
    std::istringstream text(bytes);
    learn::Samples samples;
    if (auto error = learn::read_csv(text, path, samples)) return *error;

    DataFile file;
    file.name = std::filesystem::path(path).filename().string();
    file.trials = static_cast<int>(samples.trials.size());
    file.rows = static_cast<long>(samples.rows.size());
    for (const learn::Row& row : samples.rows) {
      if (!learn::judged(row)) continue;
      ++file.judged;
      file.slip += row.label == learn::Label::kSlip ? 1 : 0;
    }
    file.crc = crc32({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    for (const DataFile& other : data.files) {
      if (other.crc != file.crc || other.rows != file.rows) continue;
      return fmt::format(
          "{}: holds the same bytes as {}. Likely cause: one file given twice; its trials would be learned and tested "
          "at once. Next: leave one out",
          path, other.name);
    }
    data.files.push_back(std::move(file));
    learn::append(data.samples, std::move(samples));
  }
  for (int trial = 0; trial < static_cast<int>(data.samples.trials.size()); ++trial) {
    const std::span<const learn::Row> rows = data.samples.of(data.samples.trials[idx(trial)]);
    if (std::any_of(rows.begin(), rows.end(), learn::judged)) data.trials.push_back(trial);
  }
  return {};
}

// --- folds ---

// Every row of one trial that the firmware accepted: what a decision stage would see.
struct TestTrial {
  int trial = 0;
  learn::Matrix rows;
};

struct Fold {
  learn::Matrix train;
  learn::Matrix test;
  std::vector<TestTrial> trials;
};

TestTrial test_trial(const learn::Samples& samples, const FeatureSet& set, int trial) {
  TestTrial out{trial, {}};
  out.rows.set = &set;
  const learn::Trial& t = samples.trials[idx(trial)];
  for (int i = t.first; i < t.first + t.count; ++i) {
    const learn::Row& row = samples.rows[idx(i)];
    if (!row.accepted) continue;
    for (const std::uint8_t member : set.members) out.rows.x.push_back(row.x[member]);
    out.rows.slip.push_back(row.label == learn::Label::kSlip ? 1 : 0);
    out.rows.row.push_back(i);
  }
  return out;
}

// What is missing in these rows to learn or to judge. Empty: nothing.
std::string_view missing(const learn::Matrix& rows) {
  const auto slips = std::count(rows.slip.begin(), rows.slip.end(), 1);
  if (rows.height() == 0) return "no rows";
  if (slips == 0) return "no slip rows";
  return slips == rows.height() ? "no hold rows" : "";
}

Error make_folds(const Data& data, const FeatureSet& set, int folds, const Settings& settings, std::vector<Fold>& out) {
  const learn::Matrix all = learn::matrix_of(data.samples, set, data.trials);
  if (const std::string_view lack = missing(all); !lack.empty()) {
    return fmt::format(
        "{}: {} to learn from. Likely cause: one class only, or every frame open or rejected. Next: add trials of the "
        "other class",
        data.names(), lack);
  }
  for (const learn::Split& split : learn::by_trial(data.samples, data.trials, folds, settings.seed)) {
    Fold fold;
    fold.train = learn::matrix_of(data.samples, set, split.train, settings.recorded_weight, true);
    fold.test = learn::matrix_of(data.samples, set, split.test);
    for (const auto& [rows, use] :
         {std::pair{&fold.test, "to be judged by"}, std::pair{&fold.train, "to learn from"}}) {
      const std::string_view lack = missing(*rows);
      if (lack.empty()) continue;
      return fmt::format(
          "{}: {} of {} has {} {}. Likely cause: {} trials are too few for that many folds, or too few of them slip. "
          "Next: give fewer --folds, or more trials",
          data.names(), split.name, folds, lack, use, data.trials.size());
    }
    for (const int trial : split.test) fold.trials.push_back(test_trial(data.samples, set, trial));
    out.push_back(std::move(fold));
  }
  return {};
}

// --- figures ---

struct Figures {
  std::vector<learn::Confusion> folds;
  learn::EventGroup events;  // of all trials

  [[nodiscard]] Interval interval(double (learn::Confusion::*figure)() const) const {
    std::vector<double> values;
    values.reserve(folds.size());
    for (const learn::Confusion& fold : folds) values.push_back((fold.*figure)());
    return learn::interval_of(values);
  }
};

struct NamedFigure {
  std::string_view key;
  std::string_view name;
  double (learn::Confusion::*figure)() const;
};
constexpr std::array<NamedFigure, 5> kFrameFigures{{
    {"accuracy", "accuracy", &learn::Confusion::accuracy},
    {"balanced_accuracy", "balanced accuracy", &learn::Confusion::balanced_accuracy},
    {"precision", "precision", &learn::Confusion::precision},
    {"recall", "recall", &learn::Confusion::recall},
    {"f1", "F1", &learn::Confusion::f1},
}};

std::string percent(const Interval& interval) {
  return fmt::format("{:.2f} +- {:.2f} %", interval.mean * 100.0, interval.half * 100.0);
}

Error judge(const learn::Samples& samples, const Fold& fold, const Settings& settings, Figures& figures) {
  const std::unique_ptr<learn::Learner> learner = learn::make_learner(settings);
  if (const auto error = learner->fit(fold.train)) {
    return fmt::format("nothing can be learned: {}. Likely cause: too few rows. Next: add trials", *error);
  }
  learn::Confusion confusion;
  const auto predict = [&](const learn::Matrix& rows) {
    std::vector<std::uint8_t> said = learner->predict(rows);
    for (std::size_t i = 0; i < said.size(); ++i) {
      if (!learn::may_slip(*rows.set, samples.rows[idx(rows.row[i])])) said[i] = 0;
    }
    return said;
  };
  const std::vector<std::uint8_t> said = predict(fold.test);
  for (std::size_t i = 0; i < said.size(); ++i) confusion.add(fold.test.slip[i] != 0, said[i] != 0);
  figures.folds.push_back(confusion);
  for (const TestTrial& test : fold.trials) {
    const learn::Trial& trial = samples.trials[idx(test.trial)];
    const std::vector<std::uint8_t> accepted = predict(test.rows);
    std::vector<std::uint8_t> verdicts(idx(trial.count));
    for (std::size_t i = 0; i < accepted.size(); ++i) verdicts[idx(test.rows.row[i] - trial.first)] = accepted[i];
    figures.events.add(learn::event_of(samples, test.trial, verdicts, decision::Config{}));
  }
  return {};
}

constexpr std::array kWithin{2, 5, 10};  // frames

// Of all trials together. The median is the lower middle of an even number.
std::vector<std::string> event_lines(const learn::EventGroup& group) {
  const auto detected = [&](int within) { return std::lround(group.within(within) * group.onsets); };
  const std::optional<double> median_ms = learn::quantile(group.ms, 0.5);
  return {
      fmt::format("{} onsets: {} detected within 2 frames, {} within 5, {} within 10; median delay {} s", group.onsets,
                  detected(2), detected(5), detected(10), median_ms ? fmt::format("{:.3f}", *median_ms / 1e3) : "-"),
      fmt::format("{} missed; in {} the alarm was up already, which counts as neither", group.missed, group.before),
      fmt::format("{} false alarms in {:.1f} s of held contact: {} per hour", group.false_alarms, group.held_s,
                  group.held_s > 0.0 ? fmt::format("{:.1f}", group.alarms_per_hour()) : "-")};
}

// --- settings ---

std::string text_of(const Settings& s) {
  std::string text = fmt::format("tree: depth {}, min_leaf {}, prune {:g}, classes balanced, slip_weight {:g}",
                                 s.max_depth, s.min_leaf, s.prune, s.slip_weight);
  if (s.recorded_weight != 1.0) text += fmt::format(", recorded_weight {:g}", s.recorded_weight);
  return text;
}

// --- the run ---

Error cross_validate(const Data& data, const std::vector<Fold>& folds, const Settings& settings, Figures& figures) {
  Progress progress("train", static_cast<long>(folds.size()));
  long done = 0;
  for (const Fold& fold : folds) {
    if (Error error = judge(data.samples, fold, settings, figures); !error.empty()) return error;
    progress.update(++done);
    if (interrupted()) return interrupted_line();
  }
  return {};
}

std::string comment_of(const Data& data, const FeatureSet& set, const TrainOptions& options, const Figures& figures) {
  std::string out = "Slip decision tree, written by `holdfast train`.\n\nLearned from:\n";
  for (const DataFile& file : data.files) {
    out += fmt::format("  {}: {} rows of {} trials, {} of them judged, {} slip; CRC-32 {:08X}\n", file.name, file.rows,
                       file.trials, file.judged, file.slip, file.crc);
  }
  out += fmt::format("Feature set {}; {}; seed {}.\n", set.name, text_of(options.settings), options.settings.seed);
  out += fmt::format(
      "\nBy trees of these settings on trials that they have not seen ({} folds by trial; 95 % over the folds):\n",
      options.folds);
  for (const NamedFigure& figure : kFrameFigures) {
    out += fmt::format("  {:18} {}\n", figure.name, percent(figures.interval(figure.figure)));
  }
  const decision::Config decision;
  out += fmt::format("Raised after {} slips in a row, held for {} ms:\n", decision.raise_frames,
                     decision.hold.count() / 1000);
  for (const std::string& line : event_lines(figures.events)) out += "  " + line + "\n";
  return out;
}

// Fits to all rows and checks that the model text decides as the classifier does.
Error make_model(const Data& data, const FeatureSet& set, const TrainOptions& options, const Figures& figures,
                 treec::Model& model, std::string& text) {
  const learn::Matrix all = learn::matrix_of(data.samples, set, data.trials, options.settings.recorded_weight, true);
  const std::unique_ptr<learn::Learner> learner = learn::make_learner(options.settings);
  const std::optional<std::string> error = learner->fit(all);
  std::optional<treec::Model> tree = error ? std::nullopt : learner->tree();
  if (!tree) {
    return fmt::format(
        "{}: no model was written: {}. Likely cause: the features tell too little about slip, or the settings allow "
        "too few leaves. Next: give a smaller --min-leaf or --prune, another --set or more trials",
        options.model, error.value_or("the tree says the same of every row"));
  }
  tree->name = options.name;
  text = treec::to_text(*tree, comment_of(data, set, options, figures));
  auto problem = treec::parse(text, model);
  if (!problem) problem = treec::check(model);
  if (problem) {
    return fmt::format(
        "{}: no model was written: {}. Likely cause: more leaves than the firmware has room for. Next: give a smaller "
        "--depth, or a larger --min-leaf or --prune",
        options.model, problem->what);
  }
  const model::Tree table = treec::to_table(model);
  const std::vector<std::uint8_t> said = learner->predict(all);
  long differ = 0;
  for (int i = 0; i < all.height(); ++i) {
    const bool slip = model::evaluate(table, all.at(i)) != Verdict::kHold;
    differ += slip != (said[idx(i)] != 0) ? 1 : 0;
  }
  if (differ == 0) return {};
  return fmt::format(
      "{}: no model was written: it decides {} of {} rows unlike the classifier. Likely cause: a fault of the tool. "
      "Next: report it with the data",
      options.model, differ, all.height());
}

void print(const Data& data, const FeatureSet& set, const TrainOptions& options, const Figures& figures) {
  for (const DataFile& file : data.files) {
    fmt::print("data      {}: {} rows of {} trials, {} judged, {} slip; CRC-32 {:08X}\n", file.name, file.rows,
               file.trials, file.judged, file.slip, file.crc);
  }
  fmt::print("set       {}: {} features\n", set.name, set.size());
  fmt::print("settings  {}; seed {}\n", text_of(options.settings), options.settings.seed);
  fmt::print("frames    {} folds by trial, 95 % over the folds\n", options.folds);
  for (const NamedFigure& figure : kFrameFigures) {
    fmt::print("          {:18} {}\n", figure.name, percent(figures.interval(figure.figure)));
  }
  std::string_view head = "events";
  for (const std::string& line : event_lines(figures.events)) {
    fmt::print("{:10}{}\n", head, line);
    head = "";
  }
}

nlohmann::json json_of(const Settings& s) {
  return {{"kind", "tree"},
          {"seed", s.seed},
          {"slip_weight", s.slip_weight},
          {"recorded_weight", s.recorded_weight},
          {"depth", s.max_depth},
          {"min_leaf", s.min_leaf},
          {"prune", s.prune}};
}

nlohmann::json json_of(const Interval& interval) {
  return {{"mean", interval.mean}, {"half", interval.half}};
}

void print_json(const Data& data, const FeatureSet& set, const TrainOptions& options, const Figures& figures,
                const treec::Model& model) {
  nlohmann::json out;
  for (const DataFile& file : data.files) {
    out["data"].push_back({{"file", file.name},
                           {"rows", file.rows},
                           {"trials", file.trials},
                           {"judged", file.judged},
                           {"slip", file.slip},
                           {"crc32", fmt::format("{:08X}", file.crc)}});
  }
  out["set"] = set.name;
  out["settings"] = json_of(options.settings);
  out["folds"] = options.folds;
  for (const NamedFigure& figure : kFrameFigures) {
    out[std::string(figure.key)] = json_of(figures.interval(figure.figure));
  }
  const learn::EventGroup& events = figures.events;
  out["onsets"] = events.onsets;
  out["raised_before_onset"] = events.before;
  out["missed"] = events.missed;
  for (const int frames : kWithin) {
    out[fmt::format("within_{}", frames)] = std::lround(events.within(frames) * events.onsets);
  }
  const std::optional<double> median_ms = learn::quantile(events.ms, 0.5);
  out["median_delay_s"] = median_ms ? nlohmann::json(*median_ms / 1e3) : nlohmann::json();
  out["false_alarms"] = events.false_alarms;
  out["held_s"] = events.held_s;
  out["false_alarms_per_hour"] = events.held_s > 0.0 ? nlohmann::json(events.alarms_per_hour()) : nlohmann::json();
  if (!options.model.empty()) {
    out["model"] = {{"path", options.model},
                    {"name", model.name},
                    {"nodes", model.nodes.size()},
                    {"depth", treec::depth(model)},
                    {"crc32", fmt::format("{:08X}", model.text_crc32)}};
  }
  fmt::print("{}\n", text_of_json(out));
}

// The model's name, before any work. Empty, or an error line.
Error settle_name(TrainOptions& options) {
  if (options.model.empty()) return {};
  if (options.name.empty()) options.name = std::filesystem::path(options.model).stem().string();
  treec::Model named;  // as far as the parser comes: the name
  (void)treec::parse(fmt::format("format 1\nname {}\n", options.name), named);
  if (named.name == options.name) return {};
  return fmt::format(
      "'{}': not a model name. Likely cause: it is taken from --model unless --name is given. Next: give --name with "
      "at most 32 of a-z, 0-9 and _, a letter first",
      options.name);
}

int train(TrainOptions options) {
  const FeatureSet* const set = find_feature_set(options.set);
  if (set == nullptr) {
    return fail(fmt::format("--set '{}': no such set. Likely cause: a typing error. Next: give one of {}", options.set,
                            scene::file::names_of(kFeatureSets)));
  }
  if (const Error error = settle_name(options); !error.empty()) return fail(error);
  Data data;
  if (const Error error = read(options.files, data); !error.empty()) return fail(error);
  OutputFiles files({{"--model", options.model}}, {options.files.begin(), options.files.end()}, "the data");
  if (!files.error().empty()) return fail(files.error());
  std::ostream* const out = files.stream("--model");
  std::vector<Fold> folds;
  if (const Error error = make_folds(data, *set, options.folds, options.settings, folds); !error.empty()) {
    return fail(error);
  }
  Figures figures;
  if (const Error error = cross_validate(data, folds, options.settings, figures); !error.empty()) return fail(error);
  treec::Model model;
  if (out != nullptr) {
    std::string text;
    if (const Error error = make_model(data, *set, options, figures, model, text); !error.empty()) return fail(error);
    *out << text;
    if (const Error error = files.commit(); !error.empty()) return fail(error);
  }
  if (options.json) {
    print_json(data, *set, options, figures, model);
    return 0;
  }
  print(data, *set, options, figures);
  if (out != nullptr) {
    fmt::print("written   {}: {}, {} nodes, depth {}, CRC-32 {:08X}\n", options.model, model.name, model.nodes.size(),
               treec::depth(model), model.text_crc32);
  }
  return 0;
}

}  // namespace

void add_train(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<TrainOptions>();
  Settings& settings = options->settings;
  CLI::App* command = app.add_subcommand("train", "train the decision tree of slip, a model");
  command->add_option("DATA", options->files, "samples that holdfast dataset wrote: CSV")->required()->check(not_empty);
  command
      ->add_option("--set", options->set,
                   fmt::format("features to learn from: {}", scene::file::names_of(kFeatureSets)))
      ->required();
  CLI::Option* model = command->add_option("--model", options->model, "write the tree: model text")->check(not_empty);
  command->add_option("--name", options->name, "of the model (the file's, without its ending)")
      ->check(not_empty)
      ->needs(model);
  command->add_option("--depth", settings.max_depth, "predicates on the longest path")
      ->check(CLI::Range(1, treec::kMaxDepth))
      ->capture_default_str();
  command->add_option("--min-leaf", settings.min_leaf, "rows of the smallest leaf")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command->add_option("--prune", settings.prune, "least share of errors, 0 to 1, that a further leaf must save")
      ->check(number_from_to(0.0, 1.0))
      ->capture_default_str();
  command
      ->add_option("--recorded-weight", settings.recorded_weight,
                   "of a recorded row beside a simulated one, of which there are many more")
      ->check(number_from_to(0.001, 1000.0))
      ->capture_default_str();
  command
      ->add_option("--slip-weight", settings.slip_weight,
                   "of a slip row beside a hold row; below 1: fewer false alarms, later detection")
      ->check(number_from_to(0.001, 1000.0))
      ->capture_default_str();
  command->add_option("--seed", settings.seed, "of the folds")->capture_default_str();
  command->add_option("--folds", options->folds, "parts of whole trials, each judged by those who learned the others")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  command->add_flag("--json", options->json, "print the summary as JSON");
  command->footer(
      "Example:\n  holdfast dataset --out grasps.csv\n"
      "  holdfast train grasps.csv --set paper --depth 5 --model slip_v2.tree");
  commands.push_back({command, [options] { return train(*options); }});
}

}  // namespace holdfast::tool
