// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/hand.hpp"

#include <algorithm>

#include "base/math.hpp"

namespace holdfast::tool {

void HandPlayer::give(int finger, pipeline::Result seen, bool opening) {
  out_.now = std::max(out_.now, seen.timestamp);
  out_.result = fingers::decide(hand_, config_, finger, seen, out_.now, {.reasons = {}, .opening = opening});
  out_.seen = hand_.fusion.seen;
  if (seen.quality.ok()) out_.last[idx(finger)] = seen;
}

const HandFrame& HandPlayer::step(const pipeline::Result& left, bool opening) {
  // The first left frame that the right recording has a partner of sets its clock.
  if (const int partner = left_frames_++ + offset_; !clock_ && partner >= 0 && idx(partner) < right_.size()) {
    clock_ = left.timestamp + later_ - right_[idx(partner)].timestamp;
  }
  for (; clock_ && next_ < right_.size() && right_[next_].timestamp + *clock_ <= left.timestamp; ++next_) {
    pipeline::Result seen = right_[next_];
    seen.timestamp += *clock_;
    give(1, seen, opening);
  }
  give(0, left, opening);
  return out_;
}

}  // namespace holdfast::tool
