// SPDX-License-Identifier: Apache-2.0
// The markers of the gel by name: row 0 at the top, column 0 at the left, index = row * cols + col.
#pragma once

#include <array>
#include <cstdint>

#include "base/units.hpp"

namespace holdfast {

inline constexpr int kMaxMarkers = 128;  // the largest printed grid sold is 8x10; room for the next
inline constexpr int kMaxDots = 192;     // markers plus dirt and reflections

struct GridSize {
  std::uint8_t rows = 7;
  std::uint8_t cols = 9;
  [[nodiscard]] constexpr int count() const { return rows * cols; }
  friend constexpr bool operator==(GridSize, GridSize) = default;
};

struct Marker {
  PixelsQ8 x;          // working image
  PixelsQ8 y;          // working image
  bool valid = false;  // found in this frame and sure of its name; x and y are a prediction otherwise
};

struct MarkerField {
  GridSize grid;
  std::array<Marker, kMaxMarkers> markers{};

  [[nodiscard]] int valid_count() const {
    int n = 0;
    for (int i = 0; i < grid.count(); ++i) n += markers[static_cast<std::size_t>(i)].valid ? 1 : 0;
    return n;
  }
};

}  // namespace holdfast
