// SPDX-License-Identifier: Apache-2.0
// CLOCK_MONOTONIC: the time base that V4L2 stamps its frames with.
//
// An emulated board is slow: there one of the firmware's seconds may be `scale` of the world's, so that every deadline,
// watchdog included, stretches alike (board/virt).
#pragma once

#include <chrono>
#include <cstdint>

#include "hal/clock.hpp"

namespace holdfast::drivers {

class MonotonicClock final : public hal::Clock {
 public:
  explicit MonotonicClock(std::int32_t scale = 1) : scale_(scale) {}

 private:
  [[nodiscard]] std::chrono::microseconds do_now() const override;
  void do_wait(std::chrono::microseconds time) override;

  std::int32_t scale_;
};

}  // namespace holdfast::drivers
