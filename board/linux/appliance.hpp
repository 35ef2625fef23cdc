// SPDX-License-Identifier: Apache-2.0
// The board of every Linux computer with a GelSight Mini on USB: real drivers, a wiring table, and what systemd wants.
// board/<name>/board.cpp says only what differs.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "drivers/common/gpio_wiring.hpp"

namespace holdfast::board {

struct Hardware {
  std::string_view name;
  std::span<const drivers::Wiring> wiring;
  // Seconds of the world in one of the firmware's: every deadline stretches alike.
  std::int32_t time_scale = 1;
  // The kernel's sensor of the supply's voltage (drivers/common/sysfs_supply.hpp); empty: the board has none.
  std::string_view supply{};
};

// Of board/<name>/board.cpp.
[[nodiscard]] const Hardware& hardware();

}  // namespace holdfast::board
