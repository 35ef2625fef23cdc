// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast::hal {

// Bytes that outlive the process but not the power: on a board a file under /run. A killed process leaves what it
// wrote, torn at any byte. Whoever reads it trusts nothing in it.
class Keep {
 public:
  virtual ~Keep() = default;
  // How many there are, the same for as long as the process runs; 0: the board has none.
  [[nodiscard]] std::size_t size() const { return do_size(); }
  // From byte `at` on. False: they are not to be had, or not all of them; `bytes` may be anything then.
  [[nodiscard]] bool read(std::size_t at, std::span<std::uint8_t> bytes) {
    return fits(at, bytes.size()) && do_read(at, bytes);
  }
  // False: not all of them are kept; which is the driver's to say. Never waits for a medium.
  [[nodiscard]] bool write(std::size_t at, std::span<const std::uint8_t> bytes) {
    return fits(at, bytes.size()) && do_write(at, bytes);
  }

 private:
  [[nodiscard]] bool fits(std::size_t at, std::size_t count) const { return at <= size() && count <= size() - at; }
  [[nodiscard]] virtual std::size_t do_size() const = 0;
  [[nodiscard]] virtual bool do_read(std::size_t at, std::span<std::uint8_t> bytes) = 0;
  [[nodiscard]] virtual bool do_write(std::size_t at, std::span<const std::uint8_t> bytes) = 0;
};

// A board that keeps nothing.
class NoKeep final : public Keep {
 private:
  [[nodiscard]] std::size_t do_size() const override { return 0; }
  [[nodiscard]] bool do_read(std::size_t, std::span<std::uint8_t>) override { return false; }
  [[nodiscard]] bool do_write(std::size_t, std::span<const std::uint8_t>) override { return false; }
};

}  // namespace holdfast::hal
