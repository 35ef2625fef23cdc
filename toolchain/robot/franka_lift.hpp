// SPDX-License-Identifier: Apache-2.0
// Lifts with a Franka arm by libfranka's control loop while the grip is confirmed, and comes to rest when it is not.
// Paste it beside holdfast_link.h. `port` is the serial line to the board: raw, 115200 8N1, opened with O_NONBLOCK.
// Not a certified safety function.
#pragma once

#include <franka/robot.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>

#include "holdfast_link.h"

// Reads what has come, without waiting. Returns whether the grip may be taken for good now.
inline bool holdfast_poll(int port, holdfast_receiver& receiver, holdfast_grip& grip, std::uint32_t now_ms) {
  std::array<std::uint8_t, 64> bytes;  // a status frame has 34 and comes every 40 ms or so
  const ssize_t count = ::read(port, bytes.data(), bytes.size());
  for (ssize_t i = 0; i < count; ++i) {
    holdfast_status status;
    if (holdfast_link_push(&receiver, bytes[static_cast<std::size_t>(i)]) == HOLDFAST_KIND_STATUS &&
        holdfast_link_status(&receiver, &status) != 0) {
      holdfast_grip_update(&grip, &status, now_ms);
    }
  }
  return holdfast_grip_ok(&grip, now_ms) != 0;
}

// At 20 mm/s for `seconds`. Returns whether the grip was confirmed all the time. Discard what waits in the port first
// (tcflush), then wait until holdfast_poll() says yes with the same receiver, grip and clock (robot.readOnce().time).
inline bool holdfast_lift(franka::Robot& robot, int port, holdfast_receiver& receiver, holdfast_grip& grip,
                          double seconds) {
  constexpr double kSpeed = 0.02, kAcceleration = 0.1;  // m/s, m/s^2: a ramp, not a step
  double velocity = 0.0, elapsed = 0.0;
  bool confirmed = true;
  robot.control([&](const franka::RobotState& state, franka::Duration period) -> franka::CartesianVelocities {
    // The robot's own clock; as 32 bits it comes round, which the rule knows.
    confirmed = holdfast_poll(port, receiver, grip, static_cast<std::uint32_t>(state.time.toMSec())) && confirmed;
    elapsed += period.toSec();
    const double wanted = confirmed && elapsed < seconds ? kSpeed : 0.0;
    const double step = kAcceleration * period.toSec();
    velocity = std::clamp(wanted, velocity - step, velocity + step);
    franka::CartesianVelocities command{{0.0, 0.0, velocity, 0.0, 0.0, 0.0}};
    if (wanted == 0.0 && velocity == 0.0) return franka::MotionFinished(command);
    return command;
  });
  return confirmed;
}
