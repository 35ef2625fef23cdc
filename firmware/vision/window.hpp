// SPDX-License-Identifier: Apache-2.0
// Sub-pixel centre of one dark dot inside a small square window.
//
// weight(x, y) = clamp(t(x, y) - luma, 0, cap), centre = weighted mean position, with
//   t   = local background plane (means of the window's four sides) minus 3/16 of the dot's contrast,
//   cap = 10/16 of the contrast.
// The clamp makes the weight flat inside the dot (its print is mottled) and zero on the gel (noise, imprint);
// only the rim decides. Without it shading tilts the centroid: 0.041 px instead of 0.025 px rms at 320x240
// (probe, noise sigma 2.5). The plane takes out what shading remains.
#pragma once

#include <cstdint>

#include "base/units.hpp"
#include "vision/luma.hpp"

namespace holdfast::window {

inline constexpr std::int32_t kMinSize = 16;
inline constexpr std::int32_t kMaxSize = 128;

struct Dot {
  PixelsQ8 x;  // working image
  PixelsQ8 y;
  std::int32_t contrast = 0;  // background minus dot, grey levels, 0..255
  std::int32_t area = 0;      // weight over cap: area of the dot in pixels
};

struct Sums {
  std::uint32_t mass = 0;  // sum of weights
  std::uint32_t x = 0;     // sum of weight * column
  std::uint32_t y = 0;     // sum of weight * row
};

// The plane t of a window of `size`, about its middle: with u = 2 x - (size - 1), v = 2 y - (size - 1),
//   t(x, y) = level + ((slope_x_q9 * u) >> 9) + ((slope_y_q9 * v) >> 9)    (arithmetic shifts).
// Range: both products fit 16 bits (a tilt over the window of at most 127 levels), and t stays within 0..255.
struct Plane {
  std::uint8_t level = 0;
  std::int16_t slope_x_q9 = 0;  // grey levels per half pixel
  std::int16_t slope_y_q9 = 0;
};

// Range: size one of 16, 24, 32, 48, 64, 96, 128; mass <= 128 * 128 * 255 = 4.2e6; x, y <= mass * 127 = 5.4e8.
// The plain form says what is meant; the vector form (window_simd.cpp) gives the same integers and is used.
[[nodiscard]] Sums sums_scalar(const std::uint8_t* top_left, std::int32_t stride, std::int32_t size, const Plane& plane,
                               std::uint8_t cap);
[[nodiscard]] Sums sums(const std::uint8_t* top_left, std::int32_t stride, std::int32_t size, const Plane& plane,
                        std::uint8_t cap);

// Window size for a lattice: the smallest of at least so many percent of the pitch. With 70 a dot of 0.52 pitch keeps
// room to its rim, also when it is 1.25 px off the middle (pitch 25.5 px: 0.029 px rms, but 0.157 in a window of 16); a
// neighbour's rim, 0.74 pitch away, stays outside.
// Range: pct 1..1000; a pitch beyond the largest size gets that.
inline constexpr std::int32_t kSizePct = 70;
[[nodiscard]] std::int32_t size_for(PixelsQ8 pitch, std::int32_t pct = kSizePct);

// Finds the dot near (dot.x, dot.y), re-centring the window at most `passes` times; dot.contrast is what to expect.
// Returns false, and leaves `dot` as it was, when there is nothing dark enough or the centre does not settle.
// Range: the picture is at least `size` wide and high; any position (the window is kept inside the picture).
[[nodiscard]] bool measure(const LumaView& luma, std::int32_t size, int passes, Dot& dot);

// Contrast of the dot at a place known to about a quarter of its radius: side means minus centre mean.
[[nodiscard]] std::int32_t contrast_at(const LumaView& luma, std::int32_t size, PixelsQ8 x, PixelsQ8 y);

}  // namespace holdfast::window
