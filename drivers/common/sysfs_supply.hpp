// SPDX-License-Identifier: Apache-2.0
// The supply of a board by what its kernel says in /sys. Two files are known:
//
//   class/hwmon/hwmonN/in0_lcrit_alarm  of the sensor with the given name ("rpi_volt"): 1 while the voltage is too low.
//                                       The kernel asks the board's firmware every 2 s and keeps the answer.
//   .../soc:firmware/get_throttled      of Raspberry Pi's own kernels: bit 0 of a number in base 16
//
// A thread of its own reads once a second: the second file is a question to the firmware that may take the kernel a
// second (its time-out for the mailbox), and no frame waits for that.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "hal/supply.hpp"

namespace holdfast::drivers {

class SysfsSupply final : public hal::Supply {
 public:
  struct Config {
    std::string sensor = "rpi_volt";
    std::string sys = "/sys";
  };
  explicit SysfsSupply(Config config) : config_(std::move(config)) {}
  ~SysfsSupply() override;
  SysfsSupply(const SysfsSupply&) = delete;
  SysfsSupply& operator=(const SysfsSupply&) = delete;

  // Reads from now on; uses the heap, and nothing does afterwards. Without a thread nothing is reported.
  void start();
  // Reads once: what the thread does. A sensor whose driver comes late is found then.
  void look();
  // Looked for this often in a row without one.
  [[nodiscard]] int missed() const { return missed_.load(std::memory_order_relaxed); }

 private:
  [[nodiscard]] State do_state() const override { return state_.load(std::memory_order_relaxed); }
  [[nodiscard]] State by_hwmon();
  [[nodiscard]] State by_firmware() const;

  const Config config_;
  int sensor_ = 0;  // N of hwmonN that answered last
  std::atomic<State> state_{State::kUnknown};
  std::atomic<int> missed_{0};
  std::mutex mutex_;
  std::condition_variable wake_;
  bool end_ = false;
  std::thread thread_;
};

}  // namespace holdfast::drivers
