// SPDX-License-Identifier: Apache-2.0
// How numbers, lists of words and typing errors are told in messages about scene files, and in others.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::scene::file {

using Words = std::vector<std::string_view>;

// The shortest text that gives the number again.
[[nodiscard]] std::string shown(double number);

template <typename Range, typename Name = std::identity>
[[nodiscard]] std::string joined(const Range& words, std::string_view between = ", ", Name name = {}) {
  std::string out;
  for (const auto& word : words) out.append(out.empty() ? "" : between).append(std::invoke(name, word));
  return out;
}

// Of a table whose rows have names.
template <typename Rows>
[[nodiscard]] std::string names_of(const Rows& rows) {
  return joined(rows, ", ", [](const auto& row) { return row.name; });
}

// Letters to add, to leave out or to change (Levenshtein's distance).
[[nodiscard]] std::size_t edits(std::string_view a, std::string_view b);

// The word that was meant, if half of it is right, in capitals or not; else empty. A word that the other begins with is
// one step away.
[[nodiscard]] std::string_view nearest(std::string_view word, const Words& words);

}  // namespace holdfast::scene::file
