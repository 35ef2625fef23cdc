// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/camera_controls.hpp"

#include <linux/videodev2.h>

#include <cerrno>
#include <cstddef>

namespace holdfast::drivers {

const std::array<CameraControl, 14>& camera_controls() {
  static constexpr std::array<CameraControl, 14> kControls{{
      {V4L2_CID_BRIGHTNESS, "brightness", {}, 0, true},
      {V4L2_CID_CONTRAST, "contrast", {}, 32, true},
      {V4L2_CID_SATURATION, "saturation", {}, 64, false},
      {V4L2_CID_HUE, "hue", {}, 0, false},
      {V4L2_CID_AUTO_WHITE_BALANCE, "white_balance_automatic", "white_balance_temperature_auto", 0, true},
      {V4L2_CID_WHITE_BALANCE_TEMPERATURE, "white_balance_temperature", {}, 4500, false},
      {V4L2_CID_GAMMA, "gamma", {}, 140, true},
      {V4L2_CID_GAIN, "gain", {}, 0, true},
      {V4L2_CID_POWER_LINE_FREQUENCY, "power_line_frequency", {}, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED, false},
      {V4L2_CID_SHARPNESS, "sharpness", {}, 3, false},
      {V4L2_CID_BACKLIGHT_COMPENSATION, "backlight_compensation", {}, 0, true},
      {V4L2_CID_EXPOSURE_AUTO, "auto_exposure", "exposure_auto", V4L2_EXPOSURE_MANUAL, true},
      {V4L2_CID_EXPOSURE_ABSOLUTE, "exposure_time_absolute", "exposure_absolute", 180, true},  // 18 ms
      {V4L2_CID_EXPOSURE_AUTO_PRIORITY, "exposure_dynamic_framerate", "exposure_auto_priority", 0, true},
  }};
  return kControls;
}

ControlsOff set_camera_controls(Kernel& kernel, int fd) {
  const auto& controls = camera_controls();
  ControlsOff off{.missing = 0, .refused = (1U << controls.size()) - 1};
  for (int tries = 0; tries < kControlTries && off.refused != 0; ++tries) {
    const std::uint32_t wanted = off.refused;
    for (std::size_t i = 0; i < controls.size(); ++i) {
      v4l2_control control{controls[i].id, controls[i].value};
      if ((wanted >> i & 1U) != 0) (void)kernel.ioctl(fd, VIDIOC_S_CTRL, &control);  // refused: it will not read as set
    }
    off = {};
    for (std::size_t i = 0; i < controls.size(); ++i) {
      v4l2_control control{controls[i].id, 0};
      const bool read = kernel.ioctl(fd, VIDIOC_G_CTRL, &control) != -1;
      if (read && control.value == controls[i].value) continue;
      (!read && errno == EINVAL ? off.missing : off.refused) |= 1U << i;
    }
  }
  return off;
}

bool are_steady(const ControlsOff& off) {
  const auto& controls = camera_controls();
  std::uint32_t steadies = 0;
  for (std::size_t i = 0; i < controls.size(); ++i) steadies |= static_cast<std::uint32_t>(controls[i].steadies) << i;
  return (off.refused & steadies) == 0;
}

FixedText<511> words_of(const ControlsOff& off) {
  FixedText<511> text;
  const auto list = [&](std::uint32_t which, std::string_view before) {
    if (which == 0) return;
    text << (text.empty() ? "" : "; ") << before;
    for (std::size_t i = 0; i < camera_controls().size(); ++i) {
      const CameraControl& control = camera_controls()[i];
      if ((which >> i & 1U) != 0) text << " " << control.name << "=" << control.value;
    }
  };
  list(off.refused, "the camera does not take");
  list(off.missing, "the camera does not have");
  if (!text.empty()) {
    text << ". Likely cause: another program sets them too, or another firmware of the sensor. Next: end the other "
            "program and plug the sensor in again";
  }
  return text;
}

}  // namespace holdfast::drivers
