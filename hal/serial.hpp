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

 private:
  [[nodiscard]] virtual bool do_write(std::span<const std::uint8_t> bytes) = 0;
  [[nodiscard]] virtual std::size_t do_read(std::span<std::uint8_t> bytes) = 0;
};

}  // namespace holdfast::hal
