// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/run.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/math.hpp"
#include "drivers/common/input_file.hpp"
#include "drivers/common/trouble.hpp"
#include "params/modes.hpp"
#include "slip/model_file.hpp"
#include "store/sealed.hpp"
#include "toolchain/learn/calibrate.hpp"
#include "toolchain/log/messages.hpp"
#include "toolchain/sealed/record_file.hpp"
#include "toolchain/sealed/settings_toml.hpp"
#include "toolchain/support/cli.hpp"
#include "toolchain/support/json_text.hpp"

namespace holdfast::tool {
namespace {

std::string known_modes() {
  std::string names;
  for (const Mode& mode : kModes) names += fmt::format("{}{}", names.empty() ? "" : ", ", mode.name);
  return names;
}

std::string known_feature_sets() {
  std::string names;
  for (const FeatureSet& set : kFeatureSets) names += fmt::format("{}{}", names.empty() ? "" : ", ", set.name);
  return names;
}

std::string parse_grid(const std::string& text, Params& params, bool& auto_grid) {
  auto_grid = text == "auto";
  if (auto_grid) return {};
  const char* const end = text.data() + text.size();
  const auto [x, cols_error] = std::from_chars(text.data(), end, params.grid_cols);
  if (cols_error == std::errc{} && x != end && *x == 'x') {
    const auto [rest, rows_error] = std::from_chars(x + 1, end, params.grid_rows);
    if (rows_error == std::errc{} && rest == end && validate(params).ok()) return {};
  }
  return fmt::format(
      "--grid '{}': not a grid this firmware knows. Likely cause: not written as COLSxROWS, or outside 3 to 16 columns "
      "and rows, or more than {} markers. Next: give the printed grid, for instance 9x7, or auto",
      text, kMaxMarkers);
}

// Models are small: what is larger than any of them, or has no end, is not read.
constexpr std::size_t kMostModelBytes = 1 << 20;

std::string read_model_file(const std::string& path, std::string& bytes) {
  constexpr std::string_view kGive = "give a model text or what holdfast compile --binary wrote";
  if (std::string wrong = drivers::read_file(path, "model", kGive, bytes, kMostModelBytes); !wrong.empty())
    return wrong;
  if (bytes.empty()) return trouble(path + ": has 0 bytes", "a copy that broke off, or a full disk", "copy it again");
  if (bytes.starts_with(
          std::string_view(reinterpret_cast<const char*>(sealed::kMagic.data()), sealed::kMagic.size()))) {
    return trouble(path + ": is a sealed record", "what holdfast model seal wrote was given in place of what it read",
                   "give the model text, or what holdfast compile --binary wrote, before it was sealed");
  }
  return {};
}

std::string parse_model(const std::string& path, std::string_view text, treec::Model& model) {
  auto problem = treec::parse(text, model);
  if (!problem) problem = treec::check(model);
  return problem ? treec::describe(*problem, path) : "";
}

// The first bytes of that form, which stay even when a copy changed the line ends behind them.
bool is_compiled(std::string_view bytes) {
  return bytes.starts_with("\x89HFT");
}

std::string load_model(const std::string& path, model::Tree& tree) {
  std::string bytes;
  if (std::string error = read_model_file(path, bytes); !error.empty()) return error;
  if (!is_compiled(bytes)) {
    treec::Model parsed;
    if (std::string error = parse_model(path, bytes, parsed); !error.empty()) return error;
    tree = treec::to_table(parsed);
    return {};
  }
  const auto refusal = model_file::read({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, tree);
  if (refusal == model_file::Refusal::kNone) return {};
  const model_file::RefusalInfo& why = info(refusal);
  return fmt::format("{}: {}. Likely cause: {}. Next: {}", path, why.what, why.cause, why.next);
}

}  // namespace

std::string read_model(const std::string& path, treec::Model& model) {
  std::string text;
  if (std::string error = read_model_file(path, text); !error.empty()) return error;
  if (!is_compiled(text)) return parse_model(path, text, model);
  return fmt::format(
      "{}: is a compiled model. Likely cause: what holdfast compile wrote was given in place of what it read. Next: "
      "give the model text",
      path);
}

void add_common_options(CLI::App& command, CommonOptions& options) {
  command.add_option("--grid", options.grid, "printed grid as COLSxROWS, or auto: take the lattice found")
      ->capture_default_str();
  command.add_option("--mode", options.mode, fmt::format("speed setting for JPEG pictures: {}", known_modes()))
      ->capture_default_str();
  command
      .add_option("--model", options.model,
                  "model, text or compiled, to decide with instead of the tree that is compiled in")
      ->check(not_empty);
  command
      .add_option("--settings", options.settings,
                  "a device's settings, TOML as for `settings compile`: scales of the forces and all but grid and mode")
      ->check(not_empty);
  command
      .add_option("--feature-set", options.feature_set,
                  fmt::format("make sure that the model reads this set (paper without --model: a tree of the paper's "
                              "four features): {}",
                              known_feature_sets()))
      ->check(not_empty);
  command
      .add_option("--features", options.paths.features,
                  "write one row per frame: CSV; - is standard output, and the summary goes to standard error")
      ->check(not_empty);
  command.add_option("--markers", options.paths.markers, "write one row per marker and frame: CSV")->check(not_empty);
  command
      .add_option("--overlay", options.paths.overlay,
                  "write the frame of the first slip (else of the largest entropy) with its arrows, three times "
                  "their length: PNG")
      ->check(not_empty);
  command.add_option("--report", options.paths.report, "write a report that any browser shows: HTML")->check(not_empty);
  command
      .add_option("--log", options.paths.log,
                  "write one row per frame in numbers only, for PlotJuggler and other programs: CSV. state: 0 BOOT, 1 "
                  "REFERENCE, 2 OK, 3 SLIP, 4 DEGRADED, 5 FAULT; reason: the number in firmware/app/STATES.md")
      ->check(not_empty);
  command
      .add_option("--mcap", options.paths.mcap,
                  "write decisions, markers and the camera's JPEG pictures, untouched, for Foxglove, PlotJuggler and "
                  "Rerun: MCAP")
      ->check(not_empty);
  command.add_flag("--json", options.json, "print the summary as JSON");
}

std::string settle(const CommonOptions& options, Params& params, bool& auto_grid, std::unique_ptr<model::Tree>& tree,
                   std::string& model_text) {
  if (!options.settings.empty()) {
    std::string text;
    if (std::string error = drivers::read_file(options.settings, "settings", "give a TOML file", text);
        !error.empty()) {
      return error;
    }
    if (std::string error = settings_of_toml(text, options.settings, params); !error.empty()) return error;
    params.left_sensor = params.right_sensor = 0;  // a recording does not say of which sensor it is
  }
  if (std::string error = parse_grid(options.grid, params, auto_grid); !error.empty()) return error;
  if (!parse("mode", options.mode, params).ok() || !find_mode(options.mode)) {
    return fmt::format("--mode '{}': no such mode. Likely cause: a typing error. Next: give one of {}", options.mode,
                       known_modes());
  }
  if (!options.feature_set.empty() && find_feature_set(options.feature_set) == nullptr) {
    return fmt::format("--feature-set '{}': no such set. Likely cause: a typing error. Next: give one of {}",
                       options.feature_set, known_feature_sets());
  }
  std::string_view reads = slip_tree::kFeatureSet;
  model_text = fmt::format("{} (compiled in)", slip_tree::kName);
  if (!options.model.empty()) {
    tree = std::make_unique<model::Tree>();
    if (std::string error = load_model(options.model, *tree); !error.empty()) return error;
    reads = tree->set->name;
    model_text = fmt::format("{} ({})", model::name_of(*tree), options.model);
  }
  if (options.model.empty() && options.feature_set == "paper") {
    treec::Model paper;
    if (std::string error = parse_model("slip_v1", learn::paper_model_text(), paper); !error.empty()) return error;
    tree = std::make_unique<model::Tree>(treec::to_table(paper));
    model_text = fmt::format("{} (the paper's features)", paper.name);
    return {};
  }
  if (options.feature_set.empty() || options.feature_set == reads) return {};
  return fmt::format(
      "--feature-set '{}': the model {} reads the set {}. Likely cause: {}. Next: give a model of the set {} with "
      "--model, or leave --feature-set out",
      options.feature_set, model_text, reads,
      options.model.empty() ? "the tree that is compiled in has one set only" : "the model of another experiment",
      options.feature_set);
}

void print_summary(const Session& session, const Summary& summary, const CommonOptions& options) {
  std::FILE* const out = options.paths.people();
  if (const log::FrameLog* log = session.frame_log(); log != nullptr && !log->has_pictures()) {
    note(fmt::format("{}: without {}, because no frame came as a picture", options.paths.mcap.string(),
                     log::kCameraTopic));
  } else if (log != nullptr && log->has_encoded()) {
    note(fmt::format(
        "{}: the pictures of {} are encoded for this file, grey and at the firmware's working size, because "
        "the input is not JPEG",
        options.paths.mcap.string(), log::kCameraTopic));
  }
  const std::optional<EmptyGel>& gel = session.empty_gel();
  const grid::Cut& cut = session.app().state().tracker.cut;
  const GridSize grid = session.app().state().tracker.field.grid;
  std::vector<std::string> notes = session.notes();
  const reference::State& reference = session.app().state().reference;
  const std::int32_t most_bend = reference::Config{}.most_bend_permille;
  if (const std::int32_t bend = reference::bend_permille(reference.rest); reference.known && bend > most_bend) {
    notes.push_back(
        fmt::format("the rest position is bent by {} thousandths of a pitch ({} at most on an empty gel): something "
                    "pressed on the gel. Next: give a picture of the empty gel with --reference",
                    bend, most_bend));
  }
  const auto most = std::ranges::max_element(summary.others, {}, [](const auto& one) { return one.second; });
  const std::string mostly = most == summary.others.end()
                                 ? ""
                                 : fmt::format("{} ({})", info(most->first.first).name, info(most->first.second).name);
  if (options.json) {
    nlohmann::json all;
    all["frames"] = summary.frames;
    all["grid"] = grid_text(grid);
    all["cut"] = {{"top", cut.top}, {"bottom", cut.bottom}, {"left", cut.left}, {"right", cut.right}};
    if (gel) {
      all["reference"] = {{"frame", gel->frame},
                          {"first", gel->first},
                          {"last", gel->last},
                          {"at_rest", gel->at_rest},
                          {"clear", gel->clear}};
    }
    all["accepted"] = summary.accepted;
    all["markers_mean"] = summary.mean_markers;
    all["markers_least"] = summary.least_markers;
    all["searches"] = summary.searches;
    all["saturations"] = summary.saturations;
    all["grip_ok_frames"] = summary.grip_ok;
    all["not_ok_mostly"] = mostly;
    all["slip_frames"] = summary.slip_frames;
    all["slip_times_s"] = summary.slip_times_s;
    all["lost_frames"] = summary.lost_frames;
    all["notes"] = notes;
    fmt::print(out, "{}\n", text_of_json(all));
    return;
  }
  const long rejected = summary.frames - summary.accepted;
  fmt::print(out, "frames    {} read, {} accepted{}\n", summary.frames, summary.accepted,
             rejected > 0
                 ? fmt::format(", {} rejected; the last because {}", rejected, info(summary.last_rejection).what)
                 : "");
  fmt::print(out, "markers   {:.2f} of {} ({}) on average, {} at least\n", summary.mean_markers, grid.count(),
             grid_text(grid), summary.least_markers);
  fmt::print(out, "grip ok   in {} frames{}\n", summary.grip_ok,
             mostly.empty() ? "" : "; in the others mostly " + mostly);
  if (gel) fmt::print(out, "rest      {}\n", session.reference_text());
  if (cut.lines() > 0) {
    fmt::print(out, "grid      {} kept; left out, because the picture's edge cuts it: {}\n", grid_text(grid),
               cut_text(cut));
  }
  for (const std::string& text : notes) fmt::print(out, "note      {}\n", text);
  if (summary.slip_frames.empty()) {
    fmt::print(out, "slip      never raised\n");
  } else {
    fmt::print(out, "slip      raised {} times, first in frame {} at {:.3f} s\n", summary.slip_frames.size(),
               summary.slip_frames.front(), summary.slip_times_s.front());
  }
  if (!summary.lost_frames.empty()) {
    fmt::print(out, "contact   lost {} times, first in frame {}: SLIP (contact_lost), GRIP_OK LOW\n",
               summary.lost_frames.size(), summary.lost_frames.front());
  }
  if (summary.saturations > 0)
    fmt::print(out, "note      {} times a displacement or feature was beyond its number format and clamped\n",
               summary.saturations);
  for (const auto& [name, path] : options.paths.named()) {
    if (!path->empty() && *path != "-") fmt::print(out, "written   {}: {}\n", name.substr(2), path->string());
  }
}

}  // namespace holdfast::tool
