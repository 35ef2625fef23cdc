// SPDX-License-Identifier: Apache-2.0
// holdfast devices and holdfast doctor: also on the board, where the rest of the tool is not (board_main.cpp).
#pragma once

#include <vector>

#include "toolchain/support/cli.hpp"

namespace holdfast::tool {

void add_devices(CLI::App& app, std::vector<Command>& commands);

}  // namespace holdfast::tool
