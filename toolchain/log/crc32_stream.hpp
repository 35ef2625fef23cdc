// SPDX-License-Identifier: Apache-2.0
// firmware/base/crc32.hpp's sum, of bytes that come in pieces, and eight of them at a time: a log of 8-megapixel
// pictures is summed twice, and bit by bit that would take longer than the firmware does.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast::log {

class Crc32Stream {
 public:
  void add(std::span<const std::uint8_t> bytes) {
    std::size_t i = 0;
    for (; bytes.size() - i >= 8; i += 8) {
      const std::uint8_t* const at = bytes.data() + i;
      const std::uint32_t low =
          crc_ ^ (at[0] | std::uint32_t{at[1]} << 8 | std::uint32_t{at[2]} << 16 | std::uint32_t{at[3]} << 24);
      crc_ = kTables[7][low & 0xFF] ^ kTables[6][low >> 8 & 0xFF] ^ kTables[5][low >> 16 & 0xFF] ^
             kTables[4][low >> 24] ^ kTables[3][at[4]] ^ kTables[2][at[5]] ^ kTables[1][at[6]] ^ kTables[0][at[7]];
    }
    for (; i < bytes.size(); ++i) crc_ = crc_ >> 8 ^ kTables[0][(crc_ ^ bytes[i]) & 0xFF];
  }
  [[nodiscard]] std::uint32_t sum() const { return ~crc_; }

 private:
  // kTables[k][b]: what byte b does to the sum when k more bytes follow it.
  static constexpr std::array<std::array<std::uint32_t, 256>, 8> kTables = [] {
    std::array<std::array<std::uint32_t, 256>, 8> tables{};
    for (std::uint32_t b = 0; b < 256; ++b) {
      std::uint32_t crc = b;
      for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
      tables[0][b] = crc;
    }
    for (std::size_t k = 1; k < tables.size(); ++k) {
      for (std::size_t b = 0; b < 256; ++b) {
        const std::uint32_t before = tables[k - 1][b];
        tables[k][b] = before >> 8 ^ tables[0][before & 0xFF];
      }
    }
    return tables;
  }();

  std::uint32_t crc_ = 0xFFFFFFFF;
};

}  // namespace holdfast::log
