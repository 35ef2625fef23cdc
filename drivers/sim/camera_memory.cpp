// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_memory.hpp"

#include "drivers/sim/noise.hpp"

namespace holdfast::sim {

bool CameraMemory::do_start() {
  shown_ = 0;
  exposure_ = clock_.now();
  return !pictures_.empty();
}

hal::Capture CameraMemory::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  if (shown_ == config_.cycles * pictures_.size()) return hal::Capture::kGone;
  const std::chrono::microseconds deadline = clock_.now() + timeout;
  const std::chrono::microseconds arrival = exposure_ + config_.latency;
  if (arrival > deadline) {
    clock_.advance_to(deadline);
    return hal::Capture::kTimeout;
  }
  clock_.advance_to(arrival);
  const LumaView& picture = pictures_[static_cast<std::size_t>(shown_ % pictures_.size())];
  std::span<const std::uint8_t> bytes(picture.data, bytes_of(picture));
  if (config_.live && drawn_ >= pictures_.size()) {
    room_.assign(bytes.begin(), bytes.end());
    add_noise(room_, drawn_);
    bytes = room_;
  }
  ++drawn_;
  frame = {bytes,     hal::PixelFormat::kLuma8,          picture.width, picture.height, picture.stride,
           exposure_, static_cast<std::uint32_t>(shown_)};
  exposure_ += config_.period;
  ++shown_;
  ++borrowed_;
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
