// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>

#include "toolchain/holdfast/commands.hpp"

namespace holdfast::tool {

void add_dataset(CLI::App&, std::vector<Command>&) {}

}  // namespace holdfast::tool
