// SPDX-License-Identifier: Apache-2.0
// A STUB, not libfranka: the few names that toolchain/robot/franka_lift.hpp uses, in virtual time and without a robot.
// Written after libfranka's documentation; nothing here says that the example works on a real arm.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

namespace franka {

class Duration {
 public:
  explicit Duration(std::uint64_t milliseconds) : milliseconds_(milliseconds) {}
  [[nodiscard]] double toSec() const { return static_cast<double>(milliseconds_) / 1000.0; }
  [[nodiscard]] std::uint64_t toMSec() const { return milliseconds_; }

 private:
  std::uint64_t milliseconds_;
};

struct RobotState {
  Duration time{0};
};

struct CartesianVelocities {
  CartesianVelocities(const std::array<double, 6>& velocities) : O_dP_EE(velocities) {}  // NOLINT: as libfranka's
  std::array<double, 6> O_dP_EE;
  bool motion_finished = false;
};

inline CartesianVelocities MotionFinished(CartesianVelocities command) {
  command.motion_finished = true;
  return command;
}

class Robot {
 public:
  void control(const std::function<CartesianVelocities(const RobotState&, Duration)>& each) {
    for (std::uint64_t period = 0; commands.size() < kMost; period = 1) {
      before(now_ms);
      const CartesianVelocities command = each(RobotState{Duration(now_ms)}, Duration(period));
      commands.push_back(command.O_dP_EE);
      ++now_ms;
      if (command.motion_finished) return;
    }
  }

  // The stub's own.
  static constexpr std::size_t kMost = 100'000;
  std::uint64_t now_ms = 0;
  std::function<void(std::uint64_t)> before = [](std::uint64_t) {};  // what happens at this time
  std::vector<std::array<double, 6>> commands;
};

}  // namespace franka
