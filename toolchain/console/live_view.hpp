// SPDX-License-Identifier: Apache-2.0
// The live view as text: a pure function from what is known to the lines of a screen.
#pragma once

#include <string>
#include <vector>

#include "toolchain/console/live_model.hpp"

namespace holdfast::console_tool {

struct LiveLook {
  static constexpr int kColumns = 80, kRows = 24;  // what the whole view needs
  int columns = kColumns;
  int rows = kRows;
  bool unicode = false;  // arrows and blocks; else ASCII
  bool color = false;
};

// At most `rows` lines, none wider than `columns`, without line ends. Below 80x24 the most important lines and which
// size is needed. Range: any size.
[[nodiscard]] std::vector<std::string> draw(const LiveModel& model, const LiveLook& look);

}  // namespace holdfast::console_tool
