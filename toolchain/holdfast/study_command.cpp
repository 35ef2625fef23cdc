// SPDX-License-Identifier: Apache-2.0
// holdfast study: which entropy is best, and what the deployed tree stands; every output at the end, or none.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "app/app.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/calibrate.hpp"
#include "toolchain/learn/study.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

struct StudyOptions {
  std::string out;
  std::string model;
  learn::PlanOptions plan;
  int every = 5;
  bool json = false;
};

struct Study {
  std::string model_text;
  std::size_t grasps = 0;
  std::size_t thinned = 0;
  std::vector<learn::EntropyScore> entropies;
  std::vector<learn::Condition> conditions = learn::conditions();
  std::vector<learn::ConditionScore> stands;
};

// Scoring one form costs about as much as playing so many grasps of the same plan, by share.
constexpr double kFormInGrasps = 0.005;

std::string load_tree(const std::string& path, std::unique_ptr<model::Tree>& tree, std::string& model_text) {
  CommonOptions common;
  common.model = path;
  Params params;
  bool auto_grid = false;
  if (std::string error = settle(common, params, auto_grid, tree, model_text); !error.empty()) return error;
  if (tree != nullptr) return {};
  treec::Model compiled;
  (void)treec::parse(learn::compiled_model_text(), compiled);
  tree = std::make_unique<model::Tree>(treec::to_table(compiled));
  return {};
}

std::optional<std::string> work(const StudyOptions& options, const learn::Plan& plan, const model::Tree& tree,
                                Study& study) {
  const std::vector<learn::PlannedGrasp> some = learn::thinned(plan, options.every);
  study.grasps = plan.grasps.size();
  study.thinned = some.size();
  const auto whole = static_cast<long>(plan.grasps.size());
  const auto a_form = std::max(1L, std::lround(kFormInGrasps * static_cast<double>(whole)));
  Progress progress("study",
                    whole + learn::kEntropyForms * a_form + static_cast<long>(study.conditions.size() * some.size()));
  long done = 0;

  learn::EntropyRows rows;
  for (const learn::PlannedGrasp& grasp : plan.grasps) {
    learn::play_entropies(rows, grasp.make(), Params{});
    progress.update(++done);
    if (interrupted()) return interrupted_line();
  }
  const auto scored = [&](int forms) {
    progress.update(done + forms * a_form);
    return !interrupted();
  };
  auto error = learn::score_entropies(rows, options.plan.seed, scored, study.entropies);
  if (interrupted()) return interrupted_line();
  if (error) return error;
  done += learn::kEntropyForms * a_form;

  const decision::Config decision = pipeline_config(Params{}).decision;
  for (const learn::Condition& condition : study.conditions) {
    learn::ConditionScore& score = study.stands.emplace_back();
    for (const learn::PlannedGrasp& grasp : some) {
      learn::Samples samples;
      learn::play_into(samples, grasp.make(), Params{}, condition.variation);
      learn::judge(samples, tree, decision, score);
      progress.update(++done);
      if (interrupted()) return interrupted_line();
    }
  }
  return {};
}

std::string note_of(const StudyOptions& options, const Study& study, const learn::Table& entropies,
                    const learn::Table& stands) {
  return fmt::format(
      "{}\n{}\n{}\n"
      "{}, on every {}. of {} grasps from seed {} on ({}). As planned: 25 fps, marker noise 1 to 2 um and modulus "
      "0.045 to\n0.11 MPa by trial, no marker lost. Before: the alarm was up already when the slip began.\n",
      learn::text(entropies), learn::entropy_note(study.entropies), learn::text(stands), study.model_text,
      options.every, study.grasps, options.plan.seed, study.thinned);
}

nlohmann::ordered_json json_of(const learn::Table& table) {
  auto rows = nlohmann::ordered_json::array();
  for (const auto& cells : table.rows) {
    nlohmann::ordered_json row;
    for (std::size_t c = 0; c < cells.size(); ++c) {
      nlohmann::ordered_json& at = row[table.columns[c].id];
      if (cells[c].number) {
        at = *cells[c].number;
      } else if (!cells[c].text.empty()) {
        at = cells[c].text;
      }
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

int study_grasps(const StudyOptions& options) {
  if (const std::string error = refuse_folder(options.out); !error.empty()) return fail(error);
  std::unique_ptr<model::Tree> tree;
  Study study;
  if (const std::string error = load_tree(options.model, tree, study.model_text); !error.empty()) return fail(error);
  learn::Plan plan;
  if (const auto error = learn::make_plan(options.plan, plan)) return fail(*error);
  if (options.plan.objects.size() == 1) {
    return fail(fmt::format(
        "--objects {}: one object alone cannot be left out of the others. Likely cause: too few named. Next: give two "
        "or more",
        options.plan.objects.front()));
  }
  if (const auto error = work(options, plan, *tree, study)) return fail(*error);

  const learn::Table entropies = learn::entropy_table(study.entropies);
  const learn::Table stands = learn::condition_table(study.conditions, study.stands);
  const std::string note = note_of(options, study, entropies, stands);
  const fs::path folder = options.out;
  const std::vector<std::pair<fs::path, std::string>> outputs{
      {folder / "entropy.csv", learn::csv(entropies)},
      {folder / "entropy.svg", learn::entropy_chart(study.entropies)},
      {folder / "conditions.csv", learn::csv(stands)},
      {folder / "study.txt", note}};
  if (const std::string error = write_all(options.out, outputs); !error.empty()) return fail(error);
  if (options.json) {
    const nlohmann::ordered_json out = {{"model", study.model_text},
                                        {"grasps", study.grasps},
                                        {"entropy", json_of(entropies)},
                                        {"conditions", json_of(stands)}};
    // Names of files need not be UTF-8.
    fmt::print("{}\n", out.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    return 0;
  }
  fmt::print("{}", note);
  for (const auto& [path, bytes] : outputs) fmt::print("written   {}\n", path.string());
  return 0;
}

}  // namespace

void add_study(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<StudyOptions>();
  options->plan.seed = 901;
  CLI::App* command = app.add_subcommand("study", "how far results lean on the entropy's bins and on circumstances");
  command->add_option("--out", options->out, "folder for entropy.csv and .svg, conditions.csv, study.txt")
      ->required()
      ->check(not_empty);
  command->add_option("--seed", options->plan.seed, "of the first grasps; one that the model was not trained on")
      ->capture_default_str();
  command->add_option("--repeats", options->plan.repeats, "sets of grasps, each with the next seed")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  command->add_option("--objects", options->plan.objects, "two or more of the ten, as ball,box")->delimiter(',');
  command->add_option("--every", options->every, "the tree is tried on every so many-th grasp")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  command->add_option("--model", options->model, "model text or binary to try instead of the compiled tree")
      ->check(not_empty);
  command->add_flag("--json", options->json, "print the figures as JSON");
  command->footer("Example:\n  holdfast study --out study --model slip_v2.tree");
  commands.push_back({command, [options] { return study_grasps(*options); }});
}

}  // namespace holdfast::tool
