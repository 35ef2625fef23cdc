// SPDX-License-Identifier: Apache-2.0
// The emulated camera's text commands, one line each, and their answers, one line each: "ok ..." or "error: ...".
//   play A B [then C D]       show pictures A to B again and again; with then: A to B once, C to D again and again
//   period MS                 from frame to frame; 0: as fast as they are taken
//   unplug | plug             the cable
//   stall on|off              the stream stands still, in mid-picture if it comes so
//   truncate N                the next N frames end after half of their bytes
//   error N                   the next N frames carry the error bit
//   freeze on|off             the same picture in new frames
//   as NAME SERIAL VID:PID    another device, from the next plug on; NAME may have spaces
//   status                    frames sent to their end, the picture, and the controls as they are set
#pragma once

#include <string>
#include <string_view>

#include "tests/system/usbredir.hpp"

namespace holdfast::test {

// Both outlive the call. `line` may end with a line feed.
[[nodiscard]] std::string obey(std::string_view line, UsbCamera& camera, UsbredirPeer& peer);

}  // namespace holdfast::test
