// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/telemetry.hpp"

#include <algorithm>

#include "base/math.hpp"

namespace holdfast::console_tool {
namespace {

using std::chrono::duration_cast;
using std::chrono::microseconds;

// A stamp is at most 6.5 s older than the frame that carries it, or says nothing (status_frame.hpp).
constexpr std::int64_t kFarUs = 10'000'000;
// More frames than could have come in the time were not lost: the device counts anew.
constexpr std::int64_t kMostPerSecond = 200;

}  // namespace

Telemetry::Received Telemetry::take(const status_frame::StatusFrame& status, Moment at) {
  Received frame;
  frame.status = status;
  if (!last_) {
    offset_us_ = -std::int64_t{status.timestamp_us};
  } else {
    const std::int64_t elapsed_us = std::max<std::int64_t>(duration_cast<microseconds>(at - last_at_).count(), 1);
    const std::int64_t expected = last_->time_us + elapsed_us;
    const std::int64_t step = static_cast<std::uint16_t>(status.sequence - last_->status.sequence);
    const bool follows = !anew_ && step > 0 && step <= 10 + elapsed_us * kMostPerSecond / 1'000'000;
    frame.lost = follows ? step - 1 : 0;
    frame.number = last_->number + 1 + frame.lost;
    frame.accepted = step == 1 && follows ? status.alive != last_->status.alive : status.features_valid;
    // The stamp whose low bits these are and that is nearest to where this frame should be.
    const std::int64_t near_stamp = expected - offset_us_;
    const auto off = static_cast<std::int32_t>(status.timestamp_us - static_cast<std::uint32_t>(near_stamp));
    std::int64_t stamp = near_stamp + off;
    if (anew_ || off > kFarUs || off < -kFarUs) {
      stamp = status.timestamp_us;
      offset_us_ = expected - stamp;
    }
    frame.time_us = stamp + offset_us_;
    if (frame.time_us <= last_->time_us) frame.time_us = expected;
    lost_ += frame.lost;
  }
  anew_ = false;
  last_ = frame;
  last_at_ = at;
  return frame;
}

bool Telemetry::take(link::Kind kind, const marker_frame::MarkerFrame& piece) {
  return (kind == link::Kind::kRest ? rest_ : displaced_).take(piece);
}

// Pieces of one picture come one behind the other; those of another one end it.
bool Telemetry::Pieces::take(const marker_frame::MarkerFrame& piece) {
  const GridSize grid{piece.rows, piece.cols};
  if (coming_sequence != piece.sequence || coming.grid != grid) {
    coming = {};
    coming.grid = grid;
    coming_sequence = piece.sequence;
    have = 0;
  }
  for (std::int32_t k = 0; k < marker_frame::kPerFrame && piece.first + k < grid.count(); ++k) {
    MarkerDisplacement& marker = coming.markers[idx(piece.first + k)];
    marker.valid = ((piece.valid >> k) & 1U) != 0;
    marker.dx = Micrometres::from_raw(piece.points[idx(k)].x_um);
    marker.dy = Micrometres::from_raw(piece.points[idx(k)].y_um);
  }
  have |= 1U << (piece.first / marker_frame::kPerFrame);
  if (have != (1U << marker_frame::frames_of(grid)) - 1) return false;
  whole = coming;
  sequence = piece.sequence;
  coming_sequence.reset();
  return true;
}

}  // namespace holdfast::console_tool
