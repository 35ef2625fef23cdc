// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_paced.hpp"

#include <algorithm>
#include <utility>

namespace holdfast::sim {

PacedCamera::PacedCamera(const Film& film, hal::Clock& clock, Config config)
    : film_(film), clock_(clock), config_(std::move(config)) {}

bool PacedCamera::do_start() {
  const std::chrono::microseconds now = clock_.now();
  if (!std::exchange(ever_started_, true)) began_ = now;
  next_ = (now - began_ + config_.period - std::chrono::microseconds{1}) / config_.period;  // its exposure is to come
  buffered_end_ = -1;
  return !film_.empty.empty() && !film_.held.empty();
}

void PacedCamera::fill_buffers(std::chrono::microseconds now) {
  if (next_ == buffered_end_) next_ = after_buffers_;
  if (next_ < buffered_end_ || now < began_ + config_.latency) return;
  const std::int64_t newest = (now - began_ - config_.latency) / config_.period;
  if (newest < next_ + config_.buffers) return;
  buffered_end_ = next_ + config_.buffers;
  after_buffers_ = newest + 1;
}

hal::Capture PacedCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  const std::chrono::microseconds now = clock_.now();
  fill_buffers(now);
  const std::chrono::microseconds exposure = began_ + next_ * config_.period;
  const std::chrono::microseconds wait = exposure + config_.latency - now;
  if (wait > timeout) {
    clock_.wait(timeout);
    return hal::Capture::kTimeout;
  }
  if (wait > std::chrono::microseconds{0}) clock_.wait(wait);
  frame = film_.frame(exposure - began_ >= config_.touch, static_cast<std::size_t>(next_), room_);
  frame.timestamp = exposure;
  frame.sequence = static_cast<std::uint32_t>(next_++);
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
