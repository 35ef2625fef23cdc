// SPDX-License-Identifier: Apache-2.0
#include "vision/window.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>

#include "base/math.hpp"

namespace holdfast::window {
namespace {

constexpr std::int32_t kStep = 8;  // window sizes are multiples: compilers turn loops of 8 into vector code

struct Place {
  std::int32_t left = 0, top = 0;
};

// The window whose centre is nearest to (x, y), kept inside the picture. Centre of a window = left + (size - 1) / 2.
Place place(const LumaView& luma, std::int32_t size, PixelsQ8 x, PixelsQ8 y) {
  const std::int32_t half_q8 = (size - 1) * 128;
  return {std::clamp((x.raw() - half_q8 + 128) >> 8, 0, luma.width - size),
          std::clamp((y.raw() - half_q8 + 128) >> 8, 0, luma.height - size)};
}

struct Background {
  std::int32_t level = 0;   // grey levels
  std::int32_t tilt_x = 0;  // right side minus left side, grey levels
  std::int32_t tilt_y = 0;  // bottom minus top
};

// Sum of `count` bytes, 8 at once, in four sums of 16 bits. Range: count a multiple of 8, at most 128, so 32 640 in
// all.
std::int32_t sum_of(const std::uint8_t* from, std::int32_t count) {
  constexpr std::uint64_t kEverySecond = 0x00FF00FF00FF00FF;
  static_assert(kStep == sizeof(std::uint64_t) && kMaxSize <= 128);
  std::uint64_t sums = 0;
  for (std::int32_t x = 0; x < count; x += kStep) {
    std::uint64_t bytes = 0;
    std::memcpy(&bytes, from + x, sizeof bytes);
    sums += (bytes & kEverySecond) + (bytes >> 8 & kEverySecond);
  }
  sums += sums >> 32;
  return static_cast<std::int32_t>((sums + (sums >> 16)) & 0xFFFF);
}

// Plane through the means of the window's four sides. A side cannot be darker than the brightest one by more than a
// third of the dot's contrast: what is darker holds a dot (the marker jumped, or a neighbour came near). Limiting
// instead of switching keeps the re-centring from cycling between two answers (seen beside the dark rims of real gels).
Background background_of(const LumaView& luma, std::int32_t size, Place at, std::int32_t contrast) {
  const std::uint8_t* first = luma.row(at.top) + at.left;
  const std::uint8_t* last = luma.row(at.top + size - 1) + at.left;
  std::int32_t top = sum_of(first, size), bottom = sum_of(last, size), left = 0, right = 0;
  // Every second row: half the loads, and the level still stands on three quarters of the rim.
  const std::ptrdiff_t two_rows = 2 * std::ptrdiff_t{luma.stride};
  for (std::int32_t y = 0; y < size; y += kStep) {
    for (std::int32_t j = 0; j < kStep; j += 2, first += two_rows) {
      left += 2 * first[0];
      right += 2 * first[size - 1];
    }
  }
  const std::int32_t darkest = std::max({top, bottom, left, right}) - contrast * size / 3;
  for (std::int32_t* side : {&top, &bottom, &left, &right}) *side = std::max(*side, darkest);
  return {(top + bottom + left + right + 2 * size) / (4 * size), (right - left) / size, (bottom - top) / size};
}

std::int32_t centre_mean(const LumaView& luma, std::int32_t size, PixelsQ8 x, PixelsQ8 y) {
  const std::int32_t n = std::max(2, size / 6);
  const Place at = place(luma, n, x, y);
  std::int32_t sum = n * n / 2;
  for (std::int32_t j = 0; j < n; ++j) {
    const std::uint8_t* row = luma.row(at.top + j) + at.left;
    for (std::int32_t i = 0; i < n; ++i) sum += row[i];
  }
  return sum / (n * n);
}

// Range: level - margin in [0, 255]; both tilts together are cut so that t stays there too. A tilt is at most a third
// of a contrast: 85 levels.
Plane plane_of(const Background& background, std::int32_t size, std::int32_t margin) {
  const std::int32_t level = std::clamp(background.level - margin, 0, 255);
  std::int32_t tilt_x = background.tilt_x;
  std::int32_t tilt_y = background.tilt_y;
  if ((std::abs(tilt_x) + std::abs(tilt_y)) / 2 + 2 > std::min(level, 255 - level)) tilt_x = tilt_y = 0;
  // tilt levels over size - 1 pixels are (tilt << 8) / (size - 1) in Q9 per half pixel.
  return {static_cast<std::uint8_t>(level), static_cast<std::int16_t>((tilt_x << 8) / (size - 1)),
          static_cast<std::int16_t>((tilt_y << 8) / (size - 1))};
}

}  // namespace

Sums sums_scalar(const std::uint8_t* top_left, std::int32_t stride, std::int32_t size, const Plane& plane,
                 std::uint8_t cap) {
  Sums out{};
  for (std::int32_t y = 0; y < size; ++y) {
    const std::uint8_t* row = top_left + static_cast<std::ptrdiff_t>(y) * stride;
    const std::int32_t level_y = plane.level + ((plane.slope_y_q9 * (2 * y - (size - 1))) >> 9);
    for (std::int32_t x = 0; x < size; ++x) {
      const std::int32_t level = level_y + ((plane.slope_x_q9 * (2 * x - (size - 1))) >> 9);
      const auto weight = static_cast<std::uint32_t>(std::clamp<std::int32_t>(level - row[x], 0, cap));
      out.mass += weight;
      out.x += weight * static_cast<std::uint32_t>(x);
      out.y += weight * static_cast<std::uint32_t>(y);
    }
  }
  return out;
}

std::int32_t size_for(PixelsQ8 pitch, std::int32_t pct) {
  constexpr std::array<std::int32_t, 6> kSizes{16, 24, 32, 48, 64, 96};
  for (const std::int32_t size : kSizes) {
    if (size * 100 * 256 >= pitch.raw() * pct) return size;
  }
  return kMaxSize;
}

std::int32_t contrast_at(const LumaView& luma, std::int32_t size, PixelsQ8 x, PixelsQ8 y) {
  const Background background = background_of(luma, size, place(luma, size, x, y), 255);
  return std::max(0, background.level - centre_mean(luma, size, x, y));
}

bool measure(const LumaView& luma, std::int32_t size, int passes, Dot& dot) {
  // Within 1.25 px of the window's middle the rim has equal room on all sides: good enough to stop. A wider limit stops
  // short of the dot when dirt pulls at it.
  constexpr std::int32_t kSettledQ8 = 320;
  // A tenth of the window: smaller is a speck. (A printed dot fills a quarter to a third.)
  const std::uint32_t least_area = static_cast<std::uint32_t>(size * size / 20);
  Dot now = dot;
  const std::int32_t margin = std::max(1, dot.contrast * 3 / 16);
  const auto cap = static_cast<std::uint8_t>(std::clamp(dot.contrast * 10 / 16, 1, 255));
  Place at = place(luma, size, now.x, now.y);
  Background background{};
  for (int pass = 0; pass < passes; ++pass) {
    background = background_of(luma, size, at, dot.contrast);
    const Sums s = sums(luma.row(at.top) + at.left, luma.stride, size, plane_of(background, size, margin), cap);
    if (s.mass < least_area * cap) return false;
    // Range: s.x * 256 <= 1.4e11 in 64 bits.
    const auto centre = [&](std::int32_t origin, std::uint32_t weighted) {
      return PixelsQ8::from_raw((origin << 8) +
                                static_cast<std::int32_t>(div_round(std::int64_t{weighted} << 8, s.mass)));
    };
    now.x = centre(at.left, s.x);
    now.y = centre(at.top, s.y);
    now.area = static_cast<std::int32_t>(s.mass / cap);
    const std::int32_t half_q8 = (size - 1) * 128;
    const Place next = place(luma, size, now.x, now.y);
    const bool settled = std::abs(now.x.raw() - (at.left << 8) - half_q8) <= kSettledQ8 &&
                         std::abs(now.y.raw() - (at.top << 8) - half_q8) <= kSettledQ8;
    const bool stays = next.left == at.left && next.top == at.top;
    if (settled || stays) {
      now.contrast = std::max(0, background.level - centre_mean(luma, size, now.x, now.y));
      dot = now;
      return true;
    }
    at = next;
  }
  return false;
}

}  // namespace holdfast::window
