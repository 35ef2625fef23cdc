// SPDX-License-Identifier: Apache-2.0
// The prompt: libedit's line editing, a history that outlives the session, completion from the device's own help, and
// the device's own lines in between.
#pragma once

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

// To the end of the session, at a terminal; the device is attached. The exit status: 0, or 1 when it was ended by a
// port that did not come back.
[[nodiscard]] int run_shell(Device& device);

}  // namespace holdfast::console_tool
