// SPDX-License-Identifier: Apache-2.0
// Lowers GRIP_OK when the thread that reads the camera no longer comes round: a driver that never returns from an
// unplugged device (raspberrypi/linux #1211), or a board without time for it.
//
// watch() belongs to a thread of its own that touches nothing but this object and the line. There is no lock: a driver
// may hang inside the line's call as well. The two threads may cross in both orders, and both are safe: a LOW after a
// HIGH that was just earned costs one frame of "not fine", a HIGH after a LOW was earned by a frame of that moment.
#pragma once

#include <atomic>
#include <cstdint>

#include "base/units.hpp"
#include "hal/gpio.hpp"

namespace holdfast {

class OutputWatchdog {
 public:
  // The supervisor acts at 150 ms and a receiver at the age of ALIVE; a thread that is silent for longer hangs.
  static constexpr Micros kHold{200'000};
  static constexpr Micros kPeriod{10'000};  // how often watch() is to be called

  // An accepted frame was decided, and the lines obeyed.
  void confirm(Micros now) { confirmed_us_.store(now.count(), std::memory_order_release); }
  // GRIP_OK was lowered for good: nothing to watch until the next confirm().
  void rest() { confirmed_us_.store(kNever, std::memory_order_release); }

  // From the watching thread. Returns whether GRIP_OK was told LOW.
  bool watch(hal::Gpio& gpio, Micros now) {
    const std::int64_t confirmed_us = confirmed_us_.load(std::memory_order_acquire);
    if (confirmed_us == kNever) return false;
    const std::int64_t age_us = now.count() - confirmed_us;
    if (age_us >= 0 && age_us <= kHold.count()) return false;
    // A refusal leaves ALIVE, which stands still.
    (void)gpio.set(hal::Line::kGripOk, hal::Level::kLow);
    if (confirmed_us != tripped_at_us_) {
      tripped_at_us_ = confirmed_us;
      trips_.fetch_add(1, std::memory_order_release);
    }
    return true;
  }

  // How often the camera's thread was found late since start.
  [[nodiscard]] std::uint32_t trips() const { return trips_.load(std::memory_order_acquire); }

 private:
  static constexpr std::int64_t kNever = INT64_MIN;
  std::atomic<std::int64_t> confirmed_us_{kNever};
  std::atomic<std::uint32_t> trips_{0};
  std::int64_t tripped_at_us_ = kNever;  // of the watching thread alone
};

}  // namespace holdfast
