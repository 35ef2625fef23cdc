// SPDX-License-Identifier: Apache-2.0
// Which serial port a Holdfast is on: the one that answers `version json`.
#pragma once

#include <string>

#include "toolchain/console/device.hpp"
#include "toolchain/devices/inventory.hpp"

namespace holdfast::console_tool {

struct Found {
  std::string path;   // as it stays the same: by-id where there is one
  std::string error;  // one line; empty: path is it
};

// Asks every USB, ACM and AMA port that is free and not the kernel's own console, each for `deadline`. A port that
// answers is said to be found only when it is the only one: a robot has two fingers.
[[nodiscard]] Found find_device(const devices::Places& places, Signals& signals, Millis deadline);

}  // namespace holdfast::console_tool
