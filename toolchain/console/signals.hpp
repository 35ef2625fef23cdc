// SPDX-License-Identifier: Apache-2.0
// Ctrl-C, the end and the window's size as something to wait for, beside ports and keys. While one lives no such signal
// interrupts anything: whoever waits asks take(), and a terminal is restored on every way out.
#pragma once

#include <csignal>
#include <cstdint>

namespace holdfast::console_tool {

class Signals {
 public:
  enum class What : std::uint8_t { kNone, kInterrupt, kEnd, kResize };

  Signals();
  ~Signals();
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  [[nodiscard]] int fd() const { return fd_; }
  // Without waiting. kEnd stays: whoever asks later hears it, too.
  [[nodiscard]] What take();
  [[nodiscard]] bool ended() const { return ended_; }
  // take(), where either means the same.
  [[nodiscard]] bool over() {
    const What what = take();
    return what == What::kInterrupt || what == What::kEnd;
  }

 private:
  sigset_t before_{};
  int fd_ = -1;
  bool ended_ = false;
};

}  // namespace holdfast::console_tool
