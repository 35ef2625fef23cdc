// SPDX-License-Identifier: Apache-2.0
#include "app/recorder.hpp"

#include <algorithm>
#include <limits>

namespace holdfast {
namespace {

std::int16_t cut(std::int32_t um) {
  using Limits = std::numeric_limits<std::int16_t>;
  return static_cast<std::int16_t>(std::clamp<std::int32_t>(um, Limits::min(), Limits::max()));
}

}  // namespace

void Recorder::take(const pipeline::Result& result, const DisplacementField& field, const supervisor::Outputs& outputs,
                    Micros now, int finger) {
  FlightFrame& frame = frames_.next();
  frame = {};
  frame.at = now;
  frame.sequence = result.sequence;
  frame.age_us = static_cast<std::int32_t>(
      std::clamp<std::int64_t>((now - result.timestamp).count(), 0, std::numeric_limits<std::int32_t>::max()));
  frame.quality = result.quality.reason;
  frame.state = outputs.state;
  frame.reason = outputs.reason;
  frame.accepted = outputs.accepted;
  frame.finger = static_cast<std::uint8_t>(finger);
  frame.slip = outputs.slip;
  frame.grip_ok = outputs.grip_ok;
  frame.features = result.quality.ok() && result.referenced;
  if (frame.features) {
    frame.markers = static_cast<std::uint8_t>(result.features.markers);
    frame.grid = result.grid;
    frame.vx_um_s = result.features.vx.raw();
    frame.vy_um_s = result.features.vy.raw();
    frame.entropy_nat_q16 = result.features.entropy.raw();
    frame.entropy_rate_nat_s_q8 = result.features.entropy_rate.raw();
    for (std::int32_t i = 0; i < result.grid.count(); ++i) {
      const MarkerDisplacement& d = field.markers[idx(i)];
      if (d.valid) frame.displacement[idx(i)] = {cut(d.dx.raw()), cut(d.dy.raw())};
    }
  }
  if (outputs.state == state_ && outputs.reason == reason_) return;
  note(EventKind::kState, now, static_cast<std::int32_t>(outputs.state), static_cast<std::int32_t>(outputs.reason));
  if (outputs.state == DeviceState::kFault && state_ != DeviceState::kFault) before_fault_ = frames_;
  state_ = outputs.state;
  reason_ = outputs.reason;
}

}  // namespace holdfast
