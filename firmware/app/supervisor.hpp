// SPDX-License-Identifier: Apache-2.0
// Owns the device's state and what the output lines may say.
//
// GRIP_OK is HIGH in OK only. ALIVE toggles once per accepted frame, so that a receiver can tell a level that is
// still meant from one that a dead process left behind (DESIGN.md, receiver's rule).
// A single rejected frame changes neither state nor lines: ALIVE stands still and the receiver counts its age. After
// `hold` without an accepted frame the state is FAULT with the reason of the last rejection.
#pragma once

#include "app/pipeline.hpp"
#include "base/status.hpp"
#include "base/units.hpp"

namespace holdfast::supervisor {

struct Config {
  // Two frame periods and a dropped frame at 15 fps; the same T as in the receiver's rule.
  Micros hold{150'000};
  // Fewer valid markers than this share of the grid: DEGRADED.
  int degraded_markers_pct = 87;  // 55 of 63
};

struct State {
  DeviceState device = DeviceState::kBoot;
  Reason reason = Reason::kNone;
  bool any_accepted = false;
  Micros last_accepted{};  // or of the start, before the first one
  bool started = false;
};

// What the lines have to say now.
struct Outputs {
  DeviceState state = DeviceState::kBoot;
  Reason reason = Reason::kNone;
  bool slip = false;
  bool grip_ok = false;
  bool accepted = false;  // ALIVE has to change its level
};

[[nodiscard]] inline Outputs outputs_of(const State& state, bool slip, bool accepted) {
  return {state.device, state.reason, slip, state.device == DeviceState::kOk, accepted};
}

// Nothing usable came: rejected frame, timeout or a stream that ended. `why` is kept as the reason.
[[nodiscard]] inline Outputs reject(State& state, const Config& config, Reason why, GripRequest request, Micros now) {
  if (!state.started) {
    state.started = true;
    state.last_accepted = now;
  }
  if (!state.any_accepted || now - state.last_accepted > config.hold || why == Reason::kCameraGone) {
    state.device = DeviceState::kFault;
  }
  state.reason = why;
  return outputs_of(state, request == GripRequest::kTighten, false);
}

[[nodiscard]] inline Outputs update(State& state, const Config& config, const pipeline::Result& result, Micros now) {
  if (!result.quality.ok()) return reject(state, config, result.quality.reason, result.request, now);
  state.started = true;
  state.any_accepted = true;
  state.last_accepted = now;
  if (!result.referenced) {
    state.device = DeviceState::kReference;
    state.reason = Reason::kLearning;
  } else if (result.request == GripRequest::kTighten) {
    state.device = DeviceState::kSlip;
    state.reason = Reason::kSlipDetected;
  } else if (result.features.markers * 100 < result.grid.count() * config.degraded_markers_pct) {
    state.device = DeviceState::kDegraded;
    state.reason = Reason::kFewMarkers;
  } else {
    state.device = DeviceState::kOk;
    state.reason = result.features.gap ? Reason::kTimeGap : Reason::kNone;
  }
  return outputs_of(state, result.request == GripRequest::kTighten, true);
}

}  // namespace holdfast::supervisor
