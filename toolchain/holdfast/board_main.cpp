// SPDX-License-Identifier: Apache-2.0
// holdfast on the board: the commands that look at the board itself. The rest of the tool is for a desk.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <vector>

#include "toolchain/holdfast/devices_command.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  try {
    CLI::App app{"holdfast: what a board has to say of itself; replay, sim and the like are for a desk", "holdfast"};
    app.require_subcommand(1);
    std::vector<tool::Command> commands;
    tool::add_devices(app, commands);
    CLI11_PARSE(app, argc, argv);
    const auto chosen = std::ranges::find_if(commands, [](const tool::Command& one) { return bool{*one.app}; });
    return chosen == commands.end() ? 2 : chosen->run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "holdfast: %s\n", error.what());
    return 1;
  }
}
