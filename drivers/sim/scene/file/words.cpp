// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/file/words.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

#include "drivers/sim/scene/file/json.hpp"

namespace holdfast::scene::file {
namespace {

std::size_t distance(std::string_view a, std::string_view b) {
  if (!a.empty() && !b.empty() && (a.starts_with(b) || b.starts_with(a))) return a.size() != b.size() ? 1 : 0;
  return edits(a, b);
}

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return out;
}

}  // namespace

std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t k = 0; k < b.size(); ++k) {
      const std::size_t change = diagonal + (a[i] == b[k] ? 0 : 1);
      diagonal = row[k + 1];
      row[k + 1] = std::min({change, diagonal + 1, row[k] + 1});
    }
  }
  return row.back();
}

std::string shown(double number) {
  std::array<char, 32> buffer{};
  const bool whole = std::abs(number) < 1e15 && number == std::trunc(number);
  const auto end = whole ? std::to_chars(buffer.begin(), buffer.end(), static_cast<std::int64_t>(number))
                         : std::to_chars(buffer.begin(), buffer.end(), number);
  return {buffer.begin(), end.ptr};
}

std::string_view nearest(std::string_view word, const Words& words) {
  std::string_view best;
  std::size_t least = json::kMostShown;
  if (word.size() > json::kMostShown) return best;
  for (const std::string_view candidate : words) {
    const std::size_t away = distance(lower(word), lower(candidate));
    if (away < least && 2 * away <= std::max(word.size(), candidate.size())) {
      best = candidate;
      least = away;
    }
  }
  return best;
}

}  // namespace holdfast::scene::file
