// SPDX-License-Identifier: Apache-2.0
// CRC-32 as in Ethernet, gzip and PNG (CRC-32/ISO-HDLC): reflected polynomial 0xEDB88320, start and final xor
// 0xFFFFFFFF. Names a model or a file by its content; bit by bit, because that happens once per start.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace holdfast {

[[nodiscard]] constexpr std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = 0xFFFFFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

// The catalogue's check value: the CRC of the ASCII digits "123456789".
static_assert(crc32(std::array<std::uint8_t, 9>{'1', '2', '3', '4', '5', '6', '7', '8', '9'}) == 0xCBF43926);

}  // namespace holdfast
