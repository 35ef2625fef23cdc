// SPDX-License-Identifier: Apache-2.0
// A recording through the whole firmware.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toolchain/session/run.hpp"

namespace holdfast::tool {

struct ReplayOptions {
  CommonOptions common;
  std::string input;
  std::string reference = "auto";
  std::vector<std::string> opening;  // a-b: frames in which the gripper says that it opens
  double fps = 0;
  // Of the other finger of the same grasp; empty: one finger. INPUT is the left's.
  std::string right;
  std::string right_reference = "auto";
  std::optional<int> offset;  // the right's frame i + offset shows what the left's frame i does; none: found
};
// The command. 0: done; else one line on stderr was printed.
[[nodiscard]] int replay(const ReplayOptions& options);

// After every frame of the recording, used or rejected.
using ReplayWatch = std::function<void(const App&)>;

// Without output, for a program that looks at every frame. Empty, or an error line.
[[nodiscard]] std::string replay_quietly(const ReplayOptions& options, const ReplayWatch& watch);

}  // namespace holdfast::tool
