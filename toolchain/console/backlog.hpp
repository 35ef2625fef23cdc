// SPDX-License-Identifier: Apache-2.0
// What a bridge has to know of a board's frames beside what they say.
//
// Whether what a port brings is of now: a program that stood still (SIGSTOP, a machine that slept) finds frames that
// waited meanwhile: they describe the past, up to the first silence of the port. tcflush() would leave what the kernel
// holds behind a full buffer.
#pragma once

#include <cstdint>

#include "toolchain/robot/holdfast_link.h"

namespace holdfast::console_tool {

// A gap in the sequence that is longer, at 25 frames a second 40 s, is taken for a start of holdfastd.
inline constexpr std::uint16_t kMostLost = 1000;

class Backlog {
 public:
  // Once a turn, which wait for less than the receiver's rule allows, and for less than a frame's period while this is
  // true. `readable`: something waits in the port.
  [[nodiscard]] bool is_old(bool readable, std::uint64_t steady_ms) {
    const bool stood_still = turned_ && steady_ms - turned_ms_ > HOLDFAST_GRIP_FRESH_MS;
    old_ = stood_still || (old_ && readable);
    turned_ = true;
    turned_ms_ = steady_ms;
    return old_;
  }

 private:
  bool turned_ = false, old_ = false;
  std::uint64_t turned_ms_ = 0;
};

}  // namespace holdfast::console_tool
