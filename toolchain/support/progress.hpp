// SPDX-License-Identifier: Apache-2.0
// A progress bar with the time left, on stderr, for a person at a terminal and for anything over a second. It knows
// no escape codes, so NO_COLOR and dumb terminals need no case of their own.
#pragma once

#include <cstddef>
#include <string>

namespace holdfast::tool {

class Progress {
 public:
  // `total` <= 0: unknown; then only the count is shown. Silent unless stderr is a terminal.
  Progress(std::string what, long total);
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void update(long done);
  // Takes the bar away; before anything else is printed.
  void clear();

 private:
  void show(const std::string& text);

  std::string what_;
  long total_;
  bool terminal_;
  std::size_t width_ = 0;  // of what stands on the line: longer texts are painted over with blanks
  double start_s_;
  double last_s_ = 0;
};

}  // namespace holdfast::tool
