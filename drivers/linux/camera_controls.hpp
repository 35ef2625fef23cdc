// SPDX-License-Identifier: Apache-2.0
// What the sensor's vendor sets before it measures: everything automatic off. With automatic exposure the frame rate
// falls in the dark, and brightness moves whenever something touches the gel.
//
// The kernel renamed some controls (exposure_auto became auto_exposure), their numbers stayed: they are set and read
// back by number, and the names are for people.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "drivers/linux/kernel.hpp"

namespace holdfast::drivers {

// In the order in which they are set: what is automatic goes off before its value can be given.
struct CameraControl {
  std::uint32_t id;           // V4L2_CID_...
  std::string_view name;      // the kernel's from 5.17 on
  std::string_view old_name;  // before; empty: the same
  std::int32_t value;
};
[[nodiscard]] const std::array<CameraControl, 14>& camera_controls();

// Sets all, then reads them back. Bit k: control k is not what it was set to, or not offered.
[[nodiscard]] std::uint32_t set_camera_controls(Kernel& kernel, int fd);

}  // namespace holdfast::drivers
