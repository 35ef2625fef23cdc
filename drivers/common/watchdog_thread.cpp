// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/watchdog_thread.hpp"

#include <system_error>

namespace holdfast::drivers {

WatchdogThread::WatchdogThread(OutputWatchdog& watchdog, hal::Gpio& gpio, hal::Clock& clock) {
  try {
    thread_ = std::thread([this, &watchdog, &gpio, &clock] {
      while (!end_.load(std::memory_order_acquire)) {
        (void)watchdog.watch(gpio, clock.now());
        clock.wait(OutputWatchdog::kPeriod);
      }
    });
  } catch (const std::system_error&) {
    thread_ = {};  // running() says so
  }
}

WatchdogThread::~WatchdogThread() {
  end_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

}  // namespace holdfast::drivers
