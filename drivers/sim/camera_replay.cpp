// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_replay.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace holdfast::sim {
namespace {

// A stamp further ahead is no gap but another clock's: a camera would have delivered the frame now.
constexpr std::chrono::hours kLongestGap{1};

std::chrono::microseconds nominal_period(const Recording& recording) {
  return std::chrono::microseconds{std::llround(1e6 / recording.info().time_base_fps)};
}

}  // namespace

CameraReplay::CameraReplay(Recording recording, Clock& clock) : recording_(std::move(recording)), clock_(clock) {}

bool CameraReplay::do_start() {
  start_ = clock_.now();
  newest_.reset();
  given_at_ = start_;
  period_ = nominal_period(recording_);
  pending_ = false;
  return !std::exchange(played_, true) || recording_.rewind();
}

hal::Capture CameraReplay::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  if (!pending_) {
    if (recording_.next(frame_) != Read::kFrame) return hal::Capture::kGone;
    pending_ = true;
  }
  const std::chrono::microseconds stamp = start_ + frame_.time;
  const bool forward = (!newest_ || stamp > *newest_) && stamp - clock_.now() < kLongestGap;
  const std::chrono::microseconds due = forward ? stamp : given_at_ + period_;
  if (due > clock_.now() + timeout) {
    clock_.advance(timeout);
    return hal::Capture::kTimeout;
  }
  clock_.advance_to(due);
  given_at_ = clock_.now();
  if (forward) {
    if (newest_) period_ = std::min(nominal_period(recording_), stamp - *newest_);
    newest_ = stamp;
  }
  pending_ = false;
  frame = as_frame(frame_);
  frame.timestamp = stamp;
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
