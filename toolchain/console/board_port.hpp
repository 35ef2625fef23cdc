// SPDX-License-Identifier: Apache-2.0
// The port of a board whose frames a bridge passes on, for as long as the bridge runs: opened again whenever it has
// gone, and asked for its frames where it is a console's.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "toolchain/console/backlog.hpp"
#include "toolchain/console/port.hpp"

namespace holdfast::console_tool {

class BoardPort {
 public:
  // `console`: frames come there once `watch on` was said.
  BoardPort(std::string path, bool console) : path_(std::move(path)), console_(console) {}

  struct Came {
    std::span<const std::uint8_t> bytes;  // until the next turn
    bool old = false;                     // of the past: see Backlog
  };
  // Once a turn; says on stderr why the port does not open, once for each reason. `readable`: something waits in fd().
  [[nodiscard]] Came turn(bool readable, std::uint64_t steady_ms);
  [[nodiscard]] int fd() const { return port_.fd(); }
  [[nodiscard]] bool is_open() const { return port_.is_open(); }
  [[nodiscard]] bool write(std::string_view text) { return port_.write(text); }

 private:
  static constexpr std::uint64_t kOpenEveryMs = 1000;
  // A board that was started anew streams nothing, and its adapter has not hung up: as Watching.
  static constexpr std::uint64_t kSilentMs = 3000;
  void open(std::uint64_t steady_ms);

  std::string path_, said_;
  bool console_;
  Port port_;
  Backlog backlog_;
  std::array<std::uint8_t, 4096> bytes_{};
  std::uint64_t open_at_ms_ = 0, heard_at_ms_ = 0;
};

}  // namespace holdfast::console_tool
