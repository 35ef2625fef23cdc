// SPDX-License-Identifier: Apache-2.0
// What `watch on` streams, put together again: status frames on one time line, markers as whole fields.
//
// The device's stamps have 32 bits, stand still when its camera does, and begin anew when it does; the receiver's own
// clock says where on the line such a frame belongs.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "link/marker_frame.hpp"
#include "link/status_frame.hpp"
#include "tactile/types.hpp"

namespace holdfast::console_tool {

class Telemetry {
 public:
  using Moment = std::chrono::steady_clock::time_point;

  struct Received {
    status_frame::StatusFrame status;
    std::int64_t time_us = 0;  // since the first; strictly increasing
    std::int64_t number = 0;   // counted from 0, lost ones too
    std::int64_t lost = 0;     // between the one before and this
    bool accepted = false;     // ALIVE toggled since the one before; not known of the first, and behind lost ones
  };
  // `at`: when it came.
  [[nodiscard]] Received take(const status_frame::StatusFrame& status, Moment at);
  // The device was away: numbers and stamps begin anew.
  void begin_anew() { anew_ = true; }

  // True: with it the field, or the rest position, is whole.
  [[nodiscard]] bool take(link::Kind kind, const marker_frame::MarkerFrame& piece);
  // In um. The last whole ones; nothing: none yet.
  [[nodiscard]] const std::optional<DisplacementField>& field() const { return displaced_.whole; }
  [[nodiscard]] std::uint16_t field_sequence() const { return displaced_.sequence; }
  [[nodiscard]] const std::optional<DisplacementField>& rest() const { return rest_.whole; }

  [[nodiscard]] std::int64_t lost() const { return lost_; }

 private:
  struct Pieces {
    DisplacementField coming;
    std::optional<DisplacementField> whole;
    std::uint32_t have = 0;  // a bit for each piece
    std::uint16_t sequence = 0;
    std::optional<std::uint16_t> coming_sequence;
    [[nodiscard]] bool take(const marker_frame::MarkerFrame& piece);
  };

  std::optional<Received> last_;
  Moment last_at_{};
  std::int64_t offset_us_ = 0;  // from the device's stamps, with all their bits, to time_us
  bool anew_ = false;
  std::int64_t lost_ = 0;
  Pieces displaced_, rest_;
};

}  // namespace holdfast::console_tool
