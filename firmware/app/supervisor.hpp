// SPDX-License-Identifier: Apache-2.0
// Owns the device's state and what the output lines may say.
//
// GRIP_OK is HIGH in OK only. ALIVE toggles once per accepted frame, so that a receiver can tell a level that is
// still meant from one that a dead process left behind (DESIGN.md, receiver's rule).
// A single rejected frame changes neither state nor lines: ALIVE stands still and the receiver counts its age. After
// `hold` without an accepted frame the state is FAULT with the reason of the last rejection, and a few good frames in a
// row must follow before anything else is said.
//
// kRules is the whole behaviour: the first row that applies decides. STATES.md is written from it.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <string_view>

#include "app/pipeline.hpp"
#include "base/math.hpp"
#include "base/status.hpp"
#include "base/units.hpp"

namespace holdfast::supervisor {

struct Config {
  // Two frame periods and a dropped frame at 15 fps; the same T as in the receiver's rule.
  Micros hold{150'000};
  // Fewer valid markers than this share of the grid: DEGRADED.
  int degraded_markers_pct = 87;  // 55 of 63
  // Accepted frames in a row that end a FAULT. Price: 40 ms each at 25 fps; 1 lets a line or a camera that comes and
  // goes flicker between FAULT and OK.
  int recover_frames = 3;
  // More rejected ones of the last kHistory frames: DEGRADED.
  int most_rejected = 3;
  // So long SLIP is said when the contact was lost: what is gone cannot be held, but the robot has to know.
  Micros lost_for{200'000};
  // After a FAULT wait for the command ARM.
  bool latch = false;
};

inline constexpr int kHistory = 10;

// Who else has a say, beside the frames: each with the state that a reason of its own leads to. Of several reasons the
// first counts.
enum class Source : std::uint8_t { kSettings, kModel, kGripper, kStream, kGripperHeat, kCameraSettings, kSupply };

struct SourceInfo {
  Source source;
  DeviceState leads_to;   // kFault: nothing may be confirmed; kDegraded: measuring, but not well
  std::string_view what;  // in words, for STATES.md
};

inline constexpr std::array<SourceInfo, 7> kSources{{
    {Source::kSettings, DeviceState::kFault, "stored settings"},
    {Source::kModel, DeviceState::kFault, "stored model"},
    {Source::kGripper, DeviceState::kFault, "gripper or its lines"},
    {Source::kStream, DeviceState::kDegraded, "frame rate and deadlines"},
    {Source::kGripperHeat, DeviceState::kDegraded, "gripper's temperature"},
    {Source::kCameraSettings, DeviceState::kDegraded, "exposure, gain and rate as the driver set them"},
    {Source::kSupply, DeviceState::kDegraded, "the board's supply"},
}};

struct Inputs {
  std::array<Reason, kSources.size()> reasons{};  // kNone: all is well
  bool opening = false;                           // OPENING is in force
  bool force_limit = false;                       // the regulator may not grip harder
  [[nodiscard]] Reason& of(Source source) { return reasons[static_cast<std::size_t>(source)]; }
};

// The first reason that leads to this state. kNone: there is none.
[[nodiscard]] inline Reason first(const Inputs& inputs, DeviceState leads_to) {
  for (const SourceInfo& info : kSources) {
    const Reason reason = inputs.reasons[static_cast<std::size_t>(info.source)];
    if (info.leads_to == leads_to && reason != Reason::kNone) return reason;
  }
  return Reason::kNone;
}

struct State {
  DeviceState device = DeviceState::kBoot;
  Reason reason = Reason::kNone;
  bool any_accepted = false;
  Micros last_accepted{};  // or of the start, before the first one
  bool started = false;
  int good_frames = 0;        // accepted ones in a row since the last rejection or fault
  std::uint32_t history = 0;  // of the last kHistory frames, newest in bit 0: 1 = rejected
  bool armed = false;         // ARM came since the fault
  bool resumed = false;       // goes on with what an earlier process learned
  Micros lost_until{};        // the contact was lost not long ago
  std::uint32_t faults = 0;   // how often FAULT was entered since the first accepted frame
};

// What the lines have to say now.
struct Outputs {
  DeviceState state = DeviceState::kBoot;
  Reason reason = Reason::kNone;
  bool slip = false;
  bool grip_ok = false;
  bool accepted = false;  // ALIVE has to change its level
};

// What one frame, or its absence, comes to.
struct Findings {
  bool silent = false;
  bool rejected = false;
  bool fault = false;
  bool needs_arm = false;
  bool recovering = false;
  bool light_changed = false;
  bool bent = false;
  bool learning = false;
  bool slip = false;
  bool force_limit = false;
  bool contact_lost = false;
  bool strained = false;
  bool many_rejected = false;
  bool few_markers = false;
  bool opening = false;
  bool gap = false;
  bool always = true;  // the last rule's: OK where no other holds
};

// Where the reason comes from when the row names none.
enum class Why : std::uint8_t { kRow, kRejection, kFault, kStrain };

struct Rule {
  std::string_view when;  // in words, for STATES.md
  bool Findings::*seen;
  bool only_in_fault;  // false: from any state
  bool stays;          // true: the state remains what it was, and `to` says nothing
  DeviceState to;
  Why why;
  Reason reason;
};

// clang-format off
inline constexpr std::array<Rule, 17> kRules{{
    {"a source of FAULT (below) or an output line is at fault, or the watchdog has lowered GRIP_OK",
     &Findings::fault, false, false, DeviceState::kFault, Why::kFault, Reason::kNone},
    {"no frame was accepted for 150 ms or ever, or the camera is gone or another sensor",
     &Findings::silent, false, false, DeviceState::kFault, Why::kRejection, Reason::kNone},
    {"this frame was rejected, or none came",
     &Findings::rejected, false, true, DeviceState::kBoot, Why::kRejection, Reason::kNone},
    {"the setting `latch` is on and ARM has not come since the fault, or since a process that resumed has started",
     &Findings::needs_arm, true, false, DeviceState::kFault, Why::kRow, Reason::kNeedsArm},
    {"since the fault, or since a process that resumed has started, fewer than `recover_frames` accepted frames in a "
     "row, or the picture has none before it to be compared with",
     &Findings::recovering, true, false, DeviceState::kFault, Why::kRow, Reason::kRecovering},
    {"no rest position is known, and the light changed while it was being learned",
     &Findings::light_changed, false, false, DeviceState::kReference, Why::kRow, Reason::kLightChanged},
    {"the rest position was refused, and none has been learned since",
     &Findings::bent, false, false, DeviceState::kReference, Why::kRow, Reason::kReferenceLoaded},
    {"no rest position is known",
     &Findings::learning, false, false, DeviceState::kReference, Why::kRow, Reason::kLearning},
    {"the object slips and the grip force is at its limit",
     &Findings::force_limit, false, false, DeviceState::kSlip, Why::kRow, Reason::kForceLimit},
    {"the object slips",
     &Findings::slip, false, false, DeviceState::kSlip, Why::kRow, Reason::kSlipDetected},
    {"the contact was lost in the last 200 ms, without OPENING",
     &Findings::contact_lost, false, false, DeviceState::kSlip, Why::kRow, Reason::kContactLost},
    {"a source of DEGRADED (below) has a reason",
     &Findings::strained, false, false, DeviceState::kDegraded, Why::kStrain, Reason::kNone},
    {"more than 3 of the last 10 frames were rejected or did not come",
     &Findings::many_rejected, false, false, DeviceState::kDegraded, Why::kRow, Reason::kManyRejected},
    {"fewer markers than `degraded_markers_pct`",
     &Findings::few_markers, false, false, DeviceState::kDegraded, Why::kRow, Reason::kFewMarkers},
    {"OPENING is in force",
     &Findings::opening, false, false, DeviceState::kOk, Why::kRow, Reason::kOpening},
    {"too long since the frame before",
     &Findings::gap, false, false, DeviceState::kOk, Why::kRow, Reason::kTimeGap},
    {"otherwise",
     &Findings::always, false, false, DeviceState::kOk, Why::kRow, Reason::kNone},
}};
// clang-format on

[[nodiscard]] inline Outputs outputs_of(const State& state, bool slip, bool accepted) {
  return {state.device, state.reason, slip, state.device == DeviceState::kOk, accepted};
}

namespace detail {

inline void follow_rules(State& state, const Findings& seen, Reason rejection, Reason fault, Reason strain) {
  for (const Rule& rule : kRules) {
    if (!(seen.*rule.seen) || (rule.only_in_fault && state.device != DeviceState::kFault)) continue;
    state.reason = rule.why == Why::kRejection ? rejection
                   : rule.why == Why::kFault   ? fault
                   : rule.why == Why::kStrain  ? strain
                                               : rule.reason;
    if (rule.stays) return;
    if (rule.to == DeviceState::kFault && state.device != DeviceState::kFault && state.any_accepted) {
      count_up(state.faults);  // what was never well has nothing to recover
      state.armed = false;
    }
    state.device = rule.to;
    return;
  }
}

// What went wrong before or in a FAULT is over when it ends: the frames in a row that end it say more.
inline void remember(State& state, bool rejected) {
  const std::uint32_t before = state.device == DeviceState::kFault ? 0 : state.history;
  state.history = ((before << 1) | (rejected ? 1U : 0U)) & ((1U << kHistory) - 1);
  state.good_frames = rejected ? 0 : state.good_frames + (state.good_frames < 1000 ? 1 : 0);
}

}  // namespace detail

// A device beside the camera failed between frames: `why` until update() says otherwise.
inline void fail(State& state, Reason why) {
  Findings seen;
  seen.fault = true;
  state.good_frames = 0;
  detail::follow_rules(state, seen, Reason::kNone, why, Reason::kNone);
}

// With an earlier process's rest position the first frame could be OK. As after a FAULT a few must come in a row: a
// camera that is frozen shows a new process its old picture as if it were new, once.
inline void resume(State& state) {
  state.device = DeviceState::kFault;
  state.reason = Reason::kRecovering;
  state.resumed = true;
}

// ARM: leaves a latched FAULT once its cause is gone.
inline void arm(State& state) {
  state.armed = true;
}

// Too long since an accepted frame. Range: a clock that stepped back (its contract says never) counts as too long.
[[nodiscard]] inline bool is_silent(const State& state, const Config& config, Micros now) {
  const Micros age = now - state.last_accepted;
  return !state.any_accepted || age > config.hold || age < Micros{0};
}

// Nothing usable came: rejected frame, timeout or a stream that ended. `why` is kept as the reason.
[[nodiscard]] inline Outputs reject(State& state, const Config& config, Reason why, GripRequest request, Micros now,
                                    const Inputs& inputs = {}) {
  if (!state.started) {
    state.started = true;
    state.last_accepted = now;
  }
  detail::remember(state, true);
  Findings seen;
  const Reason fault = first(inputs, DeviceState::kFault);
  seen.fault = fault != Reason::kNone;
  seen.rejected = true;
  seen.silent = is_silent(state, config, now) || why == Reason::kCameraGone || why == Reason::kCameraWrong;
  detail::follow_rules(state, seen, why, fault, Reason::kNone);
  return outputs_of(state, request == GripRequest::kTighten, false);
}

[[nodiscard]] inline Outputs update(State& state, const Config& config, const pipeline::Result& result, Micros now,
                                    const Inputs& inputs = {}) {
  if (!result.quality.ok()) return reject(state, config, result.quality.reason, result.request, now, inputs);
  const Reason fault = first(inputs, DeviceState::kFault);
  const Reason strain = first(inputs, DeviceState::kDegraded);
  // A process that was away for long finds a fresh frame first: the silence before it counts all the same.
  if (state.any_accepted && is_silent(state, config, now)) {
    detail::follow_rules(state, {.silent = true}, Reason::kNoFrame, fault, strain);
    state.good_frames = 0;
  }
  state.started = true;
  state.any_accepted = true;
  state.last_accepted = now;
  detail::remember(state, false);
  Findings seen;
  seen.fault = fault != Reason::kNone;
  if (seen.fault) state.good_frames = 0;
  seen.needs_arm = config.latch && !state.armed && (state.faults > 0 || state.resumed);
  // A frame that is blind cannot show slip: it confirms nothing, where nothing was confirmed before.
  seen.recovering = (state.faults > 0 || state.resumed) &&
                    (state.good_frames < config.recover_frames || result.features.imprint.blind);
  seen.learning = !result.referenced;
  seen.light_changed = seen.learning && result.light_changed;
  seen.bent = seen.learning && result.bent;
  seen.slip = result.request == GripRequest::kTighten;
  seen.force_limit = seen.slip && inputs.force_limit;
  if (result.contact.event == contact::Event::kLost) state.lost_until = now + config.lost_for;
  state.lost_until = std::min(state.lost_until, now + config.lost_for);  // also where the clock stepped back
  seen.contact_lost = now < state.lost_until && !result.contact.touching && !inputs.opening;
  seen.strained = strain != Reason::kNone;
  seen.many_rejected = std::popcount(state.history) > config.most_rejected;
  seen.few_markers = result.features.markers * 100 < result.grid.count() * config.degraded_markers_pct;
  seen.opening = inputs.opening;
  seen.gap = result.features.gap;
  detail::follow_rules(state, seen, Reason::kNone, fault, strain);
  return outputs_of(state, seen.slip, true);
}

}  // namespace holdfast::supervisor
