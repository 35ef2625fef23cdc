// SPDX-License-Identifier: Apache-2.0
// A check for numbers of a command line, "nan" among those refused: CLI11's own range check lets it pass.
#pragma once

#include <array>
#include <charconv>
#include <cstdio>
#include <functional>
#include <string>
#include <system_error>

namespace holdfast {

// Empty, or what is wrong.
[[nodiscard]] inline std::function<std::string(const std::string&)> number_from_to(double least, double most) {
  return [least, most](const std::string& text) {
    double value = 0.0;
    const auto [end, wrong] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (wrong == std::errc{} && end == text.data() + text.size() && value >= least && value <= most)
      return std::string{};
    std::array<char, 80> range{};
    (void)std::snprintf(range.data(), range.size(), "is no number from %g to %g", least, most);
    return "'" + text + "' " + range.data();
  };
}

}  // namespace holdfast
