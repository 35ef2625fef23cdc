// SPDX-License-Identifier: Apache-2.0
// The live view: the device on the whole screen, until q or Ctrl-C.
#pragma once

#include <string>

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

// Empty, or the error line. The terminal is as before afterwards, whatever ended it.
[[nodiscard]] std::string run_live(Device& device);

}  // namespace holdfast::console_tool
