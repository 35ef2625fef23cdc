// SPDX-License-Identifier: Apache-2.0
// How numbers, lists of words and typing errors are told in messages about scene files.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace holdfast::scene::file {

using Words = std::vector<std::string_view>;

// The shortest text that gives the number again.
[[nodiscard]] std::string shown(double number);

template <typename Range>
[[nodiscard]] std::string joined(const Range& words, std::string_view between = ", ") {
  std::string out;
  for (const auto& word : words) out.append(out.empty() ? "" : between).append(word);
  return out;
}

// The word that was meant, if half of it is right, in capitals or not; else empty. A word that the other begins with is
// one step away.
[[nodiscard]] std::string_view nearest(std::string_view word, const Words& words);

}  // namespace holdfast::scene::file
