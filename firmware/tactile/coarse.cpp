// SPDX-License-Identifier: Apache-2.0
#include "tactile/coarse.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdlib>

#include "base/math.hpp"

namespace holdfast::coarse {
namespace {

// Vectors are scaled until their largest component has 20 bits: sums of 320 products stay below 2^49, and 1/2^20 of it
// is what rounding costs.
constexpr int kBits = 20;
// The part of a mode that no earlier mode has counts as none below 1/32 of its length.
constexpr std::int64_t kLeastPart = 32 * 32;

// Levels of `change`, in 1/3200.
constexpr int kChangeShift = 3;
constexpr std::int64_t kChangeUnit = 3200;
constexpr std::int64_t kSlopeUnit = 1600;  // both pictures added
static_assert(kChangeUnit == 2 * kSlopeUnit, "the difference of their logarithms is 1");
constexpr std::int64_t kNoiseFloor = kChangeUnit * kChangeUnit / 50;  // 0.02 levels^2
constexpr std::int64_t kSlopeFloor = kSlopeUnit * kSlopeUnit / 100;   // 0.01 (levels / step)^2
constexpr std::int64_t kTimesNoise = 33;
constexpr int kSlips = 3;

// `n` of all these is a whole number of kTogether, which leaves compilers no rest to do one by one.
std::int64_t dot(const Vector& a, const Vector& b, std::size_t n) {
  std::int64_t sum = 0;
#pragma GCC unroll 4
  for (std::size_t i = 0; i < n / kTogether * kTogether; ++i) sum += std::int64_t{a[i]} * b[i];
  return sum;
}

// By how many bits it was shifted to the left.
int scale(Vector& v, std::size_t n) {
  std::uint32_t bits = 0;
#pragma GCC unroll 4
  for (std::size_t i = 0; i < n / kTogether * kTogether; ++i) bits |= static_cast<std::uint32_t>(std::abs(v[i]));
  if (bits == 0) return 0;
  const int shift = kBits - static_cast<int>(std::bit_width(bits));
#pragma GCC unroll 4
  for (std::size_t i = 0; i < n / kTogether * kTogether; ++i) {
    v[i] = shift >= 0 ? v[i] * (1 << shift) : (v[i] + (1 << (-shift - 1))) >> -shift;
  }
  return shift;
}

// Takes out of `v` what lies along `mode`, whose square is `norm`. The quotient keeps as many bits as 62 have room for.
// Range: norm at least 2^38, so the quotient stays below 2^24 and its products below 2^45; `along` below 2^51 leaves
// room for 11 bits at least.
void take_out(Vector& v, const Vector& mode, std::int64_t norm, std::size_t n) {
  const std::int64_t along = dot(v, mode, n);
  const int room = std::countl_zero(static_cast<std::uint64_t>(std::abs(along)) | 1) - 2;
  const auto share = static_cast<std::int32_t>(along * (std::int64_t{1} << room) / norm);
  subtract(v, mode, share, room, n);
}

// The modes that stick, then those that slip.
void fill(std::span<const Patch> patches, std::array<Vector, kModes>& modes) {
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches[i];
    const std::array<std::int32_t, kModes> row{
        1,         p.x,       p.y,       p.shading, p.x * p.slope_x + p.y * p.slope_y,
        p.empty_x, p.empty_y, p.slope_x, p.slope_y, p.x * p.slope_y - p.y * p.slope_x};
    for (std::size_t k = 0; k < kModes; ++k) modes[k][i] = row[k];
  }
}

}  // namespace

void subtract_scalar(Vector& v, const Vector& mode, std::int32_t share, int room, std::size_t n) {
  const std::int64_t half = std::int64_t{1} << (room - 1);
  for (std::size_t i = 0; i < n; ++i) {
    v[i] -= static_cast<std::int32_t>((std::int64_t{share} * mode[i] + half) >> room);
  }
}

Log2Q8 motion(std::span<const Patch> patches, Carried carried, std::int32_t step_um_log2_q8, Saturations& saturations) {
  const std::size_t count = std::min<std::size_t>(patches.size(), kMostPatches);
  if (count < kLeastPatches) return {};
  // So little change is below 33 times the floor of the noise, whatever explains it.
  std::int64_t all = 0;
  for (const Patch& patch : patches.first(count)) all += square(patch.change);
  if (all * (1 << 2 * kChangeShift) <= kTimesNoise * kNoiseFloor) return {};
  std::array<Vector, kModes> modes;  // NOLINT: filled as far as it is read
  fill(patches.first(count), modes);
  Vector change;  // NOLINT: likewise
  std::int64_t slopes = 0;
  for (std::size_t i = 0; i < count; ++i) {
    change[i] = patches[i].change * (1 << kChangeShift);
    slopes += square(patches[i].slope_x) + square(patches[i].slope_y);
  }

  // Zeros change no sum.
  const std::size_t n = (count + kTogether - 1) / kTogether * kTogether;
  for (Vector& mode : modes) std::fill(mode.data() + count, mode.data() + n, 0);
  std::fill(change.data() + count, change.data() + n, 0);

  // Gram and Schmidt, one mode after the other out of all that follow.
  std::array<std::int64_t, kModes> length{};
  for (std::size_t k = 0; k < kModes; ++k) {
    scale(modes[k], n);
    length[k] = dot(modes[k], modes[k], n);
  }
  std::int64_t stuck = 0;
  for (std::size_t k = 0; k < kModes; ++k) {
    if (k == kModes - kSlips) stuck = dot(change, change, n);
    if (length[k] == 0) continue;
    std::int64_t norm = dot(modes[k], modes[k], n);
    if (norm * kLeastPart < length[k]) continue;
    const int shift = scale(modes[k], n);
    norm = shift >= 0 ? norm << (2 * shift) : dot(modes[k], modes[k], n);
    take_out(change, modes[k], norm, n);
    for (std::size_t later = k + 1; later < kModes; ++later) {
      if (length[later] > 0) take_out(modes[later], modes[k], norm, n);
    }
  }
  const std::int64_t left = dot(change, change, n);
  const std::int64_t noise = left / (static_cast<std::int64_t>(count) - kModes) + kNoiseFloor;
  const std::int64_t energy = slopes / 2 + static_cast<std::int64_t>(count) * kSlopeFloor;
  const std::int64_t evidence = stuck - left - kTimesNoise * noise - explained(carried, energy, 4, 1);
  if (evidence <= 0) return {};
  const auto log_of = [](std::int64_t value) { return log2_q8(static_cast<std::uint64_t>(value)); };
  const std::int32_t steps_q8 = (log_of(evidence) - log_of(energy)) / 2 - 256;
  return Log2Q8::saturate(std::max(step_um_log2_q8 + steps_q8, 0), saturations);
}

}  // namespace holdfast::coarse
