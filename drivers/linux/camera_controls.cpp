// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/camera_controls.hpp"

#include <linux/videodev2.h>

#include <cstddef>

namespace holdfast::drivers {

const std::array<CameraControl, 14>& camera_controls() {
  static constexpr std::array<CameraControl, 14> kControls{{
      {V4L2_CID_BRIGHTNESS, "brightness", {}, 0},
      {V4L2_CID_CONTRAST, "contrast", {}, 32},
      {V4L2_CID_SATURATION, "saturation", {}, 64},
      {V4L2_CID_HUE, "hue", {}, 0},
      {V4L2_CID_AUTO_WHITE_BALANCE, "white_balance_automatic", "white_balance_temperature_auto", 0},
      {V4L2_CID_WHITE_BALANCE_TEMPERATURE, "white_balance_temperature", {}, 4500},
      {V4L2_CID_GAMMA, "gamma", {}, 140},
      {V4L2_CID_GAIN, "gain", {}, 0},
      {V4L2_CID_POWER_LINE_FREQUENCY, "power_line_frequency", {}, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED},
      {V4L2_CID_SHARPNESS, "sharpness", {}, 3},
      {V4L2_CID_BACKLIGHT_COMPENSATION, "backlight_compensation", {}, 0},
      {V4L2_CID_EXPOSURE_AUTO, "auto_exposure", "exposure_auto", V4L2_EXPOSURE_MANUAL},
      {V4L2_CID_EXPOSURE_ABSOLUTE, "exposure_time_absolute", "exposure_absolute", 180},  // 18 ms
      {V4L2_CID_EXPOSURE_AUTO_PRIORITY, "exposure_dynamic_framerate", "exposure_auto_priority", 0},
  }};
  return kControls;
}

std::uint32_t set_camera_controls(Kernel& kernel, int fd) {
  const auto& controls = camera_controls();
  for (const CameraControl& one : controls) {
    v4l2_control control{one.id, one.value};
    (void)kernel.ioctl(fd, VIDIOC_S_CTRL, &control);  // refused: it will not read as set
  }
  std::uint32_t off = 0;
  for (std::size_t i = 0; i < controls.size(); ++i) {
    v4l2_control control{controls[i].id, 0};
    const bool read = kernel.ioctl(fd, VIDIOC_G_CTRL, &control) != -1;
    if (!read || control.value != controls[i].value) off |= 1U << i;
  }
  return off;
}

}  // namespace holdfast::drivers
