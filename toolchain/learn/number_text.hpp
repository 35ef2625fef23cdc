// SPDX-License-Identifier: Apache-2.0
// Numbers in the cells of our CSV files.
#pragma once

#include <charconv>
#include <string_view>
#include <system_error>

namespace holdfast::learn {

// The whole text is one number of that type, or `value` means nothing.
template <typename Number>
[[nodiscard]] bool to_number(std::string_view text, Number& value) {
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  return error == std::errc{} && rest == end;
}

}  // namespace holdfast::learn
