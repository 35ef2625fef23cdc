// SPDX-License-Identifier: Apache-2.0
#include "console/output.hpp"

#include <algorithm>
#include <charconv>

namespace holdfast::console {
namespace {

// Of the port at once: a frame is never cut by it, and a driver's buffer takes it whole.
constexpr std::size_t kPiece = 64;

constexpr std::array<std::int64_t, 10> kPowersOfTen{1,       10,        100,        1'000,       10'000,
                                                    100'000, 1'000'000, 10'000'000, 100'000'000, 1'000'000'000};

}  // namespace

bool Output::put(std::string_view text) {
  return put(std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

bool Output::put(std::span<const std::uint8_t> bytes) {
  if (bytes.empty()) return true;
  if (bytes.size() > room()) {
    count_up(lost_);
    return false;
  }
  for (const std::uint8_t byte : bytes) {
    ring_[(begin_ + size_) % kBytes] = byte;
    ++size_;
    ++column_;
    if (byte == '\n') column_ = 0;
  }
  last_ = bytes.back();
  return true;
}

bool Output::put_frame(std::span<const std::uint8_t> wire) {
  if (wire.size() + 1 > room()) {
    count_up(lost_);
    return false;
  }
  ring_[(begin_ + size_++) % kBytes] = 0;
  for (const std::uint8_t byte : wire) ring_[(begin_ + size_++) % kBytes] = byte;
  return true;
}

void Output::integer(std::int64_t value) {
  std::array<char, 24> digits;
  const auto* const end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  put(std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data())));
}

void Output::decimal(std::int64_t value, std::int64_t denominator, int decimals) {
  const std::int64_t power = kPowersOfTen[idx(decimals)];
  const std::int64_t scaled = div_round(value * power, denominator);
  const std::int64_t size = scaled < 0 ? -scaled : scaled;
  if (scaled < 0) put("-");
  integer(size / power);
  if (decimals == 0) return;
  put(".");
  for (std::int64_t place = power / 10, rest = size % power; place > 0; place /= 10) {
    const char digit = static_cast<char>('0' + rest / place % 10);
    put(std::string_view(&digit, 1));
  }
}

void Output::escaped(std::string_view text) {
  constexpr std::string_view kHex = "0123456789abcdef";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      const std::array<char, 2> pair{'\\', c};
      put(std::string_view(pair.data(), pair.size()));
    } else if (byte < 0x20 || byte >= 0x7F) {
      const std::array<char, 6> code{'\\', 'u', '0', '0', kHex[byte >> 4], kHex[byte & 15]};
      put(std::string_view(code.data(), code.size()));
    } else {
      put(std::string_view(&c, 1));
    }
  }
}

void Output::flush(hal::Serial& port, std::size_t most) {
  while (size_ > 0 && most > 0) {
    const std::size_t piece = std::min({size_, kBytes - begin_, kPiece, most});
    if (!port.write(std::span(ring_).subspan(begin_, piece))) return;
    begin_ = (begin_ + piece) % kBytes;
    size_ -= piece;
    most -= piece;
  }
}

}  // namespace holdfast::console
