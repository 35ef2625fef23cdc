// SPDX-License-Identifier: Apache-2.0
// Learns where the markers rest on the empty gel: the mean of a few still frames.
//
// Averaging 10 frames brings the noise of a rest position from 0.05 px to below 0.02 px (320-px scale), so that it
// does not show as a constant displacement. A frame in which a marker moved starts the mean anew.
// A lattice that is bent is not the empty gel's: something pressed on it while it was learned. What is measured are the
// second differences of the places along rows and columns (RMS, over the pitch). A lens and the print bend a lattice,
// too: by 34 thousandths at most on the empty gel of the recordings (84 clips, 1831 means of ten frames), by up to 80
// on a gel printed to 60 um. Beyond 90 nothing but a load explains it. Price of that limit: it sees 15 of 113 clips
// that begin loaded; 40 would see 59, and refuse every roughly printed gel. Not seen: an object that presses evenly or
// lightly.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>

#include "base/math.hpp"
#include "vision/markers.hpp"

namespace holdfast::reference {

struct Config {
  int frames = 10;                           // 1..100. Price: 40 ms of start-up time each at 25 Hz
  PixelsQ8 still = PixelsQ8::from_raw(192);  // a marker that moved further was touched: 0.75 px, 12 sigma of rest noise
  int follow_frames = 64;                    // of the empty gel, between two steps of follow()
  // A lattice bent by more is refused; 0: none is. Price of less: an empty gel behind a strong lens is refused.
  std::int32_t most_bend_permille = 90;
};

struct State {
  bool known = false;
  bool bent = false;       // the last rest position was refused, and none has been learned since
  bool confirmed = false;  // somebody has said that the gel is empty although it looked bent: refuse nothing
  MarkerField rest;        // valid = this marker has a rest position
  PixelsQ8 pitch;          // mean spacing of neighbours at rest, working image
  int count = 0;
  MarkerField first;  // where each marker was first seen of the frames being averaged; then: rest, as it was learned
  std::array<std::int32_t, kMaxMarkers> sum_x_px_q8{};  // of offsets from `first`: 100 frames * 192 fits 16 bits
  std::array<std::int32_t, kMaxMarkers> sum_y_px_q8{};
  std::array<std::int32_t, kMaxMarkers> seen{};  // frames in which the marker was valid
};

// Mean length of the links between neighbours. 0 when no two neighbours are valid.
// Range: any field. 2 * 128 links of at most 2^21.5 sum to 2^29.5; a mean above the format's 4096 px, two pictures'
// width, is cut to it.
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
  return PixelsQ8::from_raw(
      links == 0 ? 0 : static_cast<std::int32_t>(std::min<std::int64_t>(div_round(sum, links), PixelsQ8::kMax)));
}

// How much the lattice is bent. Range: any field; a second difference is below 2^23, the sum of 2 * 2 * 128 squares
// below 2^55. 0 when no three neighbours are valid.
[[nodiscard]] inline std::int32_t bend_permille(const MarkerField& field) {
  const std::int32_t pitch = pitch_of(field).raw();
  std::int64_t sum = 0;
  std::int64_t terms = 0;
  const auto add = [&](std::int32_t i, std::int32_t step) {
    const Marker& a = field.markers[idx(i)];
    const Marker& b = field.markers[idx(i + step)];
    const Marker& c = field.markers[idx(i + 2 * step)];
    if (!a.valid || !b.valid || !c.valid) return;
    sum += square(a.x.raw() - 2 * b.x.raw() + c.x.raw()) + square(a.y.raw() - 2 * b.y.raw() + c.y.raw());
    terms += 2;
  };
  const GridSize grid = field.grid;
  for (std::int32_t r = 0; r < grid.rows; ++r) {
    for (std::int32_t c = 0; c < grid.cols; ++c) {
      if (c + 2 < grid.cols) add(r * grid.cols + c, 1);
      if (r + 2 < grid.rows) add(r * grid.cols + c, grid.cols);
    }
  }
  if (terms == 0 || pitch == 0) return 0;
  return static_cast<std::int32_t>(std::int64_t{isqrt(static_cast<std::uint64_t>(sum / terms))} * 1000 / pitch);
}

inline void forget(State& state) {
  state.known = state.bent = false;
  state.count = 0;
}

// Takes one frame into the mean; returns true once, with the frame that completes it. A marker that was seen in less
// than half of the frames gets no rest position; one that flickers does not hold the others up.
// Range: any field; up to 100 frames, whose offsets (2^21) fit int32 whatever `still` allows.
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
    rest.valid = seen * 2 >= state.count;
    if (!rest.valid) continue;
    const auto mean = [&](std::int32_t sum) { return static_cast<std::int32_t>(div_round(sum, seen)); };
    rest.x = PixelsQ8::from_raw(rest.x.raw() + mean(state.sum_x_px_q8[idx(i)]));
    rest.y = PixelsQ8::from_raw(rest.y.raw() + mean(state.sum_y_px_q8[idx(i)]));
  }
  state.pitch = pitch_of(state.rest);
  state.bent =
      !state.confirmed && config.most_bend_permille > 0 && bend_permille(state.rest) > config.most_bend_permille;
  state.known = state.pitch.raw() > 0 && !state.bent;
  state.first = state.rest;
  state.count = 0;  // for follow(); or nothing to stand on: the next frame starts anew
  return state.known;
}

// Forgets what follow() has gathered: something touches the gel.
inline void pause(State& state) {
  if (state.known) state.count = 0;
}

// Lets the rest position follow a gel that nobody touches: warmth and a mount that settles move it by hundredths of a
// pixel in a second. Returns true when it moved. A quarter of the mean offset per step and at most 1/32 px, so that a
// touch too light to be noticed is not taken for rest; and never further than a twentieth of a pitch (0.1 mm) from what
// was learned, so that no slow shear can be followed away: then only TARE helps.
// Range: places in a picture, which is a quarter of what PixelsQ8 holds; 64 offsets of any two PixelsQ8 (2^21) fit
// int32.
[[nodiscard]] inline bool follow(State& state, const Config& config, const MarkerField& field) {
  constexpr std::int32_t kMostStep_px_q8 = 8;
  if (!state.known || field.grid != state.rest.grid) return false;
  if (state.count == 0) {
    state.sum_x_px_q8.fill(0);
    state.sum_y_px_q8.fill(0);
    state.seen.fill(0);
  }
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    const Marker& rest = state.rest.markers[idx(i)];
    const Marker& now = field.markers[idx(i)];
    if (!now.valid || !rest.valid) continue;
    state.sum_x_px_q8[idx(i)] += now.x.raw() - rest.x.raw();
    state.sum_y_px_q8[idx(i)] += now.y.raw() - rest.y.raw();
    ++state.seen[idx(i)];
  }
  if (++state.count < config.follow_frames) return false;
  const std::int32_t limit = state.pitch.raw() / 20;
  bool moved = false;
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    Marker& rest = state.rest.markers[idx(i)];
    const Marker& learned = state.first.markers[idx(i)];
    const std::int32_t seen = state.seen[idx(i)];
    if (!rest.valid || seen * 2 < state.count) continue;
    const auto step = [&](PixelsQ8 at, PixelsQ8 origin, std::int32_t sum) {
      const auto mean = static_cast<std::int32_t>(div_round(sum, std::int64_t{4} * seen));
      const std::int32_t to = at.raw() + std::clamp(mean, -kMostStep_px_q8, kMostStep_px_q8);
      return PixelsQ8::from_raw(std::clamp(to, origin.raw() - limit, origin.raw() + limit));
    };
    const PixelsQ8 x = step(rest.x, learned.x, state.sum_x_px_q8[idx(i)]);
    const PixelsQ8 y = step(rest.y, learned.y, state.sum_y_px_q8[idx(i)]);
    moved = moved || x != rest.x || y != rest.y;
    rest.x = x;
    rest.y = y;
  }
  state.count = 0;
  return moved;
}

}  // namespace holdfast::reference
