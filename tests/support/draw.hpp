// SPDX-License-Identifier: Apache-2.0
// Inputs from all of their ranges; every run draws the same ones.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>

#include "base/units.hpp"
#include "tactile/types.hpp"

namespace holdfast::test {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}

  // All of the range alike; and every fourth time one of its ends or the middle.
  [[nodiscard]] std::int64_t of(std::int64_t least, std::int64_t most) {
    if (random_() % 4 == 0) return one_of(std::array{least, most, std::midpoint(least, most)});
    return std::uniform_int_distribution(least, most)(random_);
  }
  [[nodiscard]] std::int32_t of32(std::int32_t least, std::int32_t most) {
    return static_cast<std::int32_t>(of(least, most));
  }
  template <typename T, std::size_t n>
  [[nodiscard]] T one_of(const std::array<T, n>& some) {
    return some[random_() % n];
  }
  [[nodiscard]] bool one_in(unsigned n) { return random_() % n == 0; }

  [[nodiscard]] GridSize grid() {
    return one_of(std::array<GridSize, 8>{{{7, 9}, {8, 16}, {16, 8}, {8, 10}, {3, 3}, {1, 128}, {1, 2}, {1, 1}}});
  }
  // From the tracker's noise to the ends of the format; one marker in eight is lost, now and then six.
  [[nodiscard]] DisplacementField field(GridSize grid) {
    const auto size_um = one_of(std::array<std::int32_t, 7>{0, 3, 60, 400, 1'900, 9'000, Micrometres::kMax});
    const unsigned lost_of_8 = one_in(8) ? 6 : 1;
    DisplacementField out;
    out.grid = grid;
    for (std::int32_t i = 0; i < grid.count(); ++i) {
      if (random_() % 8 < lost_of_8) continue;
      out.markers[idx(i)] = {Micrometres::from_raw(of32(-size_um, size_um)),
                             Micrometres::from_raw(of32(-size_um, size_um)), true};
    }
    return out;
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace holdfast::test
