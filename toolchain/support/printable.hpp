// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace holdfast::tool {

// A line of a file or device that may be anybody's, for a terminal, which would obey it: control characters, those of
// UTF-8 too, become '?'.
[[nodiscard]] inline std::string printable(std::string_view line) {
  std::string out(line);
  for (std::size_t k = 0; k < out.size(); ++k) {
    const auto c = static_cast<unsigned char>(out[k]);
    const auto next = static_cast<unsigned char>(k + 1 < out.size() ? out[k + 1] : 0);
    if (c == 0xC2 && next >= 0x80 && next < 0xA0) out[k] = out[k + 1] = '?';
    if (c < 0x20 || c == 0x7F) out[k] = '?';
  }
  return out;
}

}  // namespace holdfast::tool
