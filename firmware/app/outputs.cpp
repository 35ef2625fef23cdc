// SPDX-License-Identifier: Apache-2.0
#include "app/outputs.hpp"

namespace holdfast::outputs {
namespace {

[[nodiscard]] bool drive(hal::Gpio& gpio, hal::Line line, bool high) {
  return gpio.set(line, high ? hal::Level::kHigh : hal::Level::kLow);
}

[[nodiscard]] bool lower(State& state, hal::Gpio& gpio) {
  state.grip_ok = false;
  return drive(gpio, hal::Line::kGripOk, false);
}

void confirm(State& state, OutputWatchdog& watchdog, Micros now) {
  watchdog.confirm(now);
  if (!state.first_confirmed) state.first_confirmed = now;
}

}  // namespace

bool start(State& state, hal::Gpio& gpio) {
  const std::uint32_t trips = state.trips;
  state = {};
  state.trips = trips;
  return lower(state, gpio) && drive(gpio, hal::Line::kAlive, false);
}

bool lowered_meanwhile(State& state, const OutputWatchdog& watchdog) {
  if (watchdog.trips() == state.trips) return false;
  state.trips = watchdog.trips();
  state.grip_ok = false;
  return true;
}

Reason update(State& state, const Config& config, hal::Gpio& gpio, const hal::Clock& clock, OutputWatchdog& watchdog,
              const Wanted& wanted) {
  if (state.distrusted > 0) {
    if (!lower(state, gpio)) {
      state.distrusted = config.line_trust;
    } else if (wanted.accepted) {
      --state.distrusted;
    }
    return Reason::kGpioFailed;
  }
  const bool rises = wanted.grip_ok && !state.grip_ok;
  // A rise without an accepted frame is nobody's (fingers::decide): it is refused as if the line had.
  bool obeyed = drive(gpio, hal::Line::kGripOk, wanted.grip_ok && !rises) && (wanted.accepted || !rises);
  if (obeyed && wanted.accepted) {
    const auto too_late = [&] { return is_stale(config, wanted.timestamp, clock.now()); };
    bool stale = too_late();
    if (!stale) {
      obeyed = drive(gpio, hal::Line::kAlive, !state.alive);
      if (obeyed) state.alive = !state.alive;
      stale = obeyed && too_late();  // stopped between the look at the clock and the edge (30 ns wide)
    }
    if (stale) {
      (void)lower(state, gpio);
      return Reason::kFrameStale;
    }
    if (obeyed) confirm(state, watchdog, clock.now());
  }
  if (obeyed && rises) obeyed = drive(gpio, hal::Line::kGripOk, true);
  state.grip_ok = wanted.grip_ok;
  if (obeyed && !wanted.grip_ok && !wanted.accepted) watchdog.rest();  // this thread has lowered it in time
  if (obeyed) return Reason::kNone;
  state.distrusted = config.line_trust;
  (void)lower(state, gpio);
  return Reason::kGpioFailed;
}

void stop(State& state, hal::Gpio& gpio, OutputWatchdog& watchdog) {
  watchdog.rest();
  (void)lower(state, gpio);
}

}  // namespace holdfast::outputs
