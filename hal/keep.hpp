// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast::hal {

// Memory that outlives the process but not the power: on a board a file under /run that is mapped at start, so that
// writing it is no system call and a killed process leaves what it wrote. Whoever reads it trusts nothing in it.
class Keep {
 public:
  virtual ~Keep() = default;
  // The same bytes for as long as the process runs; empty: the board has none.
  [[nodiscard]] std::span<std::uint8_t> memory() { return do_memory(); }

 private:
  [[nodiscard]] virtual std::span<std::uint8_t> do_memory() = 0;
};

// A board that keeps nothing.
class NoKeep final : public Keep {
 private:
  [[nodiscard]] std::span<std::uint8_t> do_memory() override { return {}; }
};

}  // namespace holdfast::hal
