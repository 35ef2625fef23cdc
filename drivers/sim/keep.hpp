// SPDX-License-Identifier: Apache-2.0
// Memory that outlives the firmware inside a test.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hal/keep.hpp"

namespace holdfast::sim {

class Keep final : public hal::Keep {
 public:
  explicit Keep(std::size_t bytes) : bytes_(bytes) {}

  // What a fault does to it.
  [[nodiscard]] std::span<std::uint8_t> bytes() { return bytes_; }
  void set_off(bool off) { off_ = off; }

 private:
  [[nodiscard]] std::span<std::uint8_t> do_memory() override { return off_ ? std::span<std::uint8_t>{} : bytes_; }

  std::vector<std::uint8_t> bytes_;
  bool off_ = false;
};

}  // namespace holdfast::sim
