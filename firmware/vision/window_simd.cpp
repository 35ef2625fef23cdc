// SPDX-License-Identifier: Apache-2.0
// sums() of window.hpp in vector code: the same integers as sums_scalar(), 8 pixels at a time.
//
// gcc's generic vectors become NEON or SSE2. Written out because gcc 12 vectorises the scalar loop badly: with it a
// whole frame took 1 032 744 aarch64 instructions, with this 129 581. Not part of the integer gate: vector registers
// are its point.
#include <array>
#include <cstring>

#include "base/math.hpp"
#include "vision/window.hpp"

namespace holdfast::window {
namespace {

// Sum over y of y * w without a multiplication per pixel: within a band of 8 rows the column sum so far is added up
// once more each row, which weighs row j with 8 - j. Range of the 16-bit lanes: weights <= 255, so a band's column sum
// <= 2 040, its running sum <= 36 * 255 = 9 180, and a column over 128 rows <= 32 640.
constexpr std::int32_t kBand = 8;

constexpr std::size_t kLanes = 8;
using Bytes [[gnu::vector_size(kLanes)]] = std::uint8_t;
using Words [[gnu::vector_size(2 * kLanes)]] = std::uint16_t;
using SignedWords [[gnu::vector_size(2 * kLanes)]] = std::int16_t;
using DoubleWords [[gnu::vector_size(4 * kLanes)]] = std::uint32_t;

// In a struct, because a template argument loses the attribute that makes a vector.
struct ByteLanes {
  Bytes v;
};
struct WordLanes {
  Words v;
};

std::uint32_t total(const DoubleWords& lanes) {
  std::uint32_t sum = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) sum += lanes[lane];
  return sum;
}

template <std::int32_t kSize>
Sums sums_of(const std::uint8_t* top_left, std::int32_t stride, const Plane& plane, std::uint8_t cap) {
  constexpr std::size_t kGroups = static_cast<std::size_t>(kSize) / kLanes;
  constexpr SignedWords kHalfPixels{0, 2, 4, 6, 8, 10, 12, 14};
  std::array<ByteLanes, kGroups> level_x{};
  for (std::size_t g = 0; g < kGroups; ++g) {
    const auto first = static_cast<std::int16_t>(static_cast<std::int32_t>(2 * g * kLanes) - (kSize - 1));
    level_x[g].v = __builtin_convertvector(((kHalfPixels + first) * plane.slope_x_q9) >> 9, Bytes);
  }
  const Bytes most = Bytes{} + cap;
  std::array<WordLanes, kGroups> column{};
  DoubleWords mass{};
  DoubleWords weighted_y{};
  for (std::int32_t y = 0; y < kSize; y += kBand) {
    std::array<WordLanes, kGroups> band{};
    std::array<WordLanes, kGroups> running{};
    for (std::int32_t j = 0; j < kBand; ++j) {
      const std::uint8_t* row = top_left + static_cast<std::ptrdiff_t>(y + j) * stride;
      const std::int32_t tilt = (plane.slope_y_q9 * (2 * (y + j) - (kSize - 1))) >> 9;
      const Bytes offset = Bytes{} + static_cast<std::uint8_t>(plane.level + tilt);
      for (std::size_t g = 0; g < kGroups; ++g) {
        Bytes luma;
        std::memcpy(&luma, row + g * kLanes, kLanes);
        const Bytes level = level_x[g].v + offset;
        const Bytes dark = (level > luma ? level : luma) - luma;
        const Bytes weight = dark < most ? dark : most;
        band[g].v += __builtin_convertvector(weight, Words);
        running[g].v += band[g].v;
      }
    }
    for (std::size_t g = 0; g < kGroups; ++g) {
      const DoubleWords band32 = __builtin_convertvector(band[g].v, DoubleWords);
      mass += band32;
      weighted_y += band32 * static_cast<std::uint32_t>(y + kBand) - __builtin_convertvector(running[g].v, DoubleWords);
      column[g].v += band[g].v;
    }
  }
  // x = first column of the group + lane.
  constexpr DoubleWords kLane{0, 1, 2, 3, 4, 5, 6, 7};
  DoubleWords weighted_x{};
  for (std::size_t g = 0; g < kGroups; ++g) {
    weighted_x += __builtin_convertvector(column[g].v, DoubleWords) * (kLane + static_cast<std::uint32_t>(g * kLanes));
  }
  return {total(mass), total(weighted_x), total(weighted_y)};
}

}  // namespace

Sums sums(const std::uint8_t* top_left, std::int32_t stride, std::int32_t size, const Plane& plane, std::uint8_t cap) {
  switch (size) {
    case 16:
      return sums_of<16>(top_left, stride, plane, cap);
    case 24:
      return sums_of<24>(top_left, stride, plane, cap);
    case 32:
      return sums_of<32>(top_left, stride, plane, cap);
    case 48:
      return sums_of<48>(top_left, stride, plane, cap);
    case 64:
      return sums_of<64>(top_left, stride, plane, cap);
    case 96:
      return sums_of<96>(top_left, stride, plane, cap);
    default:
      return sums_of<128>(top_left, stride, plane, cap);
  }
}

}  // namespace holdfast::window
