// SPDX-License-Identifier: Apache-2.0
// Consistent Overhead Byte Stuffing: bytes without 0x00, so that 0x00 can end a frame and nothing else.
// Cheshire & Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on Networking 7(2), 1999.
// The delimiter itself is not part of what is encoded here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace holdfast::cobs {

// Worst case: one code byte for each run of 254 bytes begun, and one for the empty message.
[[nodiscard]] constexpr std::size_t max_encoded_bytes(std::size_t bytes) {
  return bytes == 0 ? 1 : bytes + (bytes + 253) / 254;
}

// Returns the count of bytes written, nothing when `out` is shorter than max_encoded_bytes(in.size()).
// `in` and `out` must not overlap.
[[nodiscard]] constexpr std::optional<std::size_t> encode(std::span<const std::uint8_t> in,
                                                          std::span<std::uint8_t> out) {
  if (out.size() < max_encoded_bytes(in.size())) return std::nullopt;
  std::size_t code_at = 0;  // where the running block's code byte goes
  std::size_t end = 1;
  std::uint8_t code = 1;  // 1 + bytes in the running block
  const auto close = [&] {
    out[code_at] = code;
    code_at = end++;
    code = 1;
  };
  for (std::size_t i = 0; i < in.size(); ++i) {
    if (in[i] == 0) {
      close();
      continue;
    }
    out[end++] = in[i];
    // A full block stands for no zero; when the message ends with it, no empty block follows.
    if (++code == 0xFF && i + 1 < in.size()) close();
  }
  out[code_at] = code;
  return end;
}

// Returns the count of bytes written; nothing when `in` is empty, holds a 0x00, ends inside a block, or when
// `out` is too small (in.size() is always enough). `in` and `out` must not overlap.
[[nodiscard]] constexpr std::optional<std::size_t> decode(std::span<const std::uint8_t> in,
                                                          std::span<std::uint8_t> out) {
  if (in.empty()) return std::nullopt;
  std::size_t read = 0;
  std::size_t written = 0;
  while (read < in.size()) {
    const std::size_t code = in[read++];
    if (code == 0 || code - 1 > in.size() - read) return std::nullopt;
    for (std::size_t i = 1; i < code; ++i) {
      if (in[read] == 0 || written == out.size()) return std::nullopt;
      out[written++] = in[read++];
    }
    if (code != 0xFF && read < in.size()) {
      if (written == out.size()) return std::nullopt;
      out[written++] = 0;
    }
  }
  return written;
}

}  // namespace holdfast::cobs
