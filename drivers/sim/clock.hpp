// SPDX-License-Identifier: Apache-2.0
// Virtual time. Stands still until a driver or a test moves it; starts at 0; one thread.
#pragma once

#include <algorithm>
#include <chrono>

#include "hal/clock.hpp"

namespace holdfast::sim {

class Clock final : public hal::Clock {
 public:
  // A time already past leaves the clock where it is: two drivers may share one clock and neither can
  // turn it back for the other.
  void advance_to(std::chrono::microseconds time) { now_ = std::max(now_, time); }
  void advance(std::chrono::microseconds by) { advance_to(now_ + by); }

 private:
  [[nodiscard]] std::chrono::microseconds do_now() const override { return now_; }
  void do_wait(std::chrono::microseconds time) override { advance(time); }
  std::chrono::microseconds now_{};
};

}  // namespace holdfast::sim
