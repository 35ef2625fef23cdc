// SPDX-License-Identifier: Apache-2.0
// Learns where the markers rest on the empty gel: the mean of a few still frames.
//
// Averaging 10 frames brings the noise of a rest position from 0.05 px to below 0.02 px (320-px scale), so that it
// does not show as a constant displacement. A frame in which a marker moved starts the mean anew.
// Does not know whether the gel is empty: whoever calls it has said so (start-up, TARE, --reference).
#pragma once

#include <array>
#include <cstdint>
#include <cstdlib>

#include "base/math.hpp"
#include "vision/markers.hpp"

namespace holdfast::reference {

struct Config {
  int frames = 10;                           // 1..100. Price: 40 ms of start-up time each at 25 Hz
  PixelsQ8 still = PixelsQ8::from_raw(192);  // a marker that moved further was touched: 0.75 px, 12 sigma of rest noise
};

struct State {
  bool known = false;
  MarkerField rest;  // valid = this marker has a rest position
  PixelsQ8 pitch;    // mean spacing of neighbours at rest, working image
  int count = 0;
  MarkerField first;                                    // where each marker was first seen of the frames being averaged
  std::array<std::int32_t, kMaxMarkers> sum_x_px_q8{};  // of offsets from `first`: 100 frames * 192 fits 16 bits
  std::array<std::int32_t, kMaxMarkers> sum_y_px_q8{};
  std::array<std::int32_t, kMaxMarkers> seen{};  // frames in which the marker was valid
};

// Mean length of the links between neighbours. 0 when no two neighbours are valid.
// Range: 2 * 128 links of at most 2^20 sum to 2^28.
[[nodiscard]] inline PixelsQ8 pitch_of(const MarkerField& field) {
  std::int64_t sum = 0;
  std::int32_t links = 0;
  const auto add = [&](std::int32_t i, std::int32_t j) {
    const Marker& a = field.markers[idx(i)];
    const Marker& b = field.markers[idx(j)];
    if (!a.valid || !b.valid) return;
    sum += isqrt(static_cast<std::uint64_t>(square(b.x.raw() - a.x.raw()) + square(b.y.raw() - a.y.raw())));
    ++links;
  };
  const GridSize grid = field.grid;
  for (std::int32_t r = 0; r < grid.rows; ++r) {
    for (std::int32_t c = 0; c < grid.cols; ++c) {
      if (c + 1 < grid.cols) add(r * grid.cols + c, r * grid.cols + c + 1);
      if (r + 1 < grid.rows) add(r * grid.cols + c, (r + 1) * grid.cols + c);
    }
  }
  return PixelsQ8::from_raw(links == 0 ? 0 : static_cast<std::int32_t>(div_round(sum, links)));
}

inline void forget(State& state) {
  state.known = false;
  state.count = 0;
}

// Takes one frame into the mean; returns true once, with the frame that completes it. A marker that was seen in less
// than half of the frames gets no rest position; one that flickers does not hold the others up.
[[nodiscard]] inline bool update(State& state, const Config& config, const MarkerField& field) {
  if (state.known) return false;
  bool still = state.count > 0 && state.first.grid == field.grid;
  for (std::int32_t i = 0; still && i < field.grid.count(); ++i) {
    const Marker& first = state.first.markers[idx(i)];
    const Marker& now = field.markers[idx(i)];
    still = !first.valid || !now.valid ||
            (std::abs(now.x.raw() - first.x.raw()) <= config.still.raw() &&
             std::abs(now.y.raw() - first.y.raw()) <= config.still.raw());
  }
  if (!still) {
    state.first = field;
    state.count = 0;
    state.sum_x_px_q8.fill(0);
    state.sum_y_px_q8.fill(0);
    state.seen.fill(0);
  }
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    Marker& first = state.first.markers[idx(i)];
    const Marker& now = field.markers[idx(i)];
    if (!now.valid) continue;
    if (!first.valid) first = now;
    state.sum_x_px_q8[idx(i)] += now.x.raw() - first.x.raw();
    state.sum_y_px_q8[idx(i)] += now.y.raw() - first.y.raw();
    ++state.seen[idx(i)];
  }
  if (++state.count < config.frames) return false;
  state.rest = state.first;
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    Marker& rest = state.rest.markers[idx(i)];
    const std::int32_t seen = state.seen[idx(i)];
    rest.valid = seen * 2 >= state.count && seen > 0;
    if (!rest.valid) continue;
    const auto mean = [&](std::int32_t sum) { return static_cast<std::int32_t>(div_round(sum, seen)); };
    rest.x = PixelsQ8::from_raw(rest.x.raw() + mean(state.sum_x_px_q8[idx(i)]));
    rest.y = PixelsQ8::from_raw(rest.y.raw() + mean(state.sum_y_px_q8[idx(i)]));
  }
  state.pitch = pitch_of(state.rest);
  state.known = state.pitch.raw() > 0;
  if (!state.known) state.count = 0;  // nothing to stand on: the next frame starts anew
  return state.known;
}

}  // namespace holdfast::reference
