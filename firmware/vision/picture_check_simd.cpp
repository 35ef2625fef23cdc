// SPDX-License-Identifier: Apache-2.0
// row_steps() of picture_check.hpp in vector code: the same integers as row_steps_scalar(), 16 pixels at a time.
//
// gcc's generic vectors become NEON or SSE2. Written out because gcc 12 turns max() - b into compares and masks: with
// the scalar loop, vectorised, a picture of 410x308 took 670 000 x86 instructions. Not part of the integer gate.
#include <cstring>

#include "vision/picture_check.hpp"

namespace holdfast::picture_check {
namespace {

using Bytes [[gnu::vector_size(kGroup)]] = std::uint8_t;
using SignedBytes [[gnu::vector_size(kGroup)]] = std::int8_t;
using Words [[gnu::vector_size(2 * kGroup)]] = std::int16_t;

// So many groups are added up in signed bytes. Range of a word: a row of kMaxLumaWidth has 102 groups, each at most
// kMostCap per lane: 1632.
constexpr std::int32_t kBand = 7 * kGroup;
static_assert(kBand / kGroup * kMostCap <= INT8_MAX);

Bytes load(const std::uint8_t* from) {
  Bytes out;
  std::memcpy(&out, from, sizeof out);
  return out;
}

Bytes less(Bytes a, Bytes b) {
  return (a > b ? a : b) - b;
}

Bytes distance(Bytes a, Bytes b) {
  return (a > b ? a : b) - (a > b ? b : a);
}

}  // namespace

std::int32_t row_steps(const Rows& rows, std::int32_t columns, std::int32_t cap) {
  const Bytes most = Bytes{} + static_cast<std::uint8_t>(cap);
  Words sums{};
  for (std::int32_t begin = 0; begin < columns; begin += kBand) {
    const std::int32_t end = begin + kBand < columns ? begin + kBand : columns;
    Bytes band{};
    for (std::int32_t x = begin; x < end; x += kGroup) {
      const Bytes above = load(rows.above + x);
      const Bytes row = load(rows.row + x);
      const Bytes before = distance(above, load(rows.two_above + x));
      const Bytes after = distance(load(rows.below + x), row);
      const Bytes natural = before > after ? before : after;
      const Bytes up = less(less(row, above), natural);
      const Bytes down = less(less(above, row), natural);
      band += (up < most ? up : most) - (down < most ? down : most);
    }
    sums += __builtin_convertvector(reinterpret_cast<SignedBytes>(band), Words);
  }
  std::int32_t sum = 0;
  for (std::size_t lane = 0; lane < kGroup; ++lane) sum += sums[lane];
  return sum;
}

}  // namespace holdfast::picture_check
