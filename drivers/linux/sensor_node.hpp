// SPDX-License-Identifier: Apache-2.0
// Which /dev/videoN is the GelSight Mini: read from sysfs without opening a device and without memory, so that it can
// be asked again at every replug.
//
// A sensor has two nodes, the first for pictures and the second for metadata; their numbers change when it is plugged
// in again. Its USB id 0c45:636d is shared with webcams of the same maker, so what counts is the product's name,
// "GelSight Mini R0B XXXX-XXXX"; its serial tells it from another one, whose gel is another. Not here: whether it works
// (camera_v4l2.hpp).
#pragma once

#include <string_view>

#include "drivers/linux/kernel.hpp"
#include "drivers/linux/text.hpp"

namespace holdfast::drivers {

struct SensorSearch {
  std::string_view serial;            // "2BNN4ZE7", with or without dashes; empty: the only one there
  std::string_view sysfs = "/sys";    // tests have their own
  std::string_view devices = "/dev";  // likewise
};

struct SensorNode {
  Text<64> path;     // "/dev/video0"
  Text<32> serial;   // of the USB device
  Text<64> product;  // of the USB device
};

// False: there is none to take, or more than one; `problem` is one line: what, likely cause, next step.
[[nodiscard]] bool find_sensor(Kernel& kernel, const SensorSearch& search, SensorNode& found, Text<320>& problem);

}  // namespace holdfast::drivers
