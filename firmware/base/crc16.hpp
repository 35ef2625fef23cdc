// SPDX-License-Identifier: Apache-2.0
// CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected, no final xor (the catalogue's
// CRC-16/IBM-3740). Finds every error of one or two bits in messages up to 4095 bytes and every burst of up
// to 16 bits. Range: any length; the value is kept in 16 bits throughout.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast {

namespace crc16_detail {

inline constexpr std::uint16_t kPolynomial = 0x1021;

consteval std::array<std::uint16_t, 256> make_table() {
  std::array<std::uint16_t, 256> table{};
  for (std::uint32_t byte = 0; byte < table.size(); ++byte) {
    std::uint32_t crc = byte << 8;
    for (int bit = 0; bit < 8; ++bit) crc = (crc << 1) ^ ((crc & 0x8000U) != 0 ? kPolynomial : 0U);
    table[byte] = static_cast<std::uint16_t>(crc);
  }
  return table;
}

inline constexpr std::array<std::uint16_t, 256> kTable = make_table();

}  // namespace crc16_detail

// `crc` continues an earlier part of the same message.
[[nodiscard]] constexpr std::uint16_t crc16(std::span<const std::uint8_t> bytes, std::uint16_t crc = 0xFFFF) {
  for (const std::uint8_t byte : bytes) {
    const auto top = static_cast<std::uint8_t>((crc >> 8) ^ byte);
    crc = static_cast<std::uint16_t>((crc << 8) ^ crc16_detail::kTable[top]);
  }
  return crc;
}

// The catalogue's check value: the CRC of the ASCII digits "123456789".
static_assert(crc16(std::array<std::uint8_t, 9>{'1', '2', '3', '4', '5', '6', '7', '8', '9'}) == 0x29B1);

}  // namespace holdfast
