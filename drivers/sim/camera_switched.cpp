// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_switched.hpp"

#include <algorithm>

namespace holdfast::sim {

hal::Capture SwitchedCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  if (what_ == CameraSwitch::kGone) {
    inside_.stop();
    return hal::Capture::kGone;
  }
  const hal::Capture capture = inside_.next(frame, timeout);
  if (capture != hal::Capture::kFrame || what_ == CameraSwitch::kNone) {
    true_frame_ = frame;
    return capture;
  }
  true_frame_ = frame;
  const std::size_t size = std::min(frame.bytes.size(), bytes_.size());
  switch (what_) {
    case CameraSwitch::kOff:
      inside_.release(frame);
      return hal::Capture::kTimeout;
    case CameraSwitch::kBad:
      inside_.release(frame);
      return hal::Capture::kBad;
    case CameraSwitch::kStuck:
      if (kept_ == 0) {
        std::copy_n(frame.bytes.begin(), size, bytes_.begin());
        kept_ = size;
      }
      frame.bytes = std::span(bytes_).first(kept_);
      return capture;
    case CameraSwitch::kGarbage:
      for (std::size_t k = 0; k < size; ++k) {
        random_ = random_ * 1664525 + 1013904223;
        bytes_[k] = static_cast<std::uint8_t>(random_ >> 24);
      }
      break;
    default:  // dark, with a little noise: not frozen
      for (std::size_t k = 0; k < size; ++k) {
        random_ = random_ * 1664525 + 1013904223;
        bytes_[k] = static_cast<std::uint8_t>(random_ >> 30);
      }
      break;
  }
  frame.bytes = std::span(bytes_).first(size);
  return capture;
}

}  // namespace holdfast::sim
