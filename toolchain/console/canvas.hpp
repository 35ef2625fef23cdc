// SPDX-License-Identifier: Apache-2.0
// A screen of letters, each in a style; what does not fit is cut. Becomes lines of UTF-8, with or without colors.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::console_tool {

enum class Style : std::uint8_t { kPlain, kDim, kBold, kGood, kWarn, kBad };

class Canvas {
 public:
  Canvas(int columns, int rows)
      : columns_(std::max(columns, 0)),
        rows_(std::max(rows, 0)),
        cells_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_)) {}

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }

  void set(int x, int y, char32_t letter, Style style = Style::kPlain) {
    if (x < 0 || y < 0 || x >= columns_ || y >= rows_) return;
    cells_[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(x)] = {letter,
                                                                                                              style};
  }
  // ASCII; any other byte becomes '?'. Returns the column behind it.
  int put(int x, int y, std::string_view text, Style style = Style::kPlain) {
    for (const char c : text) set(x++, y, c >= ' ' && c <= '~' ? static_cast<char32_t>(c) : U'?', style);
    return x;
  }

  // Without the blanks at their ends.
  [[nodiscard]] std::vector<std::string> lines(bool color) const {
    std::vector<std::string> out;
    for (int y = 0; y < rows_; ++y) {
      const Cell* const row = cells_.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_);
      int width = columns_;
      while (width > 0 && row[width - 1].letter == U' ') --width;
      std::string line;
      Style style = Style::kPlain;
      for (int x = 0; x < width; ++x) {
        if (color && row[x].style != style) line += code(style = row[x].style);
        append(line, row[x].letter);
      }
      if (style != Style::kPlain) line += code(Style::kPlain);
      out.push_back(std::move(line));
    }
    return out;
  }

 private:
  struct Cell {
    char32_t letter = U' ';
    Style style = Style::kPlain;
  };

  [[nodiscard]] static std::string_view code(Style style) {
    switch (style) {
      case Style::kDim:
        return "\x1B[0;2m";
      case Style::kBold:
        return "\x1B[0;1m";
      case Style::kGood:
        return "\x1B[0;32m";
      case Style::kWarn:
        return "\x1B[0;33m";
      case Style::kBad:
        return "\x1B[0;1;31m";
      case Style::kPlain:
        break;
    }
    return "\x1B[0m";
  }
  // Range: letters below U+10000.
  static void append(std::string& out, char32_t letter) {
    if (letter < 0x80) {
      out += static_cast<char>(letter);
    } else if (letter < 0x800) {
      out += static_cast<char>(0xC0 | letter >> 6);
      out += static_cast<char>(0x80 | (letter & 0x3F));
    } else {
      out += static_cast<char>(0xE0 | letter >> 12);
      out += static_cast<char>(0x80 | (letter >> 6 & 0x3F));
      out += static_cast<char>(0x80 | (letter & 0x3F));
    }
  }

  int columns_, rows_;
  std::vector<Cell> cells_;
};

}  // namespace holdfast::console_tool
