// SPDX-License-Identifier: Apache-2.0
// 32-bit numbers as little-endian bytes, whatever the machine. Range: spans of at least 4 bytes.
#pragma once

#include <cstdint>
#include <span>

namespace holdfast {

[[nodiscard]] constexpr std::uint32_t get_le32(std::span<const std::uint8_t> bytes) {
  return static_cast<std::uint32_t>(bytes[0]) | static_cast<std::uint32_t>(bytes[1]) << 8U |
         static_cast<std::uint32_t>(bytes[2]) << 16U | static_cast<std::uint32_t>(bytes[3]) << 24U;
}

constexpr void put_le32(std::span<std::uint8_t> bytes, std::uint32_t value) {
  for (unsigned k = 0; k < 4; ++k) bytes[k] = static_cast<std::uint8_t>(value >> (8 * k));
}

}  // namespace holdfast
