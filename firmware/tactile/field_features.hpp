// SPDX-License-Identifier: Apache-2.0
// The shape of the displacement field, and of its flow over the last tenth of a second.
//
// The paper's four features see how much the gel is sheared. What tells slip from a firm grip under the same load is
// how the field is shaped and how it changes: the contact's edge lets go first, so the part of the gel that follows the
// object shrinks, the field departs from a rigid motion (Dong et al. 2018, incipient slip on GelSlim), and when all of
// it lets go the flow stops or turns while the object moves on.
//
//   m = mean of D,  w = best small rotation about the markers' centre,  residual^2 = mean |D - m - w x g|^2
//   evenness = (sum |D|)^2 / (n sum |D|^2): the share of the gel that takes part (a participation ratio)
//   octave entropy = the paper's entropy over bins of half an octave from 8 um: one factor on all D moves it between
//     bins as a whole, so load alone changes it little
//   flow = (D(t) - D(t - lag)) / lag, lag = the youngest field that is at least kLag old: one frame's difference of
//     markers that jitter by 1 to 3 um would be noise
//   dilation = (sum g . D) / (sum g . g), the even part of the field's strain
//   easing = largest closing rate of late, fading as 1 / (1 + dt / kFade)
// g are the places in the printed lattice: a registration turned by a few degrees costs that cosine.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

#include "base/math.hpp"
#include "tactile/entropy.hpp"
#include "tactile/types.hpp"

namespace holdfast::field_features {

struct Config {
  std::int32_t pitch_um = 2020;  // 1000..5000, as displacement::Config
  Micros max_gap{250'000};       // as features::Config
};

inline constexpr Micros kLag{100'000};
inline constexpr Micros kFade{300'000};
// Fields are kept at most this often: eighteen reach back two lags at any rate up to 250 frames a second.
inline constexpr Micros kKeepEvery{12'000};
inline constexpr int kKept = 18;

struct State {
  struct Past {
    Micros at{};
    std::int32_t residual_um_q4 = 0;
    DisplacementField field;
  };
  std::array<Past, kKept> past{};  // a ring
  int count = 0;                   // fields kept, at most kKept
  int newest = 0;
  bool known = false;  // a frame came before
  Micros last{};
  std::int32_t easing_ppm_s = 0;
};

inline void forget(State& state) {
  state.count = 0;
  state.known = false;
  state.easing_ppm_s = 0;
}

namespace detail {

// Vectors on the lattice, um. |dx|, |dy| <= 2^17.
struct Vectors {
  GridSize grid;
  std::array<std::int32_t, kMaxMarkers> dx{}, dy{};
  std::array<bool, kMaxMarkers> valid{};
};

inline Vectors vectors_of(const DisplacementField& field) {
  Vectors out;
  out.grid = field.grid;
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    out.valid[idx(i)] = d.valid;
    out.dx[idx(i)] = d.dx.raw();
    out.dy[idx(i)] = d.dy.raw();
  }
  return out;
}

inline Vectors difference(const DisplacementField& now, const DisplacementField& before) {
  Vectors out;
  out.grid = now.grid;
  for (std::int32_t i = 0; i < now.grid.count(); ++i) {
    const MarkerDisplacement& a = now.markers[idx(i)];
    const MarkerDisplacement& b = before.markers[idx(i)];
    out.valid[idx(i)] = a.valid && b.valid;
    out.dx[idx(i)] = a.dx.raw() - b.dx.raw();
    out.dy[idx(i)] = a.dy.raw() - b.dy.raw();
  }
  return out;
}

// Shape of a field of vectors.
struct Shape {
  std::int32_t n = 0;
  std::int32_t shift_q4 = 0;         // um
  std::int32_t reach = 0;            // um
  std::int32_t spread_q4 = 0;        // um, RMS about the mean
  std::int32_t residual_q4 = 0;      // um, RMS about the best rigid motion
  std::int32_t evenness_q10 = 1024;  // nothing moves: all alike
  std::int64_t dilation_ppm = 0;
};

// Range: any field, with n <= 128, |d| <= 2^17.5 and |g| <= 2^7 (half pitches; 128 in one line): n sum g.d and the
// product of the sums <= 2^7 * 2^7 * 2^24.5 = 2^38.5 each; both times 2e6 2^60.5. (sum |d| Q4)^2 <= (2^7 * 2^21.5)^2 =
// 2^57, times 4 2^59. About the mean |u| Q4 <= 2^22.5: sum of squares 2^52, and the best rotation, being a
// least-squares fit, leaves no more but its rounding.
inline Shape shape_of(const Vectors& v, std::int32_t pitch_um) {
  Shape out;
  const std::int32_t cols = v.grid.cols, rows = v.grid.rows;
  std::int64_t sx = 0, sy = 0, gx_sum = 0, gy_sum = 0, gg = 0, cross = 0, dot = 0, squares = 0, lengths_q4 = 0;
  std::array<std::int32_t, 3> largest{};
  const auto place = [&](std::int32_t i) {
    const std::int32_t row = i / cols;
    return std::array<std::int32_t, 2>{2 * (i - row * cols) - (cols - 1), 2 * row - (rows - 1)};
  };
  for (std::int32_t i = 0; i < v.grid.count(); ++i) {
    if (!v.valid[idx(i)]) continue;
    const std::int64_t dx = v.dx[idx(i)], dy = v.dy[idx(i)];
    const auto [gx, gy] = place(i);
    ++out.n;
    sx += dx;
    sy += dy;
    gx_sum += gx;
    gy_sum += gy;
    gg += gx * gx + gy * gy;
    cross += gx * dy - gy * dx;
    dot += gx * dx + gy * dy;
    const std::int64_t length_2 = dx * dx + dy * dy;
    squares += length_2;
    std::int32_t length_q4 = static_cast<std::int32_t>(isqrt(static_cast<std::uint64_t>(length_2) << 8));
    lengths_q4 += length_q4;
    for (std::int32_t& place_held : largest) {
      if (length_q4 > place_held) std::swap(length_q4, place_held);
    }
  }
  if (out.n == 0) return out;
  const std::int64_t n = out.n;
  out.reach = static_cast<std::int32_t>(div_round(largest[2], 16));
  out.shift_q4 =
      static_cast<std::int32_t>(div_round(isqrt(static_cast<std::uint64_t>(square(sx) + square(sy)) << 8), n));
  if (squares > 0) out.evenness_q10 = static_cast<std::int32_t>(square(lengths_q4) * 4 / (n * squares));

  // Moments about the centre, times n.
  const std::int64_t arm = n * gg - square(gx_sum) - square(gy_sum);
  const std::int64_t twist = n * cross - (gx_sum * sy - gy_sum * sx);
  const std::int64_t opening = n * dot - (gx_sum * sx + gy_sum * sy);
  std::int64_t w_q8 = 0;  // um per half pitch
  if (arm > 0) {
    w_q8 = div_round(twist * 256, arm);
    out.dilation_ppm = div_round(opening * 2'000'000, arm) / pitch_um;
  }
  const std::int64_t mx_q4 = div_round(sx * 16, n), my_q4 = div_round(sy * 16, n);
  const std::int64_t gx_mean_q4 = div_round(gx_sum * 16, n), gy_mean_q4 = div_round(gy_sum * 16, n);
  std::int64_t about_mean = 0, about_rigid = 0;
  for (std::int32_t i = 0; i < v.grid.count(); ++i) {
    if (!v.valid[idx(i)]) continue;
    const auto [gx, gy] = place(i);
    const std::int64_t ux = std::int64_t{v.dx[idx(i)]} * 16 - mx_q4;
    const std::int64_t uy = std::int64_t{v.dy[idx(i)]} * 16 - my_q4;
    about_mean += ux * ux + uy * uy;
    about_rigid +=
        square(ux + ((w_q8 * (gy * 16 - gy_mean_q4)) >> 8)) + square(uy - ((w_q8 * (gx * 16 - gx_mean_q4)) >> 8));
  }
  out.spread_q4 = static_cast<std::int32_t>(isqrt(static_cast<std::uint64_t>(about_mean / n)));
  out.residual_q4 = static_cast<std::int32_t>(isqrt(static_cast<std::uint64_t>(about_rigid / n)));
  return out;
}

// Cosine between two fields, over the markers valid in both; 0 when one of them does not move.
// Range: sums of products <= 2^7 * 2^35 = 2^42, norms Q4 <= 2^25: 2^42 * 2^18 = 2^60.
inline std::int32_t cosine_q10(const Vectors& a, const Vectors& b) {
  std::int64_t dot = 0, aa = 0, bb = 0;
  for (std::int32_t i = 0; i < a.grid.count(); ++i) {
    if (!a.valid[idx(i)] || !b.valid[idx(i)]) continue;
    const std::int64_t ax = a.dx[idx(i)], ay = a.dy[idx(i)], bx = b.dx[idx(i)], by = b.dy[idx(i)];
    dot += ax * bx + ay * by;
    aa += ax * ax + ay * ay;
    bb += bx * bx + by * by;
  }
  const std::int64_t norms_q8 =
      std::int64_t{isqrt(static_cast<std::uint64_t>(aa) << 8)} * isqrt(static_cast<std::uint64_t>(bb) << 8);
  if (norms_q8 == 0) return 0;
  return static_cast<std::int32_t>(std::clamp<std::int64_t>(div_round(dot << 18, norms_q8), -1024, 1024));
}

// Bin 0: below 8 um, the tracker's noise. Bin k: |D|^2 in [64 * 2^(k-1), 64 * 2^k) um^2; the last takes the rest, from
// 0.72 mm on.
inline std::array<std::uint8_t, kHistogramBins> octaves_of(const Vectors& v) {
  std::array<std::uint8_t, kHistogramBins> histogram{};
  for (std::int32_t i = 0; i < v.grid.count(); ++i) {
    if (!v.valid[idx(i)]) continue;
    const auto length_2 = static_cast<std::uint64_t>(square(v.dx[idx(i)]) + square(v.dy[idx(i)]));
    ++histogram[std::min<std::size_t>(static_cast<std::size_t>(std::bit_width(length_2 >> 6)), kHistogramBins - 1)];
  }
  return histogram;
}

// The youngest kept field that is at least kLag older than `than`; nullptr: none.
inline const State::Past* lag_before(const State& state, Micros than) {
  for (int back = 0; back < state.count; ++back) {
    const State::Past& past = state.past[idx((state.newest - back + kKept) % kKept)];
    if (than - past.at >= kLag) return &past;
  }
  return nullptr;
}

}  // namespace detail

// Range: as features::update, which decides what a gap is: `now` runs forward.
[[nodiscard]] inline FieldFeatures update(State& state, const Config& config, const DisplacementField& field,
                                          Micros now, Saturations& saturations) {
  if (state.known && (now - state.last > config.max_gap || now <= state.last)) forget(state);
  FieldFeatures out{};
  const detail::Vectors displacement = detail::vectors_of(field);
  const detail::Shape shape = detail::shape_of(displacement, config.pitch_um);
  out.shift = Micrometres::saturate(div_round(shape.shift_q4, 16), saturations);
  out.reach = Micrometres::saturate(shape.reach, saturations);
  out.residual = MicrometresQ4::saturate(shape.residual_q4, saturations);
  // 2 um on both: noise over noise is nothing.
  const auto log_of = [](std::int32_t um_q4) { return log2_q8(static_cast<std::uint64_t>(um_q4) + 32); };
  out.unevenness = Log2Q8::saturate(log_of(shape.residual_q4) - log_of(shape.shift_q4), saturations);
  out.evenness = ShareQ10::saturate(shape.evenness_q10, saturations);
  out.octave_entropy =
      NatsQ16::saturate(div_round(entropy::of_counts_q24(detail::octaves_of(displacement)), 256), saturations);

  const Micros step = state.known ? now - state.last : Micros{0};
  state.easing_ppm_s =
      static_cast<std::int32_t>(std::int64_t{state.easing_ppm_s} * kFade.count() / (kFade + step).count());
  if (const State::Past* const earlier = detail::lag_before(state, now)) {
    const std::int64_t lag_us = (now - earlier->at).count();
    const detail::Vectors flow = detail::difference(field, earlier->field);
    const detail::Shape moved = detail::shape_of(flow, config.pitch_um);
    const auto speed = [&](std::int64_t um_q4) {
      return MicrometresPerSec::saturate(div_round(um_q4 * 1'000'000, lag_us * 16), saturations);
    };
    out.residual_rate = speed(shape.residual_q4 - earlier->residual_um_q4);
    out.flow_shift = speed(moved.shift_q4);
    out.flow_spread = speed(moved.spread_q4);
    out.flow_residual = speed(moved.residual_q4);
    out.flow_evenness = ShareQ10::saturate(moved.evenness_q10, saturations);
    out.flow_along = ShareQ10::saturate(detail::cosine_q10(flow, displacement), saturations);
    // Range: the most is two neighbours that part by 2 * 185 mm at a pitch of 1 mm, 3.8e8 ppm; times 1e6 below 2^49.
    out.dilation_rate = StrainPpmPerSec::saturate(div_round(moved.dilation_ppm * 1'000'000, lag_us), saturations);
    state.easing_ppm_s = std::max(state.easing_ppm_s, -out.dilation_rate.raw());
    if (const State::Past* const before = detail::lag_before(state, earlier->at)) {
      const detail::Vectors flow_before = detail::difference(earlier->field, before->field);
      out.flow_steady = ShareQ10::saturate(detail::cosine_q10(flow, flow_before), saturations);
    }
  }
  out.easing = StrainPpmPerSec::from_raw(state.easing_ppm_s);

  if (state.count == 0 || now - state.past[idx(state.newest)].at >= kKeepEvery) {
    state.newest = (state.newest + 1) % kKept;
    state.count = std::min(state.count + 1, kKept);
    state.past[idx(state.newest)] = {now, shape.residual_q4, field};
  }
  state.known = true;
  state.last = now;
  return out;
}

}  // namespace holdfast::field_features
