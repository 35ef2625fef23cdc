// SPDX-License-Identifier: Apache-2.0
// The load on the gel from its displacement field: shear Q along the surface, normal P into it, and friction use Q / P.
// For people and logs: nothing of it goes into the decision.
//
// The gel is a layer of thickness h and shear modulus G, bonded to its base and nearly incompressible. Whatever the
// object's shape and wherever it slips, over the whole surface (k = 0 of the compliance that the simulator's layer.cpp
// has in closed form, and its first order in k)
//   Q = G / h * sum of u dA        n.u n.x summed over dA = P h^2 (4 nu - 1) / (4 (1 - nu) G), n across Q
// The second is the gel that flows out from under the pressure; along Q it would take the shear's own arm with it, so
// it is read across. 63 markers see only a part of that surface, friction under the object holds some of the flow back,
// and the moment lives on what is far out. So the sums are weighted: `kWeights` are the coefficients with the least
// mean error over contacts drawn at random, whose fields are the layer's own (toolchain/generate/load_weights.hpp; no
// contact of the simulator, no friction law). One set is for contacts within the lattice; one for those that go on
// beyond opposite edges of it, like a bar across the gel, of which only the middle is seen.
//
//   shear  = w_x . u, w_y . u
//   normal = w_0 . u + c (w_c . u) + s (w_s . u),  (c, s) = (Qx^2 - Qy^2, 2 Qx Qy) / (Q^2 + (P0 / 5)^2), P0 = w_0 . u
// u enters folded: sums and differences of the four markers that are mirror images, of which each figure reads those of
// its own symmetry.
//
// Weights hold for 7x9 markers 2.02 mm apart on 4.25 mm of 35 kPa, Poisson's ratio 0.49. Of another stiffness every
// force is another by one factor, which a known weight measures (`holdfast calibrate --weight`): until then readings
// are called uncalibrated. A layer 6 % thicker reads 6 % too much shear and 12 % too much normal load, and the same
// factors take that out. Range: displacements below a quarter of the thickness; a gel's large strain is not modelled.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "base/math.hpp"
#include "tactile/load_weights.gen.hpp"
#include "tactile/types.hpp"

namespace holdfast::load {

struct Config {
  std::int32_t pitch_um = 2020;  // as displacement::Config; the weights are for one within kPitchOff of kPitch
  // Of what a gel of 35 kPa would carry, in thousandths, 0 to kMostScalePermille; 0: no weight was used. Where one is
  // known, the other is taken as the same, because both stand on the same stiffness; where none is, as 1000.
  std::int32_t shear_scale_permille = 0;
  std::int32_t normal_scale_permille = 0;
};

inline constexpr std::int32_t kMostScalePermille = 20'000;
inline constexpr std::int32_t kPitch_um = 2020;
inline constexpr std::int32_t kPitchOff_um = 40;
inline constexpr std::int32_t kMostMissing = 8;       // markers; each is taken as its neighbours' mean
inline constexpr std::int32_t kStrained_um = 1060;    // a quarter of the thickness
inline constexpr std::int32_t kLeastNormal_mn = 200;  // below it Q / P is noise over noise

// What a reading stands on. The numbers are sent on the wire.
enum class Basis : std::uint8_t {
  kNone = 0,        // no reading: another lattice or pitch, or too many markers are missing
  kNominal = 1,     // uncalibrated
  kOneWeight = 2,   // for shear or normal load; the other one has its scale
  kTwoWeights = 3,  // for each
};
inline constexpr std::array<std::string_view, 4> kBasisNames{"none", "uncalibrated", "one_weight", "two_weights"};

struct Load {
  Basis basis = Basis::kNone;  // kNone: all below is 0
  // The contact lies within the lattice; false also where hardly any shear tells. Otherwise what it carries outside is
  // estimated at best, and the errors are larger.
  bool within = false;
  bool strained = false;  // a marker moved by more than a quarter of the thickness
  Millinewtons shear_x, shear_y;
  Millinewtons normal;    // may be below 0 by noise
  Permille friction_use;  // Q / P; 0 below kLeastNormal_mn
};

namespace detail {

// Displacements of a lattice for which there are weights, um, without gaps.
struct Field {
  std::array<std::int32_t, kMarkers> x{}, y{};
};

// The mean of the neighbours in the lattice that are seen; 0 where none is.
inline void fill(const DisplacementField& from, std::int32_t at, Field& field) {
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

// What each figure reads. A middle row or column is its own mirror image, and counts twice or not at all.
struct Folded {
  std::array<std::int32_t, kFolded> shear_x{}, shear_y{}, normal{}, diagonal{};
};

// Range: |u| <= 2^16, sums of four below 2^18 + 1.
inline Folded fold(const Field& field) {
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

// How far the contact reaches, from the mean motion along the shear of each edge of the lattice over that of all: 0.1
// to 0.45 at opposite edges where it lies within, 0.6 to 0.9 where it goes on beyond both.
struct Reach {
  std::int32_t across_q8 = 0;  // share of the second set of weights, 0 to 256
  bool within = false;
};

// An eighth of the field's energy belongs to the denominator, because a press without shear has no such direction.
// Range: sums below 2^22.1, 63 energies below 2^45; 9 products of sums and their multiples below 2^50.
inline Reach reach_of(const Field& field) {
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

// Range: 40 products of 2^18 and 2^20 (static_assert below): below 2^43.4; in mN below 2^27.4.
inline std::int64_t weighted_mn(const std::array<std::int32_t, kFolded>& weights,
                                const std::array<std::int32_t, kFolded>& folded) {
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < kFolded; ++i) sum += std::int64_t{weights[i]} * folded[i];
  return div_round(sum, 1 << 16);
}

struct Forces {
  std::int64_t shear_x = 0, shear_y = 0, normal = 0;  // mN
};

// The direction of the shear as (cos, sin) of twice its angle, Q12, shorter where there is little of it.
struct Direction {
  std::int32_t c_q12 = 0, s_q12 = 0;
};
// Range: what is beyond +-2^20 mN counts as that; squares below 2^41, Q12 2^53. 10 mN: noise has no direction.
inline Direction direction_of(const Forces& rough) {
  constexpr std::int64_t kMost = 1 << 20;
  const std::int64_t x = std::clamp(rough.shear_x, -kMost, kMost), y = std::clamp(rough.shear_y, -kMost, kMost);
  const std::int64_t p = std::clamp(rough.normal, -kMost, kMost) / 5;
  const std::int64_t whole = x * x + y * y + p * p + 100;
  return {static_cast<std::int32_t>((x * x - y * y) * 4096 / whole), static_cast<std::int32_t>(x * y * 8192 / whole)};
}

[[nodiscard]] inline Forces forces(const Weights& weights, const Folded& folded) {
  Forces out{weighted_mn(weights.shear_x, folded.shear_x), weighted_mn(weights.shear_y, folded.shear_y),
             weighted_mn(weights.normal, folded.normal)};
  const Direction along = direction_of(out);
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

}  // namespace detail

// Range: forces below 2^28 before the scale, 2^43 behind it; what leaves +-32.767 N is clamped and counted.
[[nodiscard]] inline Load update(const Config& config, const DisplacementField& field, Saturations& saturations) {
  Load out;
  if (field.grid != GridSize{kRows, kCols} || std::abs(config.pitch_um - kPitch_um) > kPitchOff_um) return out;
  detail::Field u;
  std::int32_t missing = 0;
  for (std::int32_t i = 0; i < kMarkers; ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    u.x[idx(i)] = d.dx.raw();
    u.y[idx(i)] = d.dy.raw();
    if (d.valid) {
      out.strained = out.strained || square(d.dx.raw()) + square(d.dy.raw()) > square(kStrained_um);
    } else {
      ++missing;
      detail::fill(field, i, u);
    }
  }
  if (missing > kMostMissing) return {};
  const bool by_shear = config.shear_scale_permille != 0, by_normal = config.normal_scale_permille != 0;
  out.basis = by_shear && by_normal ? Basis::kTwoWeights : by_shear || by_normal ? Basis::kOneWeight : Basis::kNominal;
  const detail::Folded folded = detail::fold(u);
  const detail::Reach reach = detail::reach_of(u);
  out.within = reach.within;
  detail::Forces f{};
  if (reach.across_q8 < 256) f = detail::forces(kWeights[0], folded);
  if (reach.across_q8 > 0) {
    const detail::Forces across = detail::forces(kWeights[1], folded);
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
    const std::int64_t shear_mn =
        isqrt(static_cast<std::uint64_t>(square(out.shear_x.raw()) + square(out.shear_y.raw())));
    out.friction_use = Permille::saturate(div_round(shear_mn * 1000, out.normal.raw()), saturations);
  }
  return out;
}

}  // namespace holdfast::load
