// SPDX-License-Identifier: Apache-2.0
// What the console has to say, on its way out: a ring of bytes that a slow or absent reader fills up and nothing else
// waits for. Numbers are written without floating point.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/math.hpp"
#include "hal/serial.hpp"

namespace holdfast::console {

class Output {
 public:
  static constexpr std::size_t kBytes = 4096;

  // All of it or nothing; what is lost is counted. Who has more to say than room() waits.
  bool put(std::string_view text);
  bool put(std::span<const std::uint8_t> bytes);
  // A frame of link.hpp between two lines: a delimiter before it, and the line's place stays as it was.
  bool put_frame(std::span<const std::uint8_t> wire);
  void integer(std::int64_t value);
  // value / denominator, rounded to so many decimals. Range: |value| * 10^decimals < 2^62, denominator in [1, 2^31].
  void decimal(std::int64_t value, std::int64_t denominator, int decimals);
  // As it stands in a JSON string, without the quotes.
  void escaped(std::string_view text);

  [[nodiscard]] std::size_t room() const { return kBytes - size_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  // The last byte ended a line, or nothing was ever said.
  [[nodiscard]] bool at_line_start() const { return last_ == '\n'; }
  // Columns since the line began.
  [[nodiscard]] std::size_t column() const { return column_; }
  [[nodiscard]] std::uint32_t lost() const { return lost_; }
  void clear() { size_ = 0; }

  // Hands over what the port takes, at most `most` bytes. A port that refuses is asked again the next time.
  void flush(hal::Serial& port, std::size_t most);

 private:
  std::array<std::uint8_t, kBytes> ring_{};
  std::size_t begin_ = 0, size_ = 0;
  std::size_t column_ = 0;
  std::uint8_t last_ = '\n';
  std::uint32_t lost_ = 0;
};

}  // namespace holdfast::console
