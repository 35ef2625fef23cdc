// SPDX-License-Identifier: Apache-2.0
// A serial port that other programs can open: the master's side of a pseudo terminal, raw and non-blocking.
//
// While nobody has opened the other side, or after it was closed, the cable is out: nothing is read, writes are
// refused, and what was on its way is lost. Opening it (again) plugs the cable in. Each time that somebody closes it is
// a hang-up, also when somebody else has it open or opens it at once, of which the master's side alone would not tell;
// and each read while nobody has it open is one.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "hal/serial.hpp"

namespace holdfast::sim {

class SerialPty final : public hal::Serial {
 public:
  // The kernel takes this much at once; a message that is longer is refused.
  static constexpr std::size_t kLongest = 4096;

  SerialPty();  // opened() tells whether there was a pseudo terminal to be had
  ~SerialPty() override;
  SerialPty(const SerialPty&) = delete;
  SerialPty& operator=(const SerialPty&) = delete;

  [[nodiscard]] bool opened() const { return master_ >= 0; }
  // Of the other side, for whoever wants to open it.
  [[nodiscard]] const std::string& path() const { return path_; }
  // Somebody has opened it.
  [[nodiscard]] bool connected() const;
  // Waits for something to read, in real time and at most this long, also while nobody has opened the other side.
  void wait(std::chrono::milliseconds at_most) const;

 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override;
  [[nodiscard]] std::uint32_t do_hang_ups() const override { return hang_ups_; }
  // Sends on what did not fit. True: nothing is left.
  [[nodiscard]] bool flush();
  void shut();

  int master_ = -1;
  int closings_ = -1;  // inotify's, of the other side
  std::uint32_t hang_ups_ = 0;
  std::string path_;
  // The rest of a message that the kernel took in part: it has to follow, whatever comes next.
  std::array<std::uint8_t, kLongest> rest_{};
  std::size_t rest_begin_ = 0;
  std::size_t rest_end_ = 0;
};

}  // namespace holdfast::sim
