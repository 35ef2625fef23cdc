// SPDX-License-Identifier: Apache-2.0
// A person at a device's console: keys go to the device, whose own line editor, history and completion answer them
// (firmware/console/line_editor.hpp), and its text comes back without the telemetry frames between the lines.
#pragma once

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

// Of a device that was attached, until Ctrl-D, the end of the terminal, or a signal to end; it is locked then. A port
// that was unplugged is opened anew by its name. The exit status.
[[nodiscard]] int run_terminal(Device& device);

}  // namespace holdfast::console_tool
