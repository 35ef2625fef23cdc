// SPDX-License-Identifier: Apache-2.0
// sums() of window.hpp in vector code: the same integers as sums_scalar(), 16 pixels at a time.
//
// OpenCV's universal intrinsics, inline, become NEON or SSE2: `-` of bytes stops at 0. Written out because gcc 12
// vectorises the scalar loop badly: with it a whole frame took 1 032 744 aarch64 instructions. From gcc's own vectors,
// 8 pixels at a time, to this (instructions, aarch64 | x86):
//   window of 16           435 ->    294 |     892 ->    444
//             24           776 ->    636 |   1 657 ->  1 161
//             32         1 345 ->    817 |   2 876 ->  1 509
//             48         2 789 ->  1 785 |   5 703 ->  3 680
//             64         5 162 ->  2 982 |  10 080 ->  6 476
//             96        12 378 ->  7 297 |  22 590 -> 14 747
//            128        23 781 -> 15 696 |  40 719 -> 26 402
//   a whole frame      116 794 -> 106 205 | 193 000 -> 156 600
// The last 8 columns of a window of 24, of two rows in one vector: a whole frame 104 008 -> 100 075 (aarch64).
// Not part of the integer gate: vector registers are its point.
#include <array>

#include "vision/window.hpp"

#include <opencv2/core/hal/intrin.hpp>

namespace holdfast::window {
namespace {

// Sum over y of y * w without a multiplication per pixel: within a band of 8 rows the column sum so far is added up
// once more each row, which weighs row j with 8 - j; so is the sum of all bands so far, each band. Weights are <= 255.
// Range of the 16-bit lanes, signed where they are multiplied: a band's column sum <= 2 040, 16 of them 32 640; its
// running sum <= 36 * 255 = 9 180, two of them 18 360; a column over 128 rows <= 32 640. Of the 32-bit sums:
// mass <= 4.2e6, 8 * bands <= 8 * 16 * mass = 5.4e8, and (128 + 8) * mass = 5.7e8.
constexpr std::int32_t kBand = 8;
constexpr std::int32_t kLanes = 16;

// first, first + step, ... in eight lanes.
cv::v_int16x8 ramp(std::int32_t first, std::int32_t step) {
  const auto at = [&](std::int32_t lane) { return static_cast<std::int16_t>(first + step * lane); };
  return {at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)};
}

// Columns go in groups of 16, as two halves of 16 bits. The last 8 of a window of 24 share one vector for two rows.
template <std::int32_t kSize>
Sums sums_of(const std::uint8_t* top_left, std::int32_t stride, const Plane& plane, std::uint8_t cap) {
  constexpr std::size_t kGroups = kSize / kLanes;
  constexpr bool kHasRest = kSize % kLanes != 0;
  constexpr std::int32_t kRest = kSize - kLanes / 2;
  constexpr std::size_t kHalves = 2 * kGroups + (kHasRest ? 1 : 0);
  const cv::v_int16x8 slope_x = cv::v_setall_s16(plane.slope_x_q9);
  const cv::v_uint8x16 most = cv::v_setall_u8(cap);
  const auto levels = [&](std::int32_t x) { return cv::v_mul_wrap(ramp(2 * x - (kSize - 1), 2), slope_x) >> 9; };
  const auto level_of = [&](std::int32_t first, std::int32_t second) {
    return cv::v_reinterpret_as_u8(cv::v_pack(levels(first), levels(second)));
  };
  std::array<cv::v_uint8x16, kGroups> level_x;
  for (std::size_t g = 0; g < kGroups; ++g) {
    const std::int32_t first = static_cast<std::int32_t>(g) * kLanes;
    level_x[g] = level_of(first, first + kLanes / 2);
  }
  const cv::v_uint8x16 level_rest = level_of(kRest, kRest);
  std::array<cv::v_uint16x8, kHalves> column;
  for (cv::v_uint16x8& half : column) half = cv::v_setzero_u16();
  const cv::v_int16x8 ones = cv::v_setall_s16(1);
  cv::v_int32x4 mass = cv::v_setzero_s32();
  cv::v_int32x4 bands = cv::v_setzero_s32();  // sum over the bands of (bands from it on) * w
  cv::v_int32x4 rows = cv::v_setzero_s32();   // sum over the rows of (rows of its band from it on) * w
  for (std::int32_t y = 0; y < kSize; y += kBand) {
    std::array<cv::v_uint16x8, kHalves> band;
    std::array<cv::v_uint16x8, kHalves> running;
    for (std::size_t h = 0; h < kHalves; ++h) band[h] = running[h] = cv::v_setzero_u16();
    const auto add = [&](std::size_t h, const cv::v_uint16x8& weight) {
      band[h] = cv::v_add_wrap(band[h], weight);
      running[h] = cv::v_add_wrap(running[h], band[h]);
    };
    for (std::int32_t j = 0; j < kBand; j += 2) {
      const std::uint8_t* const row = top_left + static_cast<std::ptrdiff_t>(y + j) * stride;
      std::array<cv::v_uint8x16, 2> offset;
      for (std::int32_t k = 0; k < 2; ++k) {
        const std::int32_t tilt = (plane.slope_y_q9 * (2 * (y + j + k) - (kSize - 1))) >> 9;
        offset[static_cast<std::size_t>(k)] = cv::v_setall_u8(static_cast<std::uint8_t>(plane.level + tilt));
        for (std::size_t g = 0; g < kGroups; ++g) {
          const cv::v_uint8x16 level = cv::v_add_wrap(level_x[g], offset[static_cast<std::size_t>(k)]);
          const cv::v_uint8x16 weight = cv::v_min(level - cv::v_load(row + k * stride + g * kLanes), most);
          add(2 * g, cv::v_expand_low(weight));
          add(2 * g + 1, cv::v_expand_high(weight));
        }
      }
      if constexpr (kHasRest) {
        const cv::v_uint8x16 level = cv::v_add_wrap(level_rest, cv::v_combine_low(offset[0], offset[1]));
        const cv::v_uint8x16 pixels = cv::v_load_halves(row + kRest, row + stride + kRest);
        const cv::v_uint8x16 weight = cv::v_min(level - pixels, most);
        add(kHalves - 1, cv::v_expand_low(weight));
        add(kHalves - 1, cv::v_expand_high(weight));
      }
    }
    cv::v_uint16x8 total = cv::v_setzero_u16();
    for (std::size_t h = 0; h < kHalves; h += 2) {
      const bool both = h + 1 < kHalves;
      total = cv::v_add_wrap(total, both ? cv::v_add_wrap(band[h], band[h + 1]) : band[h]);
      const cv::v_uint16x8 of_rows = both ? cv::v_add_wrap(running[h], running[h + 1]) : running[h];
      rows = cv::v_dotprod_fast(cv::v_reinterpret_as_s16(of_rows), ones, rows);
    }
    for (std::size_t h = 0; h < kHalves; ++h) column[h] = cv::v_add_wrap(column[h], band[h]);
    mass = cv::v_dotprod_fast(cv::v_reinterpret_as_s16(total), ones, mass);
    bands += mass;
  }
  cv::v_int32x4 weighted_x = cv::v_setzero_s32();
  for (std::size_t h = 0; h < kHalves; ++h) {
    const std::int32_t x = static_cast<std::int32_t>(h) * kLanes / 2;
    weighted_x = cv::v_dotprod_fast(cv::v_reinterpret_as_s16(column[h]), ramp(x, 1), weighted_x);
  }
  const std::int32_t sum = cv::v_reduce_sum(mass);
  const std::int32_t weighted_y = (kSize + kBand) * sum - cv::v_reduce_sum((bands << 3) + rows);
  return {static_cast<std::uint32_t>(sum), static_cast<std::uint32_t>(cv::v_reduce_sum(weighted_x)),
          static_cast<std::uint32_t>(weighted_y)};
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
