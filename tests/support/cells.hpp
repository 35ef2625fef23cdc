// SPDX-License-Identifier: Apache-2.0
// A line of CSV without quotes, cell by cell.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace holdfast::test {

[[nodiscard]] inline std::vector<std::string> cells_of(std::string_view line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

}  // namespace holdfast::test
