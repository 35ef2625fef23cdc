// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_faults.hpp"

#include <algorithm>
#include <utility>

namespace holdfast::sim {

const FaultSpan& FaultyCamera::fault_at(std::uint64_t index) const {
  static constexpr FaultSpan kNoFault{};
  for (const FaultSpan& span : schedule_) {
    const std::uint64_t length = span.fault == CameraFault::kGone ? 1 : span.count;
    if (index >= span.first && index - span.first < length) return span;
  }
  return kNoFault;
}

bool FaultyCamera::do_start() {
  if (refusals_ > 0) {
    --refusals_;
    return false;
  }
  holding_ = false;
  off_frames_ = 0;
  kept_bytes_ = 0;
  return inside_.start();
}

void FaultyCamera::do_stop() {
  if (std::exchange(holding_, false)) inside_.release(true_frame_);
  inside_.stop();
}

void FaultyCamera::do_release(const hal::Frame& /*frame*/) {
  inside_.release(true_frame_);
}

hal::Capture FaultyCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  const std::chrono::microseconds deadline = clock_.now() + timeout;
  while (!holding_) {
    const FaultSpan& span = fault_at(index_);
    if (span.fault == CameraFault::kGone) {
      ++index_;
      refusals_ = span.count;
      inside_.stop();
      return hal::Capture::kGone;
    }
    const hal::Capture capture = inside_.next(true_frame_, deadline - clock_.now());
    if (capture != hal::Capture::kFrame) return capture;
    ++index_;
    if (span.fault == CameraFault::kOff || span.fault == CameraFault::kDropped) {
      if (span.fault == CameraFault::kOff) ++off_frames_;
      inside_.release(true_frame_);
      continue;
    }
    if (span.fault == CameraFault::kBad) {
      inside_.release(true_frame_);
      return hal::Capture::kBad;
    }

    shown_ = true_frame_;
    shown_.sequence -= off_frames_;
    if (span.fault == CameraFault::kStuck && kept_bytes_ > 0) {
      shown_.bytes = std::span(kept_).first(kept_bytes_);
    } else if (span.fault == CameraFault::kGarbage) {
      made_.resize(std::max(made_.size(), true_frame_.bytes.size()));
      const std::span bytes = std::span(made_).first(true_frame_.bytes.size());
      for (std::uint8_t& byte : bytes) {
        random_ ^= random_ << 13;
        random_ ^= random_ >> 17;
        random_ ^= random_ << 5;
        byte = static_cast<std::uint8_t>(random_ >> 24);
      }
      shown_.bytes = bytes;
    } else if (span.fault == CameraFault::kTorn && kept_bytes_ > 0) {
      const std::size_t half = true_frame_.bytes.size() / 2;
      const std::size_t size = std::max(half, kept_bytes_);
      made_.resize(std::max(made_.size(), size));
      std::copy_n(true_frame_.bytes.begin(), half, made_.begin());
      std::copy(kept_.begin() + static_cast<std::ptrdiff_t>(half), kept_.begin() + static_cast<std::ptrdiff_t>(size),
                made_.begin() + static_cast<std::ptrdiff_t>(half));
      shown_.bytes = std::span(made_).first(size);
    } else if (span.fault == CameraFault::kBackwards) {
      shown_.timestamp = last_timestamp_ - span.by;
    }
    last_timestamp_ = shown_.timestamp;
    // Copied only when the next frame needs it: a long healthy run pays nothing.
    const CameraFault next = fault_at(index_).fault;
    if (span.fault != CameraFault::kStuck && (next == CameraFault::kStuck || next == CameraFault::kTorn)) {
      const std::span<const std::uint8_t> keep = span.fault == CameraFault::kTorn ? true_frame_.bytes : shown_.bytes;
      kept_bytes_ = keep.size();
      kept_.resize(std::max(kept_.size(), kept_bytes_));
      std::copy_n(keep.begin(), kept_bytes_, kept_.begin());
    }
    due_ = clock_.now() + (span.fault == CameraFault::kLate ? span.by : std::chrono::microseconds{0});
    holding_ = true;
  }
  return hand_out(frame, deadline);
}

hal::Capture FaultyCamera::hand_out(hal::Frame& frame, std::chrono::microseconds deadline) {
  if (due_ > deadline) {
    clock_.advance_to(deadline);
    return hal::Capture::kTimeout;
  }
  clock_.advance_to(due_);
  holding_ = false;
  frame = shown_;
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
