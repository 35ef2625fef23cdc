// SPDX-License-Identifier: Apache-2.0
// holdfast fuse: the imprint's thresholds, read off recordings, above a tree of the markers: a model with operating
// points.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "toolchain/holdfast/atomic_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/fuse.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

struct FuseOptions {
  std::string recordings;
  std::string markers;
  std::string model;
  bool json = false;
};

std::string line_of(Sensitivity sensitivity, const learn::Point& point) {
  const learn::RecordedScore& score = point.unseen;
  const learn::ShareInterval share = learn::share_interval(score.within_10.fresh, score.onsets);
  return fmt::format(
      "{:<10} above {:.0f} um: {} of {} onsets within 10 frames ({:.0f} to {:.0f} %), {} within 5, {} within 15; {} "
      "alarms in {:.0f} s held, {} in {:.0f} s of it shaken, {} in {:.0f} s empty",
      kSensitivityNames[static_cast<std::size_t>(sensitivity)], std::exp2(point.threshold / 256.0),
      score.within_10.fresh, score.onsets, share.low * 100.0, share.high * 100.0, score.within_5.fresh,
      score.within_15.fresh, score.held.alarms, score.held.s, score.shaken.alarms, score.shaken.s, score.empty.alarms,
      score.empty.s);
}

nlohmann::json json_of(const learn::Point& point) {
  const learn::RecordedScore& score = point.unseen;
  nlohmann::json out;
  out["threshold_log2_um_q8"] = point.threshold;
  out["onsets"] = score.onsets;
  out["within_5"] = score.within_5.fresh;
  out["within_10"] = score.within_10.fresh;
  out["within_15"] = score.within_15.fresh;
  out["hits"] = score.hits;
  out["held_alarms"] = score.held.alarms;
  out["held_s"] = score.held.s;
  out["shaken_alarms"] = score.shaken.alarms;
  out["shaken_s"] = score.shaken.s;
  out["empty_alarms"] = score.empty.alarms;
  out["empty_s"] = score.empty.s;
  return out;
}

int fuse(const FuseOptions& options) {
  for (const std::string& input : {options.recordings, options.markers}) {
    if (!same_place(input, options.model)) continue;
    return fail(fmt::format(
        "{}: the model would overwrite an input. Likely cause: the same name given twice. Next: give another name for "
        "the model",
        options.model));
  }
  treec::Model markers;
  if (const std::string error = read_model(options.markers, markers); !error.empty()) return fail(error);
  std::ifstream in(options.recordings, std::ios::binary);
  std::error_code ignored;
  if (!in || fs::is_directory(options.recordings, ignored)) {
    return fail(fmt::format(
        "{}: cannot be read. Likely cause: no such file, or no right to read it. Next: make samples with holdfast "
        "dataset --recordings",
        options.recordings));
  }
  learn::Samples samples;
  if (const auto error = learn::read_csv(in, options.recordings, samples)) return fail(*error);
  learn::Fused fused;
  const std::string name = fs::path(options.model).stem().string();
  if (const auto error = learn::fuse(samples, markers, name, fused)) {
    return fail(fmt::format("{}: {}", options.recordings, *error));
  }

  std::vector<std::string> lines;
  for (std::size_t i = 0; i < fused.points.size(); ++i) {
    lines.push_back(line_of(static_cast<Sensitivity>(i), fused.points[i]));
  }
  const std::string comment = fmt::format(
      "Slip model of two judges, written by `holdfast fuse`: the imprint's motion over 0.12 s against the gel where "
      "the\n"
      "object shows relief, and the tree {} (CRC-32 of its text {:08X}) where it shows none.\n\n"
      "Operating points: the imprint alone, each object by thresholds that were read off the others ({}):\n  {}",
      markers.name, markers.text_crc32, fs::path(options.recordings).filename().string(), fmt::join(lines, "\n  "));
  const std::string text = treec::to_text(fused.model, comment);
  treec::Model again;
  auto problem = treec::parse(text, again);
  if (!problem) problem = treec::check(again);
  if (problem) return fail(treec::describe(*problem, options.model));
  AtomicFile file(options.model);
  if (!file.error().empty()) return fail(file.error());
  file.stream() << text;
  if (const std::string error = file.commit(); !error.empty()) return fail(error);

  if (options.json) {
    nlohmann::json out;
    out["model"] = options.model;
    out["nodes"] = fused.model.nodes.size();
    for (std::size_t i = 0; i < fused.points.size(); ++i) {
      out["points"][std::string(kSensitivityNames[i])] = json_of(fused.points[i]);
    }
    fmt::print("{}\n", out.dump());
    return 0;
  }
  fmt::print("recorded  one object left out, the imprint alone\n");
  for (const std::string& line : lines) fmt::print("{}\n", line);
  fmt::print("written   {}: {} nodes, at most {} predicates a frame\n", options.model, fused.model.nodes.size(),
             treec::depth(fused.model));
  return 0;
}

}  // namespace

void add_fuse(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<FuseOptions>();
  CLI::App* const command =
      app.add_subcommand("fuse", "put the imprint's thresholds above a tree of the markers: a model of both");
  command->add_option("RECORDINGS", options->recordings, "samples of recordings to read the thresholds off: CSV")
      ->required()
      ->check(not_empty);
  command->add_option("--markers", options->markers, "tree for objects without relief: a model text of the set field")
      ->required()
      ->check(not_empty);
  command->add_option("--model", options->model, "the model: a text, named as the model with .tree behind it")
      ->required()
      ->check(not_empty);
  command->add_flag("--json", options->json, "print the summary as JSON");
  command->footer(
      "Example:\n"
      "  holdfast dataset --recordings clips/labels.csv --out clips.csv\n"
      "  holdfast fuse clips.csv --markers slip_v2.tree --model slip_v3.tree");
  commands.push_back({command, [options] { return fuse(*options); }});
}

}  // namespace holdfast::tool
