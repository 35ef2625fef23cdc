// SPDX-License-Identifier: Apache-2.0
// Says of a picture in which no markers were found whether that is the light's fault: too dark or too bright. Judged
// only then: what tracks well is lit well enough.
//
// Looks at one pixel in 64, so that it costs nothing beside the search that failed. A GelSight Mini in its own light
// shows levels of 60 to 200 and dots 40 to 75 levels darker: where half of the picture lies within 16 levels of an end
// of the range, there are no dots to find.
#pragma once

#include <cstddef>
#include <cstdint>

#include "vision/luma.hpp"

namespace holdfast::exposure {

inline constexpr std::int32_t kStep = 8;  // pixels, both ways

// Range: any picture; at most 2^24 pixels are counted.
[[nodiscard]] inline bool is_bad(const LumaView& luma) {
  constexpr std::uint8_t kDark = 16, kBright = 255 - 16;
  std::int32_t dark = 0, bright = 0, count = 0;
  for (std::int32_t y = kStep / 2; y < luma.height; y += kStep) {
    const std::uint8_t* const row = luma.data + std::ptrdiff_t{y} * luma.stride;
    for (std::int32_t x = kStep / 2; x < luma.width; x += kStep) {
      dark += row[x] < kDark ? 1 : 0;
      bright += row[x] > kBright ? 1 : 0;
      ++count;
    }
  }
  return (dark + bright) * 2 > count;
}

}  // namespace holdfast::exposure
