// SPDX-License-Identifier: Apache-2.0
// A file of JPEG pictures one behind the other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace holdfast::test {

using Jpeg = std::vector<std::uint8_t>;

// Empty: it cannot be read. A picture starts with FF D8 FF, which entropy-coded bytes cannot hold.
[[nodiscard]] inline std::vector<Jpeg> read_mjpg(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const Jpeg all{std::istreambuf_iterator<char>(file), {}};
  std::vector<Jpeg> film;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool begins = i + 2 < all.size() && all[i] == 0xFF && all[i + 1] == 0xD8 && all[i + 2] == 0xFF;
    if (begins) film.emplace_back();
    if (!film.empty()) film.back().push_back(all[i]);
  }
  return film;
}

}  // namespace holdfast::test
