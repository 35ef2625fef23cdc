// SPDX-License-Identifier: Apache-2.0
// A progress bar with the time left, on stderr, for a person at a terminal and for anything over a second.
#pragma once

#include <string>

namespace holdfast::tool {

class Progress {
 public:
  // `total` <= 0: unknown; then only the count is shown. Silent unless stderr is a terminal.
  Progress(std::string what, long total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void update(long done);

 private:
  std::string what_;
  long total_;
  bool terminal_;
  bool shown_ = false;
  double start_s_;
  double last_s_ = 0;
};

}  // namespace holdfast::tool
