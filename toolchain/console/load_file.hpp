// SPDX-License-Identifier: Apache-2.0
// A compiled record onto a device: the lines of its command `load`.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

// What is said, in order. Range: a record that a device may take; its kind says which `load` it is.
[[nodiscard]] std::vector<std::string> load_lines(std::span<const std::uint8_t> bytes);

// Empty, or the error line; nothing was stored then. `report`: what was done, a line each.
[[nodiscard]] std::string load(Device& device, const std::string& path, std::vector<std::string>& report);

}  // namespace holdfast::console_tool
