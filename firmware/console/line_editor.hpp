// SPDX-License-Identifier: Apache-2.0
// A line of text under somebody's fingers: insertion, arrows, Home and End, Ctrl-A/E/U/K/W/C/L, Delete, and the last
// sixteen lines. Bytes in, bytes of a VT100 terminal out. Fixed memory; a byte costs at most one redrawn line.
//
// CR, LF and CRLF each end one line. A line longer than kMost, or with bytes that no key of text makes, is still ended
// by its end, and then told as such: it never becomes a command by being cut.
// Shown is what fits one row of kColumns; longer lines scroll sideways.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "console/output.hpp"

namespace holdfast::console {

class LineEditor {
 public:
  static constexpr std::size_t kMost = 255;
  static constexpr std::size_t kHistory = 16;
  static constexpr std::size_t kColumns = 79;

  enum class Event : std::uint8_t { kNone, kLine, kTooLong, kDamaged, kTab, kInterrupt };

  // The text of a kLine is line(), until the next push(). Range: any byte.
  Event push(std::uint8_t byte, Output& out);

  [[nodiscard]] std::string_view line() const { return {text_.data(), size_}; }
  [[nodiscard]] std::size_t cursor() const { return cursor_; }

  // Shows prompt and line as they are, on a row of its own.
  void prompt(std::string_view prompt, Output& out);
  // As if typed.
  void insert(std::string_view text, Output& out);
  // Not of lines that hold a secret.
  void remember_line();
  // Takes the line away without a word.
  void forget_line();
  void set_echo(bool echo) { echo_ = echo; }
  [[nodiscard]] bool echo() const { return echo_; }

 private:
  struct Past {
    std::array<char, kMost> text{};
    std::size_t size = 0;
  };

  Event control(std::uint8_t byte, Output& out);
  Event end_line(Output& out);
  void escape(std::uint8_t byte, Output& out);
  void key(char final, Output& out);
  void move_to(std::size_t cursor, Output& out);
  void erase(std::size_t begin, std::size_t end, Output& out);
  void recall(std::size_t back, Output& out);
  void redraw(Output& out) const;

  std::array<char, kMost> text_{};
  std::size_t size_ = 0, cursor_ = 0;
  bool too_long_ = false, damaged_ = false;
  bool echo_ = true;
  bool after_cr_ = false;
  bool ended_ = false;  // the line was handed out: the next byte begins another

  enum class Escape : std::uint8_t { kNone, kBegun, kBracket };
  Escape escape_ = Escape::kNone;
  std::uint8_t escape_digit_ = 0;

  std::string_view prompt_;
  std::array<Past, kHistory> past_{};
  std::size_t past_at_ = 0, past_count_ = 0;
  std::size_t back_ = 0;  // how far back in the history the shown line is; 0: it is new
};

}  // namespace holdfast::console
