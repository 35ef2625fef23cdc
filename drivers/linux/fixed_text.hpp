// SPDX-License-Identifier: Apache-2.0
// Text in fixed memory: what drivers say and look for after start().
#pragma once

#include <array>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <string_view>

namespace holdfast::drivers {

// At most kMost letters; what is longer is cut.
template <std::size_t kMost>
class FixedText {
 public:
  FixedText() = default;
  FixedText(std::string_view text) { *this += text; }  // NOLINT(google-explicit-constructor): a text is a text
  FixedText& operator+=(std::string_view text) {
    for (const char letter : text.substr(0, kMost - size_)) letters_[size_++] = letter;
    return *this;
  }
  FixedText& operator<<(std::string_view text) { return *this += text; }
  FixedText& operator<<(std::integral auto number) {
    std::array<char, 24> digits{};
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), number);
    return *this += std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data()));
  }
  [[nodiscard]] std::string_view view() const { return {letters_.data(), size_}; }
  operator std::string_view() const { return view(); }                 // NOLINT(google-explicit-constructor)
  [[nodiscard]] const char* c_str() const { return letters_.data(); }  // a zero follows
  [[nodiscard]] bool empty() const { return size_ == 0; }

 private:
  std::array<char, kMost + 1> letters_{};
  std::size_t size_ = 0;
};

}  // namespace holdfast::drivers
