// SPDX-License-Identifier: Apache-2.0
// Places, ways and forces in the plane of the gel.
#pragma once

#include <algorithm>
#include <cmath>

namespace holdfast::scene {

struct Vec2 {
  double x = 0.0;
  double y = 0.0;
  friend constexpr bool operator==(Vec2, Vec2) = default;
  friend constexpr Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
  friend constexpr Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
  friend constexpr Vec2 operator*(double s, Vec2 v) { return {s * v.x, s * v.y}; }
};

[[nodiscard]] constexpr double dot(Vec2 a, Vec2 b) {
  return a.x * b.x + a.y * b.y;
}

// std::hypot differs in its last bit between machines. Range: any finite numbers.
[[nodiscard]] inline double length(Vec2 v) {
  const double square = dot(v, v);
  if (square > 1e-280 && square < 1e280) return std::sqrt(square);
  const double most = std::max(std::abs(v.x), std::abs(v.y));
  if (most == 0.0) return 0.0;
  const Vec2 unit{v.x / most, v.y / most};
  return most * std::sqrt(dot(unit, unit));
}

}  // namespace holdfast::scene
