// SPDX-License-Identifier: Apache-2.0
// The whole terminal for a while: keys one by one, lines where they belong, and everything as it was at the end.
// Codes of a VT100, and the second screen of those terminals that have one.
#pragma once

#include <termios.h>

#include <optional>
#include <string>
#include <vector>

namespace holdfast::console_tool {

class Screen {
 public:
  Screen();
  ~Screen();
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  struct Size {
    int columns = 80;
    int rows = 24;
  };
  [[nodiscard]] Size size() const;
  // A key that was pressed; without waiting.
  [[nodiscard]] std::optional<char> key() const;
  // Writes what differs from before, at once.
  void show(const std::vector<std::string>& lines);
  // The next show() writes everything.
  void forget();

 private:
  termios before_{};
  bool raw_ = false;
  bool cleared_ = false;
  std::vector<std::string> shown_;
};

}  // namespace holdfast::console_tool
