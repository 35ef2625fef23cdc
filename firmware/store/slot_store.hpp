// SPDX-License-Identifier: Apache-2.0
// The two slots of a store, and which of them is in force: that with the newer sequence of those that are whole, the
// owner's, and good. A new record goes into the other one, so that until it is durable, and whenever its writing ends
// half way, the one in force is what the next start finds. The first record goes into both: from then on zeros in a
// slot are damage, and no erased record passes for one that never was.
//
// The larger sequence is the newer. Behind 2^32 - 1 a device in development mode goes on with 1, and then 1 is the
// newer one of these two (and 2^32 - 1 is refused behind 1). A device with an owner never takes a smaller number for a
// newer one: whoever signed 2^32 - 1 has signed the last record, which is why `holdfast` does not give that number.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "hal/store.hpp"
#include "store/sealed.hpp"

namespace holdfast {

class SlotStore {
 public:
  enum class Put : std::uint8_t {
    kBegun,
    kNoPlace,    // no store, or too large for its slots
    kStillBusy,  // an earlier record is still being written
    kRefused,    // refusal() says why
    kOld,        // its sequence is not above newest()
    kNotGood,    // its payload is not
  };
  // What lies in a slot. From kUnknown on: something that is not to be used was, or may have been, stored there.
  enum class State : std::uint8_t {
    kEmpty,    // never written to
    kNewest,   // in force
    kOlder,    // whole, the owner's and good
    kUnknown,  // it could not be read, or writing it failed
    kErased,   // zeros beside something in the other slot
    kRefused,  // `refusal` says why
    kNotGood,  // whole and the owner's, and nothing that this firmware can use
  };
  struct Slot {
    State state = State::kEmpty;
    sealed::Refusal refusal = sealed::Refusal::kNone;
    std::uint32_t sequence = 0;  // 0: no record
    [[nodiscard]] bool damaged() const { return state >= State::kUnknown; }
  };
  // Whether a payload can be used. Range: any bytes.
  using Good = bool (*)(std::span<const std::uint8_t> payload);

  // `store` null: there is no place. `owner` null: development mode (sealed.hpp). Both outlive it.
  SlotStore(sealed::Kind kind, Good good, hal::Store* store, const hal::Verifier* owner);

  [[nodiscard]] sealed::Kind kind() const { return kind_; }
  [[nodiscard]] bool has_place() const { return store_ != nullptr; }
  // What was in force when the board started; empty: nothing was. Valid as long as the store.
  [[nodiscard]] std::span<const std::uint8_t> payload() const { return payload_; }
  // Of the record in force now; 0: there is none.
  [[nodiscard]] std::uint32_t sequence() const { return sequence_; }
  // Of the newest record here that is whole and the owner's, also where this firmware cannot use it: that one's number
  // must not be lost, or an older one would be taken for news. 0: there is none.
  [[nodiscard]] std::uint32_t newest() const { return newest_; }
  // Nobody knows whether the newest record lay in a slot that is.
  [[nodiscard]] bool damaged() const { return slots_[0].damaged() || slots_[1].damaged(); }
  // Whether a start may go by payload(). Beside a damaged slot it may be an older one: development mode goes on with
  // it, a device with an owner, whom that would roll back, does not.
  [[nodiscard]] bool counts() const { return sequence_ != 0 && (development() || !damaged()); }
  // As the start found it, or as it was written since. Range: below hal::Store::kSlots.
  [[nodiscard]] const Slot& slot(std::size_t k) const { return slots_[k]; }
  // No signature is looked at, and the device may store by itself.
  [[nodiscard]] bool development() const { return owner_ == nullptr; }

  // A record of exactly these bytes. `good`: stricter than what a start looks at, where one has to be found. Where no
  // slot holds anything that can be used, both are written. Range: any bytes.
  [[nodiscard]] Put put(std::span<const std::uint8_t> record, Good good);
  [[nodiscard]] sealed::Refusal refusal() const { return refusal_; }
  // The next number for a record of the device's own; 0: this device takes signed ones only.
  [[nodiscard]] std::uint32_t next_sequence() const;

  // How what was put fares; a record that is durable comes into force by this call. To be called again while kBusy.
  [[nodiscard]] hal::Store::State settle();
  [[nodiscard]] int error() const { return store_ == nullptr ? 0 : store_->error(); }

 private:
  [[nodiscard]] Slot look_at(std::size_t slot, Good good, std::span<const std::uint8_t>& payload) const;
  [[nodiscard]] bool follows(std::uint32_t next, std::uint32_t now) const;

  sealed::Kind kind_;
  hal::Store* store_;
  const hal::Verifier* owner_;
  std::span<const std::uint8_t> payload_;
  std::array<Slot, hal::Store::kSlots> slots_{};
  std::uint32_t sequence_ = 0;
  std::uint32_t newest_ = 0;
  std::size_t other_ = 0;  // the slot that is not in force
  sealed::Refusal refusal_ = sealed::Refusal::kNone;
  bool writing_ = false;
  bool writing_both_ = false;
  std::uint32_t writing_sequence_ = 0;
};

// What lies in a slot, for people.
[[nodiscard]] std::string_view words(const SlotStore::Slot& slot);

}  // namespace holdfast
