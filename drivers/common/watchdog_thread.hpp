// SPDX-License-Identifier: Apache-2.0
// The thread that an output watchdog needs (app/watchdog.hpp): it looks every OutputWatchdog::kPeriod, whatever the
// thread that reads the camera does.
#pragma once

#include <atomic>
#include <thread>

#include "app/watchdog.hpp"
#include "hal/clock.hpp"
#include "hal/gpio.hpp"

namespace holdfast::drivers {

class WatchdogThread {
 public:
  // All outlive it; gpio and clock take calls from two threads. Uses the heap; afterwards nothing does.
  WatchdogThread(OutputWatchdog& watchdog, hal::Gpio& gpio, hal::Clock& clock);
  ~WatchdogThread();
  WatchdogThread(const WatchdogThread&) = delete;
  WatchdogThread& operator=(const WatchdogThread&) = delete;

  // False: the system gave no thread.
  [[nodiscard]] bool running() const { return thread_.joinable(); }

 private:
  std::atomic<bool> end_{false};
  std::thread thread_;
};

}  // namespace holdfast::drivers
