// SPDX-License-Identifier: Apache-2.0
#include "store/slot_store.hpp"

#include <algorithm>
#include <limits>

namespace holdfast {
namespace {

constexpr std::uint32_t kLast = std::numeric_limits<std::uint32_t>::max();

}  // namespace

SlotStore::SlotStore(sealed::Kind kind, Good good, hal::Store* store, const hal::Verifier* owner)
    : kind_(kind), store_(store), owner_(owner) {
  if (store_ == nullptr) return;
  for (std::size_t k = 0; k < slots_.size(); ++k) {
    std::span<const std::uint8_t> payload;
    slots_[k] = look_at(k, good, payload);
    if (follows(slots_[k].sequence, newest_)) newest_ = slots_[k].sequence;
    if (slots_[k].state != State::kOlder || !follows(slots_[k].sequence, sequence_)) continue;
    payload_ = payload;
    sequence_ = slots_[k].sequence;
    other_ = 1 - k;
  }
  if (sequence_ != 0) slots_[1 - other_].state = State::kNewest;
  if (slots_[0].state == State::kEmpty && slots_[1].state == State::kEmpty) return;
  for (Slot& slot : slots_) {
    if (slot.state == State::kEmpty) slot.state = State::kErased;
  }
}

SlotStore::Slot SlotStore::look_at(std::size_t slot, Good good, std::span<const std::uint8_t>& payload) const {
  if (!store_->readable(slot)) return {.state = State::kUnknown};
  const std::span<const std::uint8_t> bytes = store_->found(slot);
  if (std::ranges::all_of(bytes, [](std::uint8_t byte) { return byte == 0; })) return {};
  sealed::Record record;
  const sealed::Refusal refusal = sealed::read(bytes, kind_, owner_, record);
  if (refusal != sealed::Refusal::kNone) return {.state = State::kRefused, .refusal = refusal};
  payload = record.payload;
  return {.state = good(payload) ? State::kOlder : State::kNotGood, .sequence = record.sequence};
}

bool SlotStore::follows(std::uint32_t next, std::uint32_t now) const {
  if (development() && now == kLast) return next == 1;
  if (development() && next == kLast && now == 1) return false;
  return next > now;
}

SlotStore::Put SlotStore::put(std::span<const std::uint8_t> record, Good good) {
  refusal_ = sealed::Refusal::kNone;
  if (store_ == nullptr) return Put::kNoPlace;
  if (settle() == hal::Store::State::kBusy) return Put::kStillBusy;
  sealed::Record read;
  refusal_ = sealed::read(record, kind_, owner_, read);
  if (refusal_ == sealed::Refusal::kNone && read.bytes != record.size()) refusal_ = sealed::Refusal::kNoRecord;
  if (refusal_ != sealed::Refusal::kNone) return Put::kRefused;
  if (!follows(read.sequence, newest_)) return Put::kOld;
  if (!good(read.payload)) return Put::kNotGood;
  const Slot& kept = slots_[1 - other_];
  writing_both_ = kept.state == State::kEmpty || kept.damaged();
  if (!store_->begin(other_, record, writing_both_)) return Put::kNoPlace;
  writing_ = true;
  writing_sequence_ = read.sequence;
  return Put::kBegun;
}

std::uint32_t SlotStore::next_sequence() const {
  if (!development()) return 0;
  return newest_ == kLast ? 1 : newest_ + 1;
}

hal::Store::State SlotStore::settle() {
  if (store_ == nullptr) return hal::Store::State::kIdle;
  const hal::Store::State state = store_->state();
  if (state == hal::Store::State::kBusy || !writing_) return state;
  writing_ = false;
  if (state != hal::Store::State::kDone) {
    slots_[other_] = {.state = State::kUnknown};
    return state;
  }
  sequence_ = newest_ = writing_sequence_;
  slots_[other_] = {.state = State::kNewest, .sequence = sequence_};
  other_ = 1 - other_;
  if (writing_both_) slots_[other_].sequence = sequence_;
  slots_[other_].state = State::kOlder;
  return state;
}

std::string_view words(const SlotStore::Slot& slot) {
  constexpr std::array<std::string_view, 7> kWords{
      "empty: never written to",
      "whole, the newest",
      "whole, and older",
      "unknown: reading or writing it failed",
      "erased: zeros, and whoever saves first writes both",
      "",
      "whole, but this firmware cannot use it: its values contradict each other, or are of another version"};
  if (slot.state == SlotStore::State::kRefused) return sealed::info(slot.refusal).what;
  return kWords[static_cast<std::size_t>(slot.state)];
}

}  // namespace holdfast
