// SPDX-License-Identifier: Apache-2.0
// What leaves the tactile stages: scale-independent integers, the same for every camera size.
#pragma once

#include <array>
#include <cstdint>

#include "base/units.hpp"
#include "vision/markers.hpp"

namespace holdfast {

inline constexpr int kHistogramBins = 15;  // the paper, section III

// Displacement of each marker from its rest position on the empty gel.
struct MarkerDisplacement {
  Micrometres dx;
  Micrometres dy;
  bool valid = false;  // the marker is found now and has a rest position
};

struct DisplacementField {
  GridSize grid;
  std::array<MarkerDisplacement, kMaxMarkers> markers{};
};

// The paper's features. Shape of the histogram: count of markers per bin of abs(D) over [0, R).
struct Features {
  MicrometresPerSec vx;
  MicrometresPerSec vy;
  NatsQ16 entropy;
  NatsPerSecQ8 entropy_rate;
  std::int32_t markers = 0;  // how many markers the figures stand on
  bool rates_valid = false;  // false on the first frame and after a gap: vx, vy and entropy_rate are 0
  bool gap = false;          // too long since the frame before
  std::array<std::uint8_t, kHistogramBins> histogram{};
};

}  // namespace holdfast
