// SPDX-License-Identifier: Apache-2.0
// What the command `load` puts together from lines of hex: a record, piece by piece and in order.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "store/models.hpp"
#include "store/sealed.hpp"
#include "store/settings.hpp"

namespace holdfast::console {

class Loading {
 public:
  static constexpr std::size_t kMostBytes = models::kMostBytes;  // 5.4 kB, the longest of all kinds
  static_assert(kMostBytes >= settings::kMostBytes);

  void begin(sealed::Kind kind) {
    kind_ = kind;
    size_ = 0;
    under_way_ = true;
  }
  void end() { under_way_ = false; }
  [[nodiscard]] bool under_way() const { return under_way_; }
  // Of the record that was announced last.
  [[nodiscard]] sealed::Kind kind() const { return kind_; }
  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return std::span(bytes_).first(size_); }

  // Two digits a byte, of the bytes from `at` on, which is where the last piece ended; so a line that was lost or came
  // twice is told. False: it is not, or it is no hex, or too much; then nothing changes. Range: any text.
  [[nodiscard]] bool add(std::size_t at, std::string_view hex) {
    if (!under_way_ || at != size_ || hex.size() % 2 != 0) return false;
    if (hex.size() / 2 > bytes_.size() - size_) return false;
    for (const char c : hex) {
      if (value_of(c) < 0) return false;
    }
    for (std::size_t k = 0; k < hex.size(); k += 2) {
      bytes_[size_++] = static_cast<std::uint8_t>(value_of(hex[k]) * 16 + value_of(hex[k + 1]));
    }
    return true;
  }

 private:
  static constexpr int value_of(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
  }

  std::array<std::uint8_t, kMostBytes> bytes_{};
  std::size_t size_ = 0;
  sealed::Kind kind_ = sealed::Kind::kSettings;
  bool under_way_ = false;
};

}  // namespace holdfast::console
