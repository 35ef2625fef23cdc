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

#include "drivers/linux/fixed_text.hpp"
#include "drivers/linux/kernel.hpp"

namespace holdfast::drivers {

// In the order in which they are set: what is automatic goes off before its value can be given.
struct CameraControl {
  std::uint32_t id;           // V4L2_CID_...
  std::string_view name;      // the kernel's from 5.17 on
  std::string_view old_name;  // before; empty: the same
  std::int32_t value;
  // Whether brightness or frame rate hang on it: with another value the picture is not the one that thresholds and
  // model were measured on, or follows the scene. Colour and sharpness touch the luma hardly, and mains flicker matters
  // to automatic exposure alone.
  bool steadies;
};
[[nodiscard]] const std::array<CameraControl, 14>& camera_controls();

// Bit k: control k of camera_controls().
struct ControlsOff {
  std::uint32_t missing = 0;  // the camera does not have it, and cannot refuse it
  std::uint32_t refused = 0;  // it does not read as set
};

// Sets all, then reads them back; what was refused is tried kControlTries times: a transfer may be lost.
inline constexpr int kControlTries = 3;
[[nodiscard]] ControlsOff set_camera_controls(Kernel& kernel, int fd);

[[nodiscard]] bool are_steady(const ControlsOff& off);
// One line for people: what, likely cause, next step. Empty: all are as set.
[[nodiscard]] FixedText<511> words_of(const ControlsOff& off);

}  // namespace holdfast::drivers
