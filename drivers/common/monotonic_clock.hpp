// SPDX-License-Identifier: Apache-2.0
// CLOCK_MONOTONIC: the time base that V4L2 stamps its frames with.
#pragma once

#include <chrono>

#include "hal/clock.hpp"

namespace holdfast::drivers {

class MonotonicClock final : public hal::Clock {
 private:
  [[nodiscard]] std::chrono::microseconds do_now() const override;
  void do_wait(std::chrono::microseconds time) override;
};

}  // namespace holdfast::drivers
