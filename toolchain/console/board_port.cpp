// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/board_port.hpp"

#include "toolchain/support/cli.hpp"

namespace holdfast::console_tool {

BoardPort::Came BoardPort::turn(bool readable, std::uint64_t steady_ms) {
  Came came{.bytes = {}, .old = backlog_.is_old(readable, steady_ms)};
  if (readable) {
    const int count = port_.read(bytes_);
    if (count < 0) port_.close();
    if (count > 0) {
      came.bytes = std::span(bytes_).first(static_cast<std::size_t>(count));
      heard_at_ms_ = steady_ms;
    }
  }
  if (!port_.is_open()) {
    if (steady_ms >= open_at_ms_) open(steady_ms);
  } else if (console_ && steady_ms - heard_at_ms_ > kSilentMs) {
    heard_at_ms_ = steady_ms;
    (void)port_.write("\r\nwatch on\r\n");
  }
  return came;
}

void BoardPort::open(std::uint64_t steady_ms) {
  open_at_ms_ = steady_ms + kOpenEveryMs;
  const Port::Opened opened = port_.open(path_);
  const std::string why = opened == Port::Opened::kYes ? "" : refusal(path_, opened);
  if (!why.empty() && why != said_) tool::note(why);
  said_ = why;
  if (!why.empty()) return;
  heard_at_ms_ = steady_ms;
  if (console_) (void)port_.write("\r\nwatch on\r\n");
}

}  // namespace holdfast::console_tool
