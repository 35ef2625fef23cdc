// SPDX-License-Identifier: Apache-2.0
// The commands of the host tool, one function each: 0 = done, anything else = one line on stderr was printed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/scene/scene.hpp"
#include "toolchain/session/replay.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::tool {

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
  double reference_cell_mm = 0.35;
  int repeats = 3;
};
[[nodiscard]] int trade_sim(const TradeSimOptions& options);

struct TradeFirmwareOptions {
  std::string csv;
  std::string modes;
  std::string shard = "1/1";
  int films = 6;
  std::vector<std::string> recordings;
};
[[nodiscard]] int trade_firmware(const TradeFirmwareOptions& options);

struct TradeShowOptions {
  std::vector<std::string> tables;
  std::string csv;
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
void add_trials(CLI::App& app, std::vector<Command>& commands);
void add_model(CLI::App& app, std::vector<Command>& commands);
void add_settings(CLI::App& app, std::vector<Command>& commands);
void add_grip(CLI::App& app, std::vector<Command>& commands);
void add_faults(CLI::App& app, std::vector<Command>& commands);
void add_log(CLI::App& app, std::vector<Command>& commands);
void add_live(CLI::App& app, std::vector<Command>& commands);
void add_record(CLI::App& app, std::vector<Command>& commands);
void add_page(CLI::App& app, std::vector<Command>& commands);
void add_console(CLI::App& app, std::vector<Command>& commands);

}  // namespace holdfast::tool
