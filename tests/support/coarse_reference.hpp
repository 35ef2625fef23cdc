// SPDX-License-Identifier: Apache-2.0
// The oracle of tactile/coarse.hpp: the same definition in double and in levels. Gram-Schmidt on unit vectors, every
// vector twice, so that what rounding leaves of a mode is taken out as well.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

namespace holdfast::test {

struct CoarsePatch {
  double change = 0.0;                  // levels
  double shading = 0.0;                 // levels, mean of both pictures
  double slope_x = 0.0, slope_y = 0.0;  // levels a step, mean of both pictures
  double empty_x = 0.0, empty_y = 0.0;  // levels a step
  double x = 0.0, y = 0.0;              // place; any unit
};

struct CoarseSeen {
  double motion_steps = 0.0;  // 0: none that stands out
  double signal = 0.0;        // evidence over what it is the difference of: near 0, rounding decides the motion
};

inline CoarseSeen coarse_reference(std::span<const CoarsePatch> patches) {
  // coarse.cpp: a mode is dropped when less than this part of it is not in the modes before.
  constexpr double kLeastPart = 1.0 / 32.0;
  constexpr std::size_t kSticks = 7, kModes = 10;
  const std::size_t n = patches.size();
  if (n < 20) return {};
  using Vector = std::vector<double>;
  const auto dot = [](const Vector& a, const Vector& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  };
  const auto project = [&](Vector& v, const std::vector<Vector>& units) {
    for (int pass = 0; pass < 2; ++pass) {
      for (const Vector& unit : units) {
        const double along = dot(v, unit);
        for (std::size_t i = 0; i < n; ++i) v[i] -= along * unit[i];
      }
    }
  };
  std::array<Vector, kModes> modes;
  Vector change;
  double slopes = 0.0;
  for (const CoarsePatch& p : patches) {
    const std::array<double, kModes> row{1.0,       p.x,       p.y,       p.shading, p.x * p.slope_x + p.y * p.slope_y,
                                         p.empty_x, p.empty_y, p.slope_x, p.slope_y, p.x * p.slope_y - p.y * p.slope_x};
    for (std::size_t k = 0; k < kModes; ++k) modes[k].push_back(row[k]);
    change.push_back(p.change);
    slopes += p.slope_x * p.slope_x + p.slope_y * p.slope_y;
  }
  std::vector<Vector> units;
  double stuck = 0.0;
  for (std::size_t k = 0; k < kModes; ++k) {
    if (k == kSticks) {
      project(change, units);
      stuck = dot(change, change);
    }
    Vector mode = modes[k];
    const double whole = std::sqrt(dot(mode, mode));
    project(mode, units);
    const double part = std::sqrt(dot(mode, mode));
    if (whole == 0.0 || part < kLeastPart * whole) continue;
    for (double& component : mode) component /= part;
    units.push_back(mode);
  }
  project(change, units);
  const double left = dot(change, change);
  const double noise = left / static_cast<double>(n - kModes) + 0.02;
  const double evidence = stuck - left - 33.0 * noise;
  CoarseSeen out;
  out.signal = evidence / (stuck + left + 33.0 * noise);
  if (evidence > 0.0) out.motion_steps = std::sqrt(evidence / (slopes / 2.0 + 0.01 * static_cast<double>(n)));
  return out;
}

}  // namespace holdfast::test
