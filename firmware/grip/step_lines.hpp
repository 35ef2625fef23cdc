// SPDX-License-Identifier: Apache-2.0
// The regulator's steps as pulses on two lines, for grippers and robot programs that know "harder" and "softer" and no
// force: one pulse on INCREASE is one step up, one on DECREASE one step down.
//
// Pulses that are owed are counted, so that none is lost while one is out; an owed pulse and its opposite cancel. Both
// lines are never HIGH together: before one rises the other has been told LOW and obeyed. A line that refuses stops it
// for good (kGpioFailed) with both lines told LOW; what the gripper counted of the last pulse is then unknown, so only
// a new start counts again.
//
// Times are kept at the granularity of the calls: a pulse is never shorter than `pulse`, and longer by one call at
// most. Range: now never runs backwards; |steps| <= 255, so at most 510 pulses are owed.
#pragma once

#include <cstdint>

#include "base/status.hpp"
#include "base/units.hpp"
#include "hal/gpio.hpp"

namespace holdfast::step_lines {

struct Config {
  Micros pulse{24'000};  // HIGH; two cycles of a controller that reads its inputs every 8 ms, and one to spare
  Micros gap{24'000};    // LOW after it, before the next
};

// A robot controller reads its inputs every 8 ms: below two cycles and their jitter a pulse can be missed.
inline constexpr Micros kLeastPulse{20'000};

struct State {
  int sent = 0;  // steps that the gripper has been told, up less down; counts the pulse that is out
  bool high = false;
  hal::Line line = hal::Line::kIncrease;  // that is HIGH, or was last
  Micros since{};                         // that it took its level
  bool resting = false;                   // the gap after a pulse is not over
  bool failed = false;
};

[[nodiscard]] constexpr Status validate(const Config& config) {
  return {config.pulse >= kLeastPulse && config.gap >= kLeastPulse ? Reason::kNone : Reason::kConfig};
}

[[nodiscard]] inline Status fail(State& state, hal::Gpio& gpio) {
  state.failed = true;
  state.high = false;
  (void)gpio.set(hal::Line::kIncrease, hal::Level::kLow);
  (void)gpio.set(hal::Line::kDecrease, hal::Level::kLow);
  return {Reason::kGpioFailed};
}

// Both lines LOW. `steps`: where the gripper is taken to be.
[[nodiscard]] inline Status start(State& state, hal::Gpio& gpio, int steps) {
  state = {};
  state.sent = steps;
  const bool up = gpio.set(hal::Line::kIncrease, hal::Level::kLow);
  const bool down = gpio.set(hal::Line::kDecrease, hal::Level::kLow);
  return up && down ? kOkStatus : fail(state, gpio);
}

// `steps`: regulator::Command::steps. To be called at least once in `pulse` and `gap`; at 25 fps a pulse takes a frame.
[[nodiscard]] inline Status update(State& state, const Config& config, hal::Gpio& gpio, int steps, Micros now) {
  if (state.failed) return {Reason::kGpioFailed};
  if (state.high) {
    if (now - state.since < config.pulse) return kOkStatus;
    if (!gpio.set(state.line, hal::Level::kLow)) return fail(state, gpio);
    state.high = false;
    state.resting = true;
    state.since = now;
    return kOkStatus;
  }
  state.resting = state.resting && now - state.since < config.gap;
  if (state.resting || steps == state.sent) return kOkStatus;
  const bool up = steps > state.sent;
  const hal::Line other = up ? hal::Line::kDecrease : hal::Line::kIncrease;
  state.line = up ? hal::Line::kIncrease : hal::Line::kDecrease;
  if (!gpio.set(other, hal::Level::kLow) || !gpio.set(state.line, hal::Level::kHigh)) return fail(state, gpio);
  state.sent += up ? 1 : -1;
  state.high = true;
  state.since = now;
  return kOkStatus;
}

}  // namespace holdfast::step_lines
