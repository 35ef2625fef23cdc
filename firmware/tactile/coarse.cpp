// SPDX-License-Identifier: Apache-2.0
#include "tactile/coarse.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

#include "base/math.hpp"

namespace holdfast::coarse {
namespace {

// Columns of the least-squares fit: the modes that stick, those that slip, and the change.
constexpr std::size_t kChange = kModes;
constexpr std::size_t kColumns = kModes + 1;
constexpr std::size_t kSticks = kModes - 3;
constexpr std::size_t kSlopeX = kSticks, kSlopeY = kSticks + 1;

// A mode counts as none when the modes before it leave less than 1/32 of its length.
constexpr std::int64_t kLeastPart = 32 * 32;

// Levels of `change`, in 1/3200.
constexpr int kChangeShift = 3;
constexpr std::int64_t kChangeUnit = 3200;
constexpr std::int64_t kSlopeUnit = 1600;  // both pictures added
static_assert(kChangeUnit == 2 * kSlopeUnit, "the difference of their logarithms is 1");
constexpr std::int64_t kNoiseFloor = kChangeUnit * kChangeUnit / 50;  // 0.02 levels^2
constexpr std::int64_t kSlopeFloor = kSlopeUnit * kSlopeUnit / 100;   // 0.01 (levels / step)^2
constexpr std::int64_t kTimesNoise = 33;

using Column = std::array<std::int32_t, kMostPatches>;
constexpr std::size_t kTogether = 16;
static_assert(kMostPatches % kTogether == 0);

// Of `a` with two others. `n` is a whole number of kTogether, which leaves compilers no rest to do one by one. Range:
// components below 2^27 (slopes of 2^19 times places of 2^8) make sums of 320 products below 2^62.4.
std::array<std::int64_t, 2> dots(const Column& a, const Column& b, const Column& c, std::size_t n) {
  std::int64_t with_b = 0, with_c = 0;
#pragma GCC unroll 4
  for (std::size_t i = 0; i < n / kTogether * kTogether; ++i) {
    with_b += std::int64_t{a[i]} * b[i];
    with_c += std::int64_t{a[i]} * c[i];
  }
  return {with_b, with_c};
}

// Rows to the right of the diagonal, and the diagonal.
using Triangle = std::array<std::array<std::int64_t, kColumns>, kColumns>;

// Range: value * 2^left below 2^62, left from -16 to 48.
std::int64_t shifted(std::int64_t value, int left) {
  if (left >= 0) return value * (std::int64_t{1} << left);
  return (value + (std::int64_t{1} << (-left - 1))) >> -left;
}

// Each mode is scaled by a power of two to a square of 2^46 to 2^48; the change by kChangeShift, to one below 2^50.4.
// So a product of two is below 2^49.2 (Cauchy and Schwarz).
void normalise(Triangle& products) {
  std::array<int, kColumns> left{};
  for (std::size_t k = 0; k < kModes; ++k) {
    left[k] = (48 - static_cast<int>(std::bit_width(static_cast<std::uint64_t>(products[k][k])))) >> 1;
  }
  left[kChange] = kChangeShift;
  for (std::size_t k = 0; k < kColumns; ++k) {
    for (std::size_t j = k; j < kColumns; ++j) products[k][j] = shifted(products[k][j], left[k] + left[j]);
  }
}

constexpr int kShareBits = 46;

// a / b in Q46, by long division. Range: |a| below 2^51, b from 2^36 to 2^51.
std::int64_t share_q46(std::int64_t a, std::int64_t b) {
  std::int64_t rest = a * (1 << 12);
  std::int64_t share = rest / b;
  for (const int bits : {12, 12, 10}) {
    rest = rest % b * (1 << bits);
    share = share * (1 << bits) + rest / b;
  }
  return share;
}

__extension__ using Wide = __int128;

// Takes mode k out of all columns that follow (Gauss; what is left of their products is of what is left of them). Each
// product is off by one unit, one part in 2^46 of the squares that they began with, and what came before by up to 2^10
// times as much behind a mode that only just counts. Exact ones stay below 2^50.4; where modes that only just count
// follow each other, as no picture has them, rounding could take them further, and kMost keeps them in range.
void take_out(Triangle& products, std::size_t k) {
  constexpr Wide kMost = (std::int64_t{1} << 51) - 1;
  for (std::size_t j = k + 1; j < kColumns; ++j) {
    const std::int64_t share = share_q46(products[k][j], products[k][k]);
    for (std::size_t i = k + 1; i <= j; ++i) {
      const Wide part = (Wide{share} * products[k][i] + (Wide{1} << (kShareBits - 1))) >> kShareBits;
      products[i][j] = static_cast<std::int64_t>(std::clamp(products[i][j] - part, -kMost, kMost));
    }
  }
}

// From patches to columns, with zeros, which change no sum, up to a whole number of kTogether. Returns that.
std::size_t fill(std::span<const Patch> patches, std::array<Column, kColumns>& columns) {
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches[i];
    const std::array<std::int32_t, kColumns> row{
        1,         p.x,       p.y,       p.shading, p.x * p.slope_x + p.y * p.slope_y,
        p.empty_x, p.empty_y, p.slope_x, p.slope_y, p.x * p.slope_y - p.y * p.slope_x,
        p.change};
    for (std::size_t k = 0; k < kColumns; ++k) columns[k][i] = row[k];
  }
  const std::size_t n = (patches.size() + kTogether - 1) / kTogether * kTogether;
  for (Column& column : columns) std::fill(column.data() + patches.size(), column.data() + n, 0);
  return n;
}

}  // namespace

Log2Q8 motion(std::span<const Patch> patches, Carried carried, std::int32_t step_um_log2_q8, Saturations& saturations) {
  const std::size_t count = std::min<std::size_t>(patches.size(), kMostPatches);
  if (count < kLeastPatches) return {};
  // So little change is below 33 times the floor of the noise, whatever explains it.
  std::int64_t all = 0;
  for (const Patch& patch : patches.first(count)) all += square(patch.change);
  if (all * (1 << 2 * kChangeShift) <= kTimesNoise * kNoiseFloor) return {};

  std::array<Column, kColumns> columns;  // NOLINT: filled as far as it is read
  const std::size_t n = fill(patches.first(count), columns);
  Triangle products;  // NOLINT: filled below, as far as it is read
  for (std::size_t k = 0; k < kColumns; ++k) {
    for (std::size_t j = k; j < kColumns; j += 2) {
      const std::size_t next = std::min(j + 1, kColumns - 1);
      const auto [with_j, with_next] = dots(columns[k], columns[j], columns[next], n);
      products[k][j] = with_j;
      products[k][next] = with_next;
    }
  }
  const std::int64_t slopes = products[kSlopeX][kSlopeX] + products[kSlopeY][kSlopeY];
  normalise(products);

  std::array<std::int64_t, kModes> whole;  // NOLINT: filled below
  for (std::size_t k = 0; k < kModes; ++k) whole[k] = products[k][k];
  std::int64_t stuck = 0;
  for (std::size_t k = 0; k < kModes; ++k) {
    if (k == kSticks) stuck = products[kChange][kChange];
    if (whole[k] > 0 && products[k][k] * kLeastPart >= whole[k]) take_out(products, k);
  }
  const std::int64_t left = std::max<std::int64_t>(products[kChange][kChange], 0);
  const std::int64_t noise = left / (static_cast<std::int64_t>(count) - kModes) + kNoiseFloor;
  const std::int64_t energy = slopes / 2 + static_cast<std::int64_t>(count) * kSlopeFloor;
  const std::int64_t evidence = stuck - left - kTimesNoise * noise - explained(carried, energy, 4, 1);
  if (evidence <= 0) return {};
  const auto log_of = [](std::int64_t value) { return log2_q8(static_cast<std::uint64_t>(value)); };
  const std::int32_t steps_q8 = (log_of(evidence) - log_of(energy)) / 2 - 256;
  return Log2Q8::saturate(std::max(step_um_log2_q8 + steps_q8, 0), saturations);
}

}  // namespace holdfast::coarse
