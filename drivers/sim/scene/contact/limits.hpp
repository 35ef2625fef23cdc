// SPDX-License-Identifier: Apache-2.0
// What keeps the springs' formulas finite at any scene's numbers.
#pragma once

#include <algorithm>

namespace holdfast::scene {

inline constexpr double kMost = 1e40;
// A spring on its limit carries it up to a few roundings.
inline constexpr double kOnLimit = 1.0 - 1e-12;

[[nodiscard]] inline double positive(double value) {
  return value > 0.0 ? std::clamp(value, 1.0 / kMost, kMost) : 0.0;
}

[[nodiscard]] inline double bounded(double value) {
  return std::clamp(value, -kMost, kMost);
}

}  // namespace holdfast::scene
