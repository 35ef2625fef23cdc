// SPDX-License-Identifier: Apache-2.0
// The commands of the host tool. What each does returns 0 = done, anything else = one line on stderr was printed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/scene/scene.hpp"
#include "toolchain/session/replay.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::tool {

// A scene from a file; prints what is wrong with it.
[[nodiscard]] std::optional<scene::Scene> load_scene(const std::string& path);

// Each adds itself and its options to `app`, and what it does to `commands`.
void add_replay(CLI::App& app, std::vector<Command>& commands);
void add_sim(CLI::App& app, std::vector<Command>& commands);
void add_scene(CLI::App& app, std::vector<Command>& commands);
void add_trade(CLI::App& app, std::vector<Command>& commands);
void add_trade_firmware(CLI::App& trade, std::vector<Command>& commands);
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
