// SPDX-License-Identifier: Apache-2.0
// Simulated lines for two threads: the loop, and the output watchdog's.
#pragma once

#include <mutex>
#include <optional>

#include "hal/gpio.hpp"

namespace holdfast::sim {

class SharedGpio final : public hal::Gpio {
 public:
  explicit SharedGpio(hal::Gpio& gpio) : gpio_(gpio) {}

 private:
  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override {
    const std::lock_guard lock(mutex_);
    return gpio_.set(line, level);
  }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input input) override {
    const std::lock_guard lock(mutex_);
    return gpio_.read(input);
  }

  hal::Gpio& gpio_;
  std::mutex mutex_;
};

}  // namespace holdfast::sim
