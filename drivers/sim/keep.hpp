// SPDX-License-Identifier: Apache-2.0
// Memory that outlives the firmware inside a test.
#pragma once

#include <algorithm>
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
  // The file system is full: so many more bytes are taken, and then no more.
  void set_room(std::size_t bytes) { room_ = bytes; }

 private:
  [[nodiscard]] std::size_t do_size() const override { return bytes_.size(); }
  [[nodiscard]] bool do_read(std::size_t at, std::span<std::uint8_t> bytes) override {
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at), bytes.size(), bytes.begin());
    return true;
  }
  [[nodiscard]] bool do_write(std::size_t at, std::span<const std::uint8_t> bytes) override {
    const std::size_t count = std::min(bytes.size(), room_);
    std::copy_n(bytes.begin(), count, bytes_.begin() + static_cast<std::ptrdiff_t>(at));
    room_ -= count;
    return count == bytes.size();
  }

  std::vector<std::uint8_t> bytes_;
  std::size_t room_ = SIZE_MAX;
};

}  // namespace holdfast::sim
