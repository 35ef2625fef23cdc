// SPDX-License-Identifier: Apache-2.0
// row_steps() of picture_check.hpp in vector code: the same integers as row_steps_scalar(), 16 pixels at a time.
//
// OpenCV's universal intrinsics, inline, become NEON or SSE2: `-` of bytes stops at 0. Written out because gcc 12 turns
// max() - b into compares and masks: with the scalar loop, vectorised, a picture of 410x308 took 670 000 x86
// instructions. In gcc's own vectors, which have no subtraction that stops, these took more (instructions, aarch64 |
// x86):
//   row of 400 pixels          625 ->     540 |     889 ->     810
//   picture of 410x308     218 700 -> 192 600 | 301 300 -> 277 000
// Not part of the integer gate.
#include "vision/picture_check.hpp"

#include <opencv2/core/hal/intrin.hpp>

namespace holdfast::picture_check {
namespace {

// So many groups are added up in signed bytes. Range of a word: a row of kMaxLumaWidth has 102 groups, each at most
// 2 * kMostCap per lane: 3264.
constexpr std::int32_t kBand = 7 * kGroup;
static_assert(kBand / kGroup * kMostCap <= INT8_MAX);

}  // namespace

std::int32_t row_steps(const Rows& rows, std::int32_t columns, std::int32_t cap) {
  const cv::v_uint8x16 most = cv::v_setall_u8(static_cast<std::uint8_t>(cap));
  cv::v_int16x8 sums = cv::v_setzero_s16();
  for (std::int32_t begin = 0; begin < columns; begin += kBand) {
    const std::int32_t end = begin + kBand < columns ? begin + kBand : columns;
    cv::v_uint8x16 band = cv::v_setzero_u8();
    for (std::int32_t x = begin; x < end; x += kGroup) {
      const cv::v_uint8x16 above = cv::v_load(rows.above + x);
      const cv::v_uint8x16 row = cv::v_load(rows.row + x);
      const cv::v_uint8x16 before = cv::v_absdiff(above, cv::v_load(rows.two_above + x));
      const cv::v_uint8x16 after = cv::v_absdiff(cv::v_load(rows.below + x), row);
      const cv::v_uint8x16 natural = cv::v_max(before, after);
      const cv::v_uint8x16 up = cv::v_min(row - above - natural, most);
      const cv::v_uint8x16 down = cv::v_min(above - row - natural, most);
      band = cv::v_add_wrap(band, cv::v_sub_wrap(up, down));
    }
    const cv::v_int8x16 steps = cv::v_reinterpret_as_s8(band);
    sums = cv::v_add_wrap(sums, cv::v_add_wrap(cv::v_expand_low(steps), cv::v_expand_high(steps)));
  }
  return cv::v_reduce_sum(sums);
}

}  // namespace holdfast::picture_check
