// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace holdfast::hal {

// Monotonic time since an arbitrary start; never steps back, never jumps with the wall clock.
// Simulated clocks move only when a driver advances them.
class Clock {
 public:
  virtual ~Clock() = default;
  [[nodiscard]] std::chrono::microseconds now() const { return do_now(); }
  // Lets so much time pass: for a loop that has no device to wait for.
  void wait(std::chrono::microseconds time) { do_wait(time); }

 private:
  [[nodiscard]] virtual std::chrono::microseconds do_now() const = 0;
  virtual void do_wait(std::chrono::microseconds time) = 0;
};

}  // namespace holdfast::hal
