// SPDX-License-Identifier: Apache-2.0
// A short text of fixed size, put together from words and numbers. What does not fit is cut.
#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace holdfast::console {

template <std::size_t kMost>
class Text {
 public:
  Text& operator<<(std::string_view text) {
    const std::size_t taken = std::min(text.size(), kMost - size_);
    std::copy_n(text.begin(), taken, bytes_.begin() + static_cast<std::ptrdiff_t>(size_));
    size_ += taken;
    return *this;
  }
  Text& operator<<(std::same_as<char> auto letter) { return *this << std::string_view(&letter, 1); }
  Text& operator<<(std::int64_t value) {
    std::array<char, 24> digits;
    const auto* const end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return *this << std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data()));
  }
  void clear() { size_ = 0; }
  [[nodiscard]] std::string_view view() const { return {bytes_.data(), size_}; }

 private:
  std::array<char, kMost> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace holdfast::console
