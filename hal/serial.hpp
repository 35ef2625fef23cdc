// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast::hal {

// A byte pipe that never blocks. Baud rate, path and hang-ups are the driver's business.
class Serial {
 public:
  virtual ~Serial() = default;
  // Takes all of `bytes` or nothing (a frame is never cut); returns whether they were taken.
  [[nodiscard]] bool write(std::span<const std::uint8_t> bytes) { return bytes.empty() || do_write(bytes); }
  // Reads what is there, at most bytes.size(); returns the count, 0 when nothing waits.
  [[nodiscard]] std::size_t read(std::span<std::uint8_t> bytes) { return bytes.empty() ? 0 : do_read(bytes); }
  // How often whoever was at the other end has gone, as far as the port can tell: the wires of a UART alone tell
  // nothing. It may go on growing while nobody is there. Up to date after a read(), and then all that the reads before
  // that one returned is from before the last time. Wraps.
  [[nodiscard]] std::uint32_t hang_ups() const { return do_hang_ups(); }

 private:
  [[nodiscard]] virtual bool do_write(std::span<const std::uint8_t> bytes) = 0;
  [[nodiscard]] virtual std::size_t do_read(std::span<std::uint8_t> bytes) = 0;
  [[nodiscard]] virtual std::uint32_t do_hang_ups() const { return 0; }
};

}  // namespace holdfast::hal
