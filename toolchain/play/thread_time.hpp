// SPDX-License-Identifier: Apache-2.0
// CPU time of the calling thread: what other programs take of the machine does not count. And wall time, which they do.
#pragma once

#include <ctime>

namespace holdfast::tool {

[[nodiscard]] inline double clock_us(clockid_t clock) {
  timespec now{};
  ::clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}
[[nodiscard]] inline double thread_us() {
  return clock_us(CLOCK_THREAD_CPUTIME_ID);
}
[[nodiscard]] inline double wall_us() {
  return clock_us(CLOCK_MONOTONIC);
}

}  // namespace holdfast::tool
