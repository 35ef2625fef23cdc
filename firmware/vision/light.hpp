// SPDX-License-Identifier: Apache-2.0
// Whether the light is still the one in which learning began: a camera's exposure settles during its first frames.
//
// Of the 200 recordings many begin with a dark frame: mean luma 84, then 110, then 113. A lattice, rest position or
// picture of the empty gel learned there is wrong afterwards. So learning begins anew with the first picture that is
// brighter or darker than the one it began with. Costs no time where the light is steady.
//
// Looks at one pixel in 64, and only while something is being learned.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "vision/luma.hpp"

namespace holdfast::light {

struct Config {
  // Change of the mean luma in percent, and at least one grey level. Price of less: a light touch while the gel is
  // being learned counts as a change of light (learning begins anew for a touch anyway); of more: the last, small step
  // of an exposure that settles is learned.
  std::int32_t most_change_pct = 2;
};

struct State {
  std::int32_t mean_q4 = 0;  // of the picture that learning began with; 0: none yet
  bool changed = false;      // since forget()
};

inline constexpr std::int32_t kStep = 8;  // pixels, both ways

// Range: any picture of at least kStep pixels a side; at most 2^24 pixels are summed, to below 2^32.
[[nodiscard]] inline std::int32_t mean_q4(const LumaView& luma) {
  std::uint32_t sum = 0, count = 0;
  for (std::int32_t y = kStep / 2; y < luma.height; y += kStep) {
    const std::uint8_t* const row = luma.data + std::ptrdiff_t{y} * luma.stride;
    for (std::int32_t x = kStep / 2; x < luma.width; x += kStep) {
      sum += row[x];
      ++count;
    }
  }
  return static_cast<std::int32_t>(std::uint64_t{sum} * 16 / count);
}

inline void forget(State& state) {
  state = {};
}

// False: another light than when learning began. Learning begins with this picture then.
[[nodiscard]] inline bool update(State& state, const Config& config, const LumaView& luma) {
  const std::int32_t now = mean_q4(luma);
  const bool first = state.mean_q4 == 0;
  const std::int32_t most = std::max(16, state.mean_q4 * config.most_change_pct / 100);
  if (!first && std::abs(now - state.mean_q4) <= most) return true;
  state.mean_q4 = now;
  state.changed = state.changed || !first;
  return first;
}

}  // namespace holdfast::light
