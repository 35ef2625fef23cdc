// SPDX-License-Identifier: Apache-2.0
// The commands of the host tool, one function each: 0 = done, anything else = one line on stderr was printed.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/scene/scene.hpp"
#include "toolchain/session/session.hpp"
#include "toolchain/support/command.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::tool {

struct CommonOptions {
  OutputPaths paths;
  std::string grid = "9x7";
  std::string mode = "fast";
  std::string model;
  std::string feature_set;  // empty = whatever the tree reads
  bool json = false;
};

// A check for names of files: a shell variable that is not set must not quietly mean "none". Empty, or what is wrong.
[[nodiscard]] std::string not_empty(const std::string& text);

// A check for numbers, "nan" among those refused: CLI11's own range check lets it pass.
[[nodiscard]] std::function<std::string(const std::string&)> number_from_to(double least, double most);

// `I/N`: piece I of N, counted from 1. Empty, or an error line.
[[nodiscard]] std::string parse_shard(const std::string& text, int& shard, int& shards);

// Adds the options that replay and sim share.
void add_common_options(CLI::App& command, CommonOptions& options);

// Grid and mode to parameters; the model file to `tree` (false: the compiled one stays). Returns empty or an
// error line.
[[nodiscard]] std::string settle(const CommonOptions& options, Params& params, bool& auto_grid,
                                 std::unique_ptr<model::Tree>& tree, std::string& model_text);

// A model's text, read and checked. Returns empty or an error line.
[[nodiscard]] std::string read_model(const std::string& path, treec::Model& model);

struct ReplayOptions {
  CommonOptions common;
  std::string input;
  std::string reference = "first";
  double fps = 0;
};
[[nodiscard]] int replay(const ReplayOptions& options);

struct SimOptions {
  CommonOptions common;
  std::string scene;
  std::string inject;   // instead of the scene's; empty = the scene's
  std::string contact;  // likewise
};
[[nodiscard]] int sim_grasp(const SimOptions& options);

// A scene from a file; prints what is wrong with it.
[[nodiscard]] std::optional<scene::Scene> load_scene(const std::string& path);

struct SceneCheckOptions {
  std::vector<std::string> files;
  bool strict = false;  // an effect that changes nothing is an error
};
[[nodiscard]] int scene_check(const SceneCheckOptions& options);
[[nodiscard]] int scene_list(const std::string& folder);
[[nodiscard]] int scene_describe(const std::string& path);

struct SceneMakeOptions {
  std::string object;
  std::string primitive;
  std::string outcome;
  std::uint64_t seed = 1;
};
[[nodiscard]] int scene_make(const SceneMakeOptions& options);

struct TradeSimOptions {
  std::vector<std::string> scenes;
  std::string csv;
  std::string entries;
  std::string svg;
  double reference_cell_mm = 0.35;
  int repeats = 3;
};
[[nodiscard]] int trade_sim(const TradeSimOptions& options);

struct TradeFirmwareOptions {
  std::string csv;
  std::string svg;
  std::string modes;
  std::string shard = "1/1";
  int films = 6;
  int every = 10;
  int lessons = 4;
  std::string recordings;
};
[[nodiscard]] int trade_firmware(const TradeFirmwareOptions& options);

struct TradeShowOptions {
  std::vector<std::string> tables;
  std::string csv;
  std::string svg;
  std::string modes;
  std::string counts;
};
[[nodiscard]] int trade_show(const TradeShowOptions& options);
// Each setting that can be shown pictures, a line of words each.
[[nodiscard]] int trade_settings();

// Commands that bring their own options: each adds itself to `app` and what it does to `commands`.
void add_dataset(CLI::App& app, std::vector<Command>& commands);
void add_train(CLI::App& app, std::vector<Command>& commands);
void add_evaluate(CLI::App& app, std::vector<Command>& commands);
void add_compile(CLI::App& app, std::vector<Command>& commands);
void add_fuse(CLI::App& app, std::vector<Command>& commands);
void add_calibrate(CLI::App& app, std::vector<Command>& commands);
void add_study(CLI::App& app, std::vector<Command>& commands);
void add_trials(CLI::App& app, std::vector<Command>& commands);
void add_model(CLI::App& app, std::vector<Command>& commands);
void add_settings(CLI::App& app, std::vector<Command>& commands);
void add_grip(CLI::App& app, std::vector<Command>& commands);
void add_faults(CLI::App& app, std::vector<Command>& commands);
void add_log(CLI::App& app, std::vector<Command>& commands);
void add_page(CLI::App& app, std::vector<Command>& commands);

// Lines for people and for programs.
void print_summary(const Session& session, const Summary& summary, const CommonOptions& options);
// One line on stderr, whatever is in it: control characters of file names become '?'. fail() returns the exit status.
[[nodiscard]] int fail(const std::string& line);
void note(const std::string& line);

// After heed_interrupts() Ctrl-C ends a run between two frames, so that no temporary file stays behind; the second one
// ends the program at once.
void heed_interrupts();
[[nodiscard]] bool interrupted();
[[nodiscard]] std::string interrupted_line();

}  // namespace holdfast::tool
