// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_replay.hpp"

#include <utility>

namespace holdfast::sim {
namespace {

// A stamp further ahead is no gap but another clock's: a camera would have delivered the frame now.
constexpr std::chrono::hours kLongestGap{1};

}  // namespace

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
  if (due - clock_.now() < kLongestGap) {
    if (due > clock_.now() + timeout) {
      clock_.advance(timeout);
      return hal::Capture::kTimeout;
    }
    clock_.advance_to(due);
  }
  pending_ = false;
  frame = as_frame(frame_);
  frame.timestamp = due;
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
