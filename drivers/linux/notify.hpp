// SPDX-License-Identifier: Apache-2.0
// Tells the service manager that the process is up and still goes round: systemd's notification protocol, one datagram
// a word (sd_notify(3)). A unit with WatchdogSec= has it killed and started again when the words stop.
//
// Not here: the machine's own watchdog, which the service manager feeds.
#pragma once

#include <chrono>
#include <string_view>

namespace holdfast::drivers {

class Notify {
 public:
  // To the socket in NOTIFY_SOCKET; without it, as on a desk, nothing is told.
  Notify();
  ~Notify();
  Notify(const Notify&) = delete;
  Notify& operator=(const Notify&) = delete;

  void ready() { tell("READY=1"); }
  // At most once in kPeriod, however often it is called. Never blocks, takes no memory.
  void alive(std::chrono::microseconds now) {
    if (now < next_) return;
    next_ = now + kPeriod;
    tell("WATCHDOG=1");
  }
  [[nodiscard]] bool connected() const { return fd_ >= 0; }

 private:
  static constexpr std::chrono::microseconds kPeriod{100'000};
  void tell(std::string_view words) const;

  int fd_ = -1;
  std::chrono::microseconds next_{};
};

}  // namespace holdfast::drivers
