// SPDX-License-Identifier: Apache-2.0
// What is wrong, in the project's one line.
#pragma once

#include <string>
#include <string_view>

namespace holdfast {

[[nodiscard]] inline std::string trouble(std::string_view what, std::string_view cause, std::string_view next) {
  std::string line(what);
  line += ". Likely cause: ";
  line += cause;
  line += ". Next: ";
  line += next;
  return line;
}

}  // namespace holdfast
