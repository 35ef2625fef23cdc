// SPDX-License-Identifier: Apache-2.0
// CPU time of the calling thread: what other programs take of the machine does not count.
#pragma once

#include <ctime>

namespace holdfast::tool {

[[nodiscard]] inline double thread_us() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

}  // namespace holdfast::tool
