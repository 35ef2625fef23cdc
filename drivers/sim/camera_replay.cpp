// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_replay.hpp"

#include <utility>

namespace holdfast::sim {

CameraReplay::CameraReplay(Recording recording, Clock& clock) : recording_(std::move(recording)), clock_(clock) {}

bool CameraReplay::do_start() {
  start_ = clock_.now();
  pending_ = false;
  return !std::exchange(played_, true) || recording_.rewind();
}

hal::Capture CameraReplay::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  if (!pending_) {
    if (recording_.next(frame_) != Read::kFrame) return hal::Capture::kGone;
    pending_ = true;
  }
  const std::chrono::microseconds due = start_ + frame_.time;
  if (due > clock_.now() + timeout) {
    clock_.advance(timeout);
    return hal::Capture::kTimeout;
  }
  pending_ = false;
  clock_.advance_to(due);
  frame = as_frame(frame_);
  frame.timestamp = due;
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
