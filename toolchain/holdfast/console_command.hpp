// SPDX-License-Identifier: Apache-2.0
// holdfast console: the device's console for people and for scripts.
#pragma once

#include <vector>

#include "toolchain/support/command.hpp"

namespace holdfast::tool {

void add_console(CLI::App& app, std::vector<Command>& commands);

}  // namespace holdfast::tool
