// SPDX-License-Identifier: Apache-2.0
// Holds on just hard enough: raises the grip step by step while the object slips, until the entropy E is constant and
// dE/dt near zero, and then keeps it (Hu et al. 2024, section V.F). Lowers it on command alone, step by step,
// or at once to a `max_force` that was set lower.
//
// Steps while slip is requested, this very frame says slip, and E has not been constant for long. The request alone
// lasts longer than the slip (decision.hpp, hold), and steps in that time squeeze what is held already. Where only the
// markers tell, the verdict outlives the slip, too: there a constant E ends the steps. It may not do so soon: in a
// steady slide E stands still for 160 ms at times, and a load that grows without a slip moves it as well. What the
// sensor says counts only while it is trusted; without it the grip stays as it is. GRIP and RELEASE are the robot's and
// are obeyed all the same: a grip whose sensor has failed can still be put down.
//
// Range: now never runs backwards, and may jump by hours; one call moves the grip by one step at most, or down to
// `max_force`. Does not judge the sensor (supervisor) and knows no gripper (hande, step_lines).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "base/status.hpp"
#include "base/units.hpp"
#include "slip/decision.hpp"

namespace holdfast::regulator {

// Force in counts of the Hand-E's register rFR, 0..255.
inline constexpr int kMostCounts = 255;

struct Config {
  int start_force = 20;
  int force_step = 3;         // larger: stops faster slips, and squeezes more than needed
  int grow_pct = 3;           // and this share of the present force: heavy things take larger steps
  int max_force = 255;        // what the object bears
  Micros every{40'000};       // between steps
  Micros grasp_for{900'000};  // closing on the object moves the gel as a slip does; slips in this time are not heard
  std::int32_t calm_nat_q16 = 3'277;  // 0.05 nat: E stays this near to itself while it is constant
  Micros calm_after{280'000};         // so long E must be constant for the steps to stop although it seems to slip
  Micros hold_after{400'000};         // and so long for the grip to count as stable
  int release_step = 6;
  Micros release_every{40'000};
};

enum class Phase : std::uint8_t { kIdle, kGripping, kTightening, kSettling, kHolding, kReleasing };

// The E that a finger's frames stay near, since when.
struct Steady {
  bool known = false;
  Micros since{};
  NatsQ16 entropy;
};

struct State {
  Phase phase = Phase::kIdle;
  int force = 0;
  int base = 0;  // Config::start_force and force_step when it began: Command::steps counts from and in them, whatever
  int unit = 1;  // they are set to meanwhile
  Micros last_step{};
  std::array<Steady, kMaxFingers> steady{};
  bool at_limit = false;  // it slipped and there was no more force to give
};

struct Input {
  bool trusted = false;  // this frame was accepted, and the device's state is OK or SLIP
  GripRequest request = GripRequest::kHold;
  Verdict verdict = Verdict::kHold;  // of this frame alone
  NatsQ16 entropy{};
  int finger = 0;        // whose frame it is
  bool grip = false;     // close, or stop a release; an edge or a level
  bool release = false;  // likewise; wins over grip
};

struct Command {
  std::uint8_t force = 0;
  int steps = 0;  // above the force of GRIP, for the step lines; below it while releasing, and 0 when that is over
  Phase phase = Phase::kIdle;
  bool at_limit = false;  // Reason::kForceLimit
  bool go = false;        // the gripper has something to do: rGTO
};

// Range: every count 0..255, start_force at most max_force, steps of force and release at least 1, times not negative.
[[nodiscard]] constexpr Status validate(const Config& config) {
  const auto counts = [](int value) { return value >= 0 && value <= kMostCounts; };
  const bool ok = counts(config.start_force) && counts(config.max_force) && config.start_force <= config.max_force &&
                  config.force_step >= 1 && config.force_step <= kMostCounts && config.release_step >= 1 &&
                  config.release_step <= kMostCounts && config.every >= Micros{0} &&
                  config.release_every >= Micros{0} && config.calm_after >= Micros{0} &&
                  config.hold_after >= Micros{0} && config.calm_nat_q16 >= 0 && config.grow_pct >= 0 &&
                  config.grow_pct <= 100 && config.grasp_for >= Micros{0};
  return {ok ? Reason::kNone : Reason::kConfig};
}

[[nodiscard]] constexpr Command command_of(const State& state) {
  return {static_cast<std::uint8_t>(state.force),
          state.phase == Phase::kIdle ? 0 : (state.force - state.base) / state.unit, state.phase, state.at_limit,
          state.phase != Phase::kIdle};
}

// How long E has been constant on every finger, and with it dE/dt near zero. From frame to frame the rate would not do:
// the hard edges of the bins make a still grip flicker by 1 nat/s. Range: differences of NatsQ16 fit int32.
[[nodiscard]] constexpr Micros calm(State& state, const Config& config, const Input& input, Micros now) {
  Steady& own = state.steady[idx(input.finger)];
  const std::int32_t off = input.entropy.raw() - own.entropy.raw();
  if (!own.known || off > config.calm_nat_q16 || off < -config.calm_nat_q16) own = {true, now, input.entropy};
  Micros since = own.since;
  for (const Steady& one : state.steady) since = one.known ? std::max(since, one.since) : since;
  return now - since;
}

[[nodiscard]] constexpr Command update(State& state, const Config& config, const Input& input, Micros now) {
  state.force = std::min(state.force, config.max_force);  // also where it was set lower meanwhile
  const bool releases = input.release && state.phase != Phase::kIdle;
  if (releases && state.phase != Phase::kReleasing) {
    state.phase = Phase::kReleasing;
    state.last_step = now - config.release_every;
  } else if (input.grip && !input.release && state.phase == Phase::kIdle) {
    state = {};
    state.phase = Phase::kGripping;
    state.force = state.base = config.start_force;
    state.unit = config.force_step;
    state.last_step = now;
  } else if (input.grip && !input.release && state.phase == Phase::kReleasing) {
    state.phase = Phase::kSettling;  // as hard as it still is
    state.steady = {};
  }

  if (state.phase == Phase::kReleasing) {
    state.at_limit = false;
    if (now - state.last_step < config.release_every) return command_of(state);
    state.last_step = now;
    state.force = std::max(state.force - config.release_step, 0);
    if (state.force == 0) state = {};  // open
    return command_of(state);
  }
  if (state.phase == Phase::kIdle || !input.trusted) {
    state.steady[idx(input.finger)] = {};
    return command_of(state);
  }

  if (state.phase == Phase::kGripping && now - state.last_step < config.grasp_for) return command_of(state);
  const Micros calm_for = calm(state, config, input, now);
  if (input.request == GripRequest::kTighten && input.verdict != Verdict::kHold && calm_for < config.calm_after) {
    state.phase = Phase::kTightening;
    state.at_limit = state.force >= config.max_force;
    if (!state.at_limit && now - state.last_step >= config.every) {
      state.last_step = now;
      const int step = config.force_step + state.force * config.grow_pct / 100;
      state.force = std::min(state.force + step, config.max_force);
    }
  } else if (state.phase == Phase::kTightening) {
    state.phase = Phase::kSettling;
    state.at_limit = false;
  } else if (calm_for >= config.hold_after) {
    state.phase = Phase::kHolding;
  }
  return command_of(state);
}

}  // namespace holdfast::regulator
