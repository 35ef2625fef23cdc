// SPDX-License-Identifier: Apache-2.0
// Turns one verdict per frame into a steady grip request.
//
// Raises with the `raise_frames`-th slip in a row, or at once where the model needs no second frame; drops with the
// first frame in which the slip does not go on (classifier::goes_on) and that comes `hold` or more after the last one
// in which it did. "In a row" counts frames, not time: a gap neither ends a run nor lengthens it, because the frames on
// both sides of it said slip and to tighten is the safe side. Range: now may jump by hours; where it steps back, a
// raised request lasts for `hold` from then on. Does not judge frame quality (supervisor) and knows no pins (board).
#pragma once

#include <algorithm>
#include <cstdint>

#include "base/units.hpp"
#include "slip/tree_io.hpp"

namespace holdfast {

enum class GripRequest : std::uint8_t { kHold, kTighten };

namespace decision {

struct Config {
  int raise_frames = 2;  // price: one frame of delay each (40 ms at 25 fps); 1 passes every flicker on
  Micros hold{200'000};  // price: how long a grip stays tightened after a false alarm
};

struct State {
  int run = 0;         // slips in a row, counted up to raise_frames
  Micros last_slip{};  // or the last frame in which it went on
  bool raised = false;
};

// `goes_on`: a slip that was raised before has not ended with this frame; says nothing otherwise.
[[nodiscard]] constexpr GripRequest update(State& state, const Config& config, Verdict verdict, Micros now,
                                           bool goes_on = false) {
  state.last_slip = std::min(state.last_slip, now);
  if (verdict != Verdict::kHold) {
    if (state.run < config.raise_frames) ++state.run;
    state.last_slip = now;
    state.raised = state.raised || verdict == Verdict::kSlipNow || state.run >= config.raise_frames;
  } else {
    state.run = 0;
    if (state.raised && goes_on) state.last_slip = now;
    state.raised = state.raised && now - state.last_slip < config.hold;
  }
  return state.raised ? GripRequest::kTighten : GripRequest::kHold;
}

}  // namespace decision
}  // namespace holdfast
