// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/monotonic_clock.hpp"

#include <cerrno>
#include <ctime>

namespace holdfast::drivers {

namespace {

std::chrono::microseconds world_now() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::chrono::seconds{now.tv_sec} + std::chrono::microseconds{now.tv_nsec / 1000};
}

}  // namespace

std::chrono::microseconds MonotonicClock::do_now() const {
  return world_now() / scale_;
}

// Until a moment, not for a time: a signal cuts it short, and the rest would have to be worked out.
void MonotonicClock::do_wait(std::chrono::microseconds time) {
  const auto until = world_now() + time * scale_;
  const auto seconds = std::chrono::floor<std::chrono::seconds>(until);
  const timespec moment{seconds.count(), static_cast<long>((until - seconds).count()) * 1000};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &moment, nullptr) == EINTR) {
  }
}

}  // namespace holdfast::drivers
