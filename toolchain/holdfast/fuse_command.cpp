// SPDX-License-Identifier: Apache-2.0
// holdfast fuse: the imprint's threshold, read off recordings, above a tree of the markers: a model of both.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "drivers/common/input_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/fuse.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

struct FuseOptions {
  std::vector<std::string> recordings;
  std::string markers;
  std::string model;
  bool json = false;
};

std::string line_of(const learn::Fused& fused) {
  const std::string above = fmt::format("above {:.0f} um", std::exp2(fused.threshold / 256.0));
  if (!fused.unseen) return above + ": how it does on another object is not known, because there is only one";
  const learn::RecordedScore& score = *fused.unseen;
  const learn::ShareInterval share = learn::share_interval(score.within_10.fresh, score.onsets);
  return fmt::format(
      "{}: {} of {} onsets within 10 frames ({:.0f} to {:.0f} %), {} within 5, {} within 15; {} "
      "alarms in {:.0f} s held, {} in {:.0f} s of it shaken, {} in {:.0f} s empty",
      above, score.within_10.fresh, score.onsets, share.low * 100.0, share.high * 100.0, score.within_5.fresh,
      score.within_15.fresh, score.held.alarms, score.held.s, score.shaken.alarms, score.shaken.s, score.empty.alarms,
      score.empty.s);
}

nlohmann::json json_of(const learn::Fused& fused) {
  nlohmann::json out;
  out["threshold_log2_um_q8"] = fused.threshold;
  out["silence_min"] = fused.silence_min;
  out["known_threshold"] = fused.known;
  if (!fused.unseen) return out;
  const learn::RecordedScore& score = *fused.unseen;
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
  std::vector<fs::path> inputs(options.recordings.begin(), options.recordings.end());
  inputs.emplace_back(options.markers);
  OutputFiles files({{"--model", options.model}}, inputs);
  if (!files.error().empty()) return fail(files.error());
  treec::Model markers;
  if (const std::string error = read_model(options.markers, markers); !error.empty()) return fail(error);
  learn::Samples samples;
  for (const std::string& path : options.recordings) {
    constexpr std::string_view kMake = "make samples with holdfast dataset --recordings";
    std::ifstream in;
    if (const std::string wrong = drivers::open_file(path, kMake, in); !wrong.empty()) return fail(wrong);
    learn::Samples some;
    if (const auto error = learn::read_csv(in, path, some)) return fail(*error);
    learn::append(samples, std::move(some));
  }
  learn::Fused fused;
  const std::string name = fs::path(options.model).stem().string();
  if (const auto error = learn::fuse(samples, markers, name, fused)) {
    return fail(fmt::format("{}: {}", fmt::join(options.recordings, ", "), *error));
  }

  const std::string line = line_of(fused);
  const std::string comment = fmt::format(
      "Slip model, written by `holdfast fuse`: the imprint's motion against the gel, over the noise of the same two\n"
      "pictures; and the tree {} (CRC-32 of its text {:08X}) where no relief is pressed in and the markers flow.\n\n"
      "The imprint alone, each object by a threshold that was read off the others ({} recordings):\n  {}",
      markers.name, markers.text_crc32, samples.trials.size(), line);
  const std::string text = treec::to_text(fused.model, comment);
  treec::Model again;
  auto problem = treec::parse(text, again);
  if (!problem) problem = treec::check(again);
  if (problem) return fail(treec::describe(*problem, options.model));
  *files.stream("--model") << text;
  if (const std::string error = files.commit(); !error.empty()) return fail(error);

  if (options.json) {
    nlohmann::json out;
    out["model"] = options.model;
    out["nodes"] = fused.model.nodes.size();
    out["imprint"] = json_of(fused);
    fmt::print("{}\n", text_of_json(out));
    return 0;
  }
  fmt::print("recorded  one object left out, the imprint alone\n");
  fmt::print("          {}\n", line);
  if (fused.known) {
    fmt::print(
        "note      the threshold is the one of slip_v6: {:.1f} minutes of labelled silence do not show that a "
        "lower one raises no false alarms. Next: label {:.0f} minutes or more\n",
        fused.silence_min, learn::kLeastSilence_min);
  }
  fmt::print("written   {}: {} nodes, at most {} predicates a frame\n", options.model, fused.model.nodes.size(),
             treec::depth(fused.model));
  return 0;
}

}  // namespace

void add_fuse(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<FuseOptions>();
  CLI::App* const command =
      app.add_subcommand("fuse", "put the imprint's threshold above a tree of the markers: a model of both");
  command
      ->add_option("RECORDINGS", options->recordings,
                   "samples of recordings to read the threshold off: CSV, one file or more")
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
      "  holdfast fuse clips.csv --markers slip_v2.tree --model slip_v6.tree");
  commands.push_back({command, [options] { return fuse(*options); }});
}

}  // namespace holdfast::tool
