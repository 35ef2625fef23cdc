// SPDX-License-Identifier: Apache-2.0
#include "tactile/load.hpp"

#include <algorithm>
#include <cstdlib>

#include "base/math.hpp"

namespace holdfast::load {

namespace detail {

Folded fold(const Field& field) {
  Folded out;
  std::size_t i = 0;
  for (std::int32_t row = 0; row < kHalfRows; ++row) {
    for (std::int32_t col = 0; col < kHalfCols; ++col, ++i) {
      const std::size_t a = idx(row * kCols + col), b = idx(row * kCols + kCols - 1 - col);
      const std::size_t d = idx((kRows - 1 - row) * kCols + col), e = idx((kRows - 1 - row) * kCols + kCols - 1 - col);
      const auto& x = field.x;
      const auto& y = field.y;
      out.shear_x[i] = x[a] + x[b] + x[d] + x[e];
      out.shear_x[kQuarter + i] = y[a] - y[b] - y[d] + y[e];
      out.shear_y[i] = x[a] - x[b] - x[d] + x[e];
      out.shear_y[kQuarter + i] = y[a] + y[b] + y[d] + y[e];
      out.normal[i] = x[b] - x[a] + x[e] - x[d];
      out.normal[kQuarter + i] = y[d] + y[e] - y[a] - y[b];
      out.diagonal[i] = x[d] + x[e] - x[a] - x[b];
      out.diagonal[kQuarter + i] = y[b] - y[a] + y[e] - y[d];
    }
  }
  return out;
}

Reach reach_of(const Field& field) {
  std::int64_t sx = 0, sy = 0, energy = 0;
  std::array<std::int64_t, 4> ex{}, ey{};  // left, right, top, bottom
  for (std::int32_t row = 0, i = 0; row < kRows; ++row) {
    for (std::int32_t col = 0; col < kCols; ++col, ++i) {
      const std::int64_t x = field.x[idx(i)], y = field.y[idx(i)];
      sx += x;
      sy += y;
      energy += x * x + y * y;
      const std::array<bool, 4> at{col == 0, col == kCols - 1, row == 0, row == kRows - 1};
      for (std::size_t k = 0; k < at.size(); ++k) {
        ex[k] += at[k] ? x : 0;
        ey[k] += at[k] ? y : 0;
      }
    }
  }
  const auto along = [&](std::size_t k) { return (ex[k] * sx + ey[k] * sy) * (k < 2 ? kCols : kRows); };
  // 2 um a marker: the tracker's noise.
  const std::int64_t shear = sx * sx + sy * sy, rest = kMarkers * energy / 8 + square(2 * kMarkers);
  const std::int64_t whole = shear + rest;
  const std::int64_t both = std::max(std::min(along(0), along(1)), std::min(along(2), along(3)));
  const std::int64_t one = std::max({along(0), along(1), along(2), along(3)});
  Reach out;
  // 0.40 to 0.65.
  out.across_q8 = static_cast<std::int32_t>(std::clamp<std::int64_t>((both * 1024 - whole * 410) / whole, 0, 256));
  out.within = shear > rest && out.across_q8 == 0 && one * 5 < whole * 4;
  return out;
}

// 10 mN: noise has no direction.
Direction direction_of(const Forces& rough) {
  constexpr std::int64_t kMost = 1 << 20;
  const std::int64_t x = std::clamp(rough.shear_x, -kMost, kMost), y = std::clamp(rough.shear_y, -kMost, kMost);
  const std::int64_t p = std::clamp(rough.normal, -kMost, kMost) / 5;
  const std::int64_t whole = x * x + y * y + p * p + 100;
  return {static_cast<std::int32_t>((x * x - y * y) * 4096 / whole), static_cast<std::int32_t>(x * y * 8192 / whole)};
}

}  // namespace detail

namespace {

using detail::Direction;
using detail::Field;
using detail::Folded;
using detail::Forces;
using detail::Reach;

// The mean of the neighbours in the lattice that are seen; 0 where none is.
void fill(const DisplacementField& from, std::int32_t at, Field& field) {
  const std::int32_t row = at / kCols, col = at % kCols;
  std::int32_t sx = 0, sy = 0, n = 0;
  for (std::int32_t r = std::max(row - 1, 0); r <= std::min(row + 1, kRows - 1); ++r) {
    for (std::int32_t c = std::max(col - 1, 0); c <= std::min(col + 1, kCols - 1); ++c) {
      const MarkerDisplacement& d = from.markers[idx(r * kCols + c)];
      if (!d.valid) continue;
      sx += d.dx.raw();
      sy += d.dy.raw();
      ++n;
    }
  }
  if (n == 0) return;
  field.x[idx(at)] = sx / n;
  field.y[idx(at)] = sy / n;
}

// Range: 40 products of 2^18 and 2^20 (static_assert below): below 2^43.4; in mN below 2^27.4.
std::int64_t weighted_mn(const std::array<std::int32_t, kFolded>& weights,
                         const std::array<std::int32_t, kFolded>& folded) {
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < kFolded; ++i) sum += std::int64_t{weights[i]} * folded[i];
  return div_round(sum, 1 << 16);
}

Forces forces(const Weights& weights, const Folded& folded) {
  Forces out{weighted_mn(weights.shear_x, folded.shear_x), weighted_mn(weights.shear_y, folded.shear_y),
             weighted_mn(weights.normal, folded.normal)};
  const Direction along = detail::direction_of(out);
  out.normal += div_round(along.c_q12 * weighted_mn(weights.normal_c, folded.normal) +
                              along.s_q12 * weighted_mn(weights.normal_s, folded.diagonal),
                          4096);
  return out;
}

constexpr bool fits(const Weights& weights) {
  for (const auto* part : {&weights.shear_x, &weights.shear_y, &weights.normal, &weights.normal_c, &weights.normal_s}) {
    for (const std::int32_t w : *part) {
      if (w < -(1 << 20) || w > 1 << 20) return false;
    }
  }
  return true;
}
static_assert(fits(kWeights[0]) && fits(kWeights[1]));

}  // namespace

std::int64_t shear_mn(const Load& load) {
  return isqrt(static_cast<std::uint64_t>(square(load.shear_x.raw()) + square(load.shear_y.raw())));
}

Load update(const Config& config, const DisplacementField& field, Saturations& saturations) {
  Load out;
  if (field.grid != GridSize{kRows, kCols} || std::abs(config.pitch_um - kPitch_um) > kPitchOff_um) return out;
  Field u;
  std::int32_t missing = 0;
  for (std::int32_t i = 0; i < kMarkers; ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    if (d.valid) {
      u.x[idx(i)] = d.dx.raw();
      u.y[idx(i)] = d.dy.raw();
      out.strained = out.strained || square(d.dx.raw()) + square(d.dy.raw()) > square(kStrained_um);
    } else {
      ++missing;
      fill(field, i, u);
    }
  }
  if (missing > kMostMissing) return {};
  const bool by_shear = config.shear_scale_permille != 0, by_normal = config.normal_scale_permille != 0;
  out.basis = by_shear && by_normal ? Basis::kTwoWeights : by_shear || by_normal ? Basis::kOneWeight : Basis::kNominal;
  const Folded folded = detail::fold(u);
  const Reach reach = detail::reach_of(u);
  out.within = reach.within;
  Forces f{};
  if (reach.across_q8 < 256) f = forces(kWeights[0], folded);
  if (reach.across_q8 > 0) {
    const Forces across = forces(kWeights[1], folded);
    const auto mix = [&](std::int64_t a, std::int64_t b) {
      return div_round(a * (256 - reach.across_q8) + b * reach.across_q8, 256);
    };
    f = {mix(f.shear_x, across.shear_x), mix(f.shear_y, across.shear_y), mix(f.normal, across.normal)};
  }
  const std::int32_t one = by_shear ? config.shear_scale_permille : by_normal ? config.normal_scale_permille : 1000;
  const std::int32_t normal_scale = by_normal ? config.normal_scale_permille : one;
  const auto scaled = [&](std::int64_t mn, std::int32_t scale) {
    return Millinewtons::saturate(div_round(mn * scale, 1000), saturations);
  };
  out.shear_x = scaled(f.shear_x, one);
  out.shear_y = scaled(f.shear_y, one);
  out.normal = scaled(f.normal, normal_scale);
  if (out.normal.raw() >= kLeastNormal_mn) {
    out.friction_use = Permille::saturate(div_round(shear_mn(out) * 1000, out.normal.raw()), saturations);
  }
  return out;
}

}  // namespace holdfast::load
