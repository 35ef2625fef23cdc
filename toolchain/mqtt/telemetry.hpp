// SPDX-License-Identifier: Apache-2.0
// What a fleet is told of one board, from the bytes of its link. No port, no broker, no clock: times are arguments.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>

#include "toolchain/robot/holdfast_link.h"

namespace holdfast::fleet {

struct Now {
  std::uint64_t steady_ms = 0;  // never stands still, begins anywhere
  std::int64_t unix_ms = 0;     // wall clock
};

class Telemetry {
 public:
  // A board that has sent no status frame for so long is silent.
  static constexpr std::uint64_t kSilentMs = 1000;

  // `changed` gets the JSON of each state that differs from the one before.
  explicit Telemetry(std::function<void(std::string)> changed) : changed_(std::move(changed)) {}

  // `old`: these bytes have waited (console/backlog.hpp). What they say is told and counted, and confirms nothing.
  void hear(std::span<const std::uint8_t> bytes, Now now, bool old = false);
  // As often as the receiver's rule is to be looked at, also when nothing came.
  void tick(Now now);

  [[nodiscard]] std::string state(Now now) const;
  // `dropped` and `connects`: the caller's.
  [[nodiscard]] std::string counters(Now now, std::uint64_t dropped, std::uint64_t connects) const;

 private:
  struct State {
    std::uint8_t state = 0, reason = 0;
    bool slip = false, confirmed = false, heard = false;
    friend bool operator==(const State&, const State&) = default;
  };
  void take(const holdfast_status& status, Now now, bool old);

  std::function<void(std::string)> changed_;
  holdfast_receiver receiver_{};
  holdfast_grip grip_{};
  State now_is_;
  std::uint64_t heard_ms_ = 0;
  std::uint16_t sequence_ = 0;
  std::uint64_t frames_ = 0, lost_ = 0, restarts_ = 0, other_ = 0, damaged_ = 0;
  std::uint64_t changes_ = 0, slips_ = 0, faults_ = 0, silences_ = 0;
};

}  // namespace holdfast::fleet
