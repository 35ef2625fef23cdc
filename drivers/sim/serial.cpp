// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/serial.hpp"

#include <algorithm>

namespace holdfast::sim {

void Serial::hang_up() {
  hung_up_ = true;
  waiting_ = 0;
  ++hang_ups_;
}

bool Serial::feed(std::span<const std::uint8_t> bytes) {
  if (hung_up_ || bytes.size() > input_.size() - waiting_) return false;
  for (const std::uint8_t byte : bytes) input_[(first_ + waiting_++) % input_.size()] = byte;
  return true;
}

std::vector<std::uint8_t> Serial::output_bytes() const {
  std::vector<std::uint8_t> bytes(output_.size());
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = output_[i];
  return bytes;
}

bool Serial::do_write(std::span<const std::uint8_t> bytes) {
  if (full_ || hung_up_) {
    ++refused_;
    return false;
  }
  for (const std::uint8_t byte : bytes) output_.push(byte);
  ++taken_;
  return true;
}

std::size_t Serial::do_read(std::span<std::uint8_t> bytes) {
  const std::size_t count = std::min(bytes.size(), waiting_);
  for (std::size_t i = 0; i < count; ++i) bytes[i] = input_[(first_ + i) % input_.size()];
  if (count > 0) first_ = (first_ + count) % input_.size();
  waiting_ -= count;
  return count;
}

}  // namespace holdfast::sim
