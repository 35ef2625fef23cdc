// SPDX-License-Identifier: Apache-2.0
// How long a test waits for another process, a terminal or a file before it fails. Only a failing test waits so long.
#pragma once

#include <poll.h>

#include <chrono>

namespace holdfast::test {

// The bytes of a pseudo terminal go through the kernel's work queues, and those stood still for up to 160 s on a
// virtual machine of two processors under load ("workqueue lockup" in its log, 2026-11-26).
inline constexpr std::chrono::seconds kDeadline{300};

// Looks until `condition`; whether it came in time.
template <typename Condition>
[[nodiscard]] bool until(const Condition& condition) {
  const auto limit = std::chrono::steady_clock::now() + kDeadline;
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= limit) return false;
    (void)::poll(nullptr, 0, 5);
  }
  return true;
}

}  // namespace holdfast::test
