// SPDX-License-Identifier: Apache-2.0
#include "toolchain/faults/judge.hpp"

#include <algorithm>

#include "hal/gpio.hpp"

namespace holdfast::faults {
namespace {

constexpr Micros kNever = Micros::max();

}  // namespace

void Judge::take(const sim::TapeEvent& event) {
  const Micros time{event.time_us};
  if (event.kind == sim::TapeKind::kUnsafe) {
    if (event.value != 0) {
      unsafe_.push_back({event.which, time, kNever});
      return;
    }
    for (Unsafe& unsafe : unsafe_) {
      if (unsafe.which == event.which && unsafe.to == kNever) unsafe.to = time;
    }
    return;
  }
  until(time);
  switch (event.kind) {
    case sim::TapeKind::kLine:
      if (static_cast<hal::Line>(event.which) == hal::Line::kGripOk) grip_ok_ = event.value != 0;
      if (static_cast<hal::Line>(event.which) == hal::Line::kAlive) alive_at_ = time;
      break;
    case sim::TapeKind::kState: {
      const auto state = static_cast<DeviceState>(event.which);
      if (state == DeviceState::kFault) {
        judgement_.fault_reasons.insert(static_cast<Reason>(event.value));
        if (was_ok_ && judgement_.last_state != DeviceState::kFault) {
          ++judgement_.faults;
          judgement_.fault_at.push_back(time);
        }
      }
      judgement_.reasons.insert(static_cast<Reason>(event.value));
      was_ok_ = was_ok_ || state == DeviceState::kOk;
      judgement_.last_state = state;
      judgement_.last_reason = static_cast<Reason>(event.value);
      break;
    }
    case sim::TapeKind::kEnd:
      judgement_.ended = true;
      judgement_.end = time;
      break;
    case sim::TapeKind::kUnsafe:
      break;
  }
}

// Between two events the lines stand still and ALIVE ages.
void Judge::until(Micros time) {
  const Micros from = now_;
  now_ = std::max(now_, time);
  if (!grip_ok_ || !alive_at_) return;
  const Micros to = std::min(now_, *alive_at_ + kReceiversRule);
  if (to > from) told_fine(from, to);
}

void Judge::told_fine(Micros from, Micros to) {
  judgement_.fine += to - from;
  bool after_all = true;
  for (auto unsafe = unsafe_.begin(); unsafe != unsafe_.end();) {
    if (unsafe->to <= from) {  // over: a run of a day has thousands
      last_end_ = std::max(last_end_, unsafe->to);
      unsafe = unsafe_.erase(unsafe);
      continue;
    }
    after_all = after_all && unsafe->from >= to;
    const Micros begin = std::max(from, unsafe->from);
    const Micros end = std::min(to, unsafe->to);
    if (end > begin) judgement_.to_safe = std::max(judgement_.to_safe, end - unsafe->from);
    const Micros late = std::max(begin, unsafe->from + kReceiversRule);
    if (end > late) judgement_.unsafe_fine += end - late;
    ++unsafe;
  }
  // The first "fine" after all that has ended so far; a later fault asks again.
  if (last_end_ == Micros{} || !after_all || last_end_ == recovered_from_) return;
  recovered_from_ = last_end_;
  judgement_.to_recover = from - last_end_;
  judgement_.slowest_recovery = std::max(judgement_.slowest_recovery, from - last_end_);
}

Judgement Judge::finish() {
  until(judgement_.end);
  judgement_.fine_at_end = grip_ok_ && alive_at_ && judgement_.end - *alive_at_ < kReceiversRule;
  for (const Unsafe& unsafe : unsafe_) {
    if (unsafe.to != kNever) last_end_ = std::max(last_end_, unsafe.to);
  }
  if (recovered_from_ < last_end_) judgement_.to_recover.reset();
  return judgement_;
}

}  // namespace holdfast::faults
