// SPDX-License-Identifier: Apache-2.0
// The whole of the tool's main(): one of the commands (commands.hpp).
#pragma once

namespace holdfast::tool {

// The version is an argument, so that a commit compiles main.cpp alone. Returns the exit status.
[[nodiscard]] int command_line(int argc, char** argv, const char* version);

}  // namespace holdfast::tool
