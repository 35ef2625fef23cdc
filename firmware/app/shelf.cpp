// SPDX-License-Identifier: Apache-2.0
#include "app/shelf.hpp"

#include <limits>

namespace holdfast {

Shelf::Shelf(sealed::Kind kind, Good good, hal::Store* store, const hal::Verifier* owner)
    : kind_(kind), store_(store), owner_(owner) {
  for (std::size_t slot = 0; store_ != nullptr && slot < hal::Store::kSlots; ++slot) {
    sealed::Record record;
    if (sealed::read(store_->found(slot), kind_, owner_, record) != sealed::Refusal::kNone) continue;
    if (record.sequence <= sequence_ || !good(record.payload)) continue;
    payload_ = record.payload;
    sequence_ = record.sequence;
    other_ = 1 - slot;
  }
}

Shelf::Put Shelf::put(std::span<const std::uint8_t> record, Good good) {
  refusal_ = sealed::Refusal::kNone;
  if (store_ == nullptr) return Put::kNoPlace;
  if (settle() == hal::Store::State::kBusy) return Put::kStillBusy;
  sealed::Record read;
  refusal_ = sealed::read(record, kind_, owner_, read);
  if (refusal_ == sealed::Refusal::kNone && read.bytes != record.size()) refusal_ = sealed::Refusal::kNoRecord;
  if (refusal_ != sealed::Refusal::kNone) return Put::kRefused;
  if (read.sequence <= sequence_) return Put::kOld;
  if (!good(read.payload)) return Put::kNotGood;
  if (!store_->begin(other_, record)) return Put::kNoPlace;
  writing_ = true;
  writing_sequence_ = read.sequence;
  return Put::kBegun;
}

std::uint32_t Shelf::next_sequence() const {
  if (!development() || sequence_ == std::numeric_limits<std::uint32_t>::max()) return 0;
  return sequence_ + 1;
}

hal::Store::State Shelf::settle() {
  if (store_ == nullptr) return hal::Store::State::kIdle;
  const hal::Store::State state = store_->state();
  if (state == hal::Store::State::kBusy || !writing_) return state;
  writing_ = false;
  if (state == hal::Store::State::kDone) {
    sequence_ = writing_sequence_;
    other_ = 1 - other_;
  }
  return state;
}

}  // namespace holdfast
