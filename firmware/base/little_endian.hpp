// SPDX-License-Identifier: Apache-2.0
// Numbers of up to 32 bits as little-endian bytes, whatever the machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast {

// Range: `bytes` has sizeof(Integer) of them from `at` on.
template <typename Integer>
[[nodiscard]] constexpr Integer get_le(std::span<const std::uint8_t> bytes, std::size_t at) {
  static_assert(sizeof(Integer) <= 4);
  std::uint32_t value = 0;
  for (std::size_t i = sizeof(Integer); i > 0; --i) value = value << 8U | bytes[at + i - 1];
  return static_cast<Integer>(value);
}

// Range: at least 4 bytes.
constexpr void put_le32(std::span<std::uint8_t> bytes, std::uint32_t value) {
  for (unsigned k = 0; k < 4; ++k) bytes[k] = static_cast<std::uint8_t>(value >> (8 * k));
}

}  // namespace holdfast
