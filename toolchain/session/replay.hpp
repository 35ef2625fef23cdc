// SPDX-License-Identifier: Apache-2.0
// `holdfast replay` without its output, for a program that looks at every frame.
#pragma once

#include <functional>
#include <string>

#include "toolchain/holdfast/commands.hpp"

namespace holdfast::tool {

// After every frame of the recording, used or rejected.
using ReplayWatch = std::function<void(const App&)>;

// Empty, or an error line.
[[nodiscard]] std::string replay_quietly(const ReplayOptions& options, const ReplayWatch& watch);

}  // namespace holdfast::tool
