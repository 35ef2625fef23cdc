// SPDX-License-Identifier: Apache-2.0
// Text in fixed memory: what drivers say after start(). What does not fit is cut off.
#pragma once

#include <array>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <string_view>

namespace holdfast::drivers {

template <std::size_t kCapacity>
class Text {
 public:
  void clear() {
    size_ = 0;
    bytes_[0] = '\0';
  }
  Text& operator<<(std::string_view text) {
    for (const char c : text.substr(0, kCapacity - size_)) bytes_[size_++] = c;
    bytes_[size_] = '\0';
    return *this;
  }
  Text& operator<<(std::integral auto number) {
    std::array<char, 24> digits{};
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), number);
    return *this << std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data()));
  }
  [[nodiscard]] std::string_view view() const { return {bytes_.data(), size_}; }
  [[nodiscard]] const char* c_str() const { return bytes_.data(); }
  [[nodiscard]] bool empty() const { return size_ == 0; }

 private:
  std::array<char, kCapacity + 1> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace holdfast::drivers
