// SPDX-License-Identifier: Apache-2.0
// What every error line of the project has: what, likely cause, next step. Included after CppUTest.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

namespace holdfast::test {

inline void check_says(const std::string& error, std::initializer_list<std::string_view> parts) {
  for (const std::string_view part : parts) {
    if (error.find(part) == std::string::npos)
      FAIL(("not in the message: " + std::string(part) + "\n" + error).c_str());
  }
  CHECK_TRUE(error.find(". Likely cause: ") != std::string::npos && error.find(". Next: ") != std::string::npos);
  CHECK_TRUE(error.find('\n') == std::string::npos);
}

}  // namespace holdfast::test
