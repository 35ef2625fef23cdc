// SPDX-License-Identifier: Apache-2.0
// The paper's four features (section III): mean velocities Vx and Vy, entropy E and its rate.
//
//   Vx = (1/n) sum (Dx(t) - Dx(t-dt)) / dt over the n markers valid in both frames;  Vy likewise
//   E  = entropy of the 15-bin histogram of abs(D) over a fixed range [0, R), last bin takes the overflow
//   dE/dt = (E(t) - E(t-dt)) / dt
// dt comes from timestamps: the sensor delivers 15 to 27 frames a second, whatever its mode says.
// The range is fixed because an automatic one stretches noise over all bins: E = 2.43 +- 0.11 nat at rest.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "base/math.hpp"
#include "tactile/entropy.hpp"
#include "tactile/types.hpp"

namespace holdfast::features {

struct Config {
  // Upper end R of the histogram, um; 500..10000. Price of more: dE/dt of small grips is 0 (a bin is R / 15).
  std::int32_t histogram_range_um = 1900;
  // A longer gap makes rates meaningless: they start again. Must exceed a dropped frame at 15 fps (133 ms).
  Micros max_gap{250'000};
};

struct State {
  bool known = false;  // a frame came before
  Micros last{};
  std::int32_t entropy_q24 = 0;
  DisplacementField field;
};

inline constexpr Micros kMinStep{1'000};  // no camera is faster than 1000 fps; guards the divisions below

// Exact: bin = floor(15 |D| / R) without a root, by comparing squares. Range: D^2 <= 2 * 65535^2 = 8.6e9, times 225
// = 1.9e12; R^2 * 225 = 2.25e10.
[[nodiscard]] inline std::array<std::uint8_t, kHistogramBins> histogram_of(const DisplacementField& field,
                                                                           std::int32_t range_um) {
  std::array<std::uint8_t, kHistogramBins> histogram{};
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    if (!d.valid) continue;
    const std::int64_t scaled = (square(d.dx.raw()) + square(d.dy.raw())) * square(kHistogramBins);
    std::int32_t bin = 0;
    while (bin < kHistogramBins - 1 && scaled >= square(std::int64_t{range_um} * (bin + 1))) ++bin;
    ++histogram[idx(bin)];
  }
  return histogram;
}

// Range: abs(now) < 2^62 us; rates are 0 and marked so unless kMinStep <= now - last <= max_gap.
// Sums: 128 * 131070 um = 1.7e7, times 1e6 us/s = 1.7e13; entropy step 2^27 * 1e6 = 1.3e14: both fit int64.
[[nodiscard]] inline Features update(State& state, const Config& config, const DisplacementField& field, Micros now,
                                     Saturations& saturations) {
  Features out{};
  out.histogram = histogram_of(field, config.histogram_range_um);
  const std::int32_t entropy_q24 = entropy::of_counts_q24(out.histogram);
  out.entropy = NatsQ16::saturate(div_round(entropy_q24, 256), saturations);
  for (const std::uint8_t count : out.histogram) out.markers += count;

  const Micros step = now - state.last;
  const bool same_markers = state.known && state.field.grid == field.grid;
  if (same_markers && step >= kMinStep && step <= config.max_gap) {
    std::int64_t sum_x = 0, sum_y = 0;
    std::int32_t n = 0;
    for (std::int32_t i = 0; i < field.grid.count(); ++i) {
      const MarkerDisplacement& d = field.markers[idx(i)];
      const MarkerDisplacement& before = state.field.markers[idx(i)];
      if (!d.valid || !before.valid) continue;
      sum_x += d.dx.raw() - before.dx.raw();
      sum_y += d.dy.raw() - before.dy.raw();
      ++n;
    }
    if (n > 0) {
      const std::int64_t divisor = n * step.count();
      out.vx = MicrometresPerSec::saturate(div_round(sum_x * 1'000'000, divisor), saturations);
      out.vy = MicrometresPerSec::saturate(div_round(sum_y * 1'000'000, divisor), saturations);
      // Q24 per us -> Q8 per s: times 1e6, divided by 2^16.
      const std::int64_t rise = std::int64_t{entropy_q24} - state.entropy_q24;
      out.entropy_rate = NatsPerSecQ8::saturate(div_round(rise * 1'000'000, step.count() << 16), saturations);
      out.rates_valid = true;
    }
  }
  out.gap = state.known && step > config.max_gap;
  state.known = true;
  state.last = now;
  state.entropy_q24 = entropy_q24;
  // Only the lattice's own: what is behind it is never read, and most of the copy.
  state.field.grid = field.grid;
  std::copy_n(field.markers.begin(), field.grid.count(), state.field.markers.begin());
  return out;
}

inline void forget(State& state) {
  state.known = false;
}

}  // namespace holdfast::features
