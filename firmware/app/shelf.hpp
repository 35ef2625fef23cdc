// SPDX-License-Identifier: Apache-2.0
// The two slots of a store, and which of them is in force: that with the larger sequence of those that are whole, the
// owner's, and good. A new record goes into the other one, so that until it is durable, and whenever its writing ends
// half way, the one in force is what the next start finds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "app/sealed.hpp"
#include "hal/store.hpp"

namespace holdfast {

class Shelf {
 public:
  enum class Put : std::uint8_t {
    kBegun,
    kNoPlace,    // no store, or too large for its slots
    kStillBusy,  // an earlier record is still being written
    kRefused,    // refusal() says why
    kOld,        // its sequence is not above that of the record in force
    kNotGood,    // its payload is not
  };
  // Whether a payload can be used. Range: any bytes.
  using Good = bool (*)(std::span<const std::uint8_t> payload);

  // `store` null: there is no place. `owner` null: development mode (sealed.hpp). Both outlive it.
  Shelf(sealed::Kind kind, Good good, hal::Store* store, const hal::Verifier* owner);

  [[nodiscard]] sealed::Kind kind() const { return kind_; }
  [[nodiscard]] bool has_place() const { return store_ != nullptr; }
  // What was in force when the board started; empty: nothing was. Valid as long as the store.
  [[nodiscard]] std::span<const std::uint8_t> payload() const { return payload_; }
  // Of the record in force now; 0: there is none.
  [[nodiscard]] std::uint32_t sequence() const { return sequence_; }
  // No signature is looked at, and the device may store by itself.
  [[nodiscard]] bool development() const { return owner_ == nullptr; }

  // A record of exactly these bytes. `good`: stricter than what a start looks at, where one has to be found. Range: any
  // bytes.
  [[nodiscard]] Put put(std::span<const std::uint8_t> record, Good good);
  [[nodiscard]] sealed::Refusal refusal() const { return refusal_; }
  // The next number for a record of the device's own; 0: there is none left, or this device takes signed ones only.
  [[nodiscard]] std::uint32_t next_sequence() const;

  // How what was put fares; a record that is durable comes into force by this call. To be called again while kBusy.
  [[nodiscard]] hal::Store::State settle();
  [[nodiscard]] int error() const { return store_ == nullptr ? 0 : store_->error(); }

 private:
  sealed::Kind kind_;
  hal::Store* store_;
  const hal::Verifier* owner_;
  std::span<const std::uint8_t> payload_;
  std::uint32_t sequence_ = 0;
  std::size_t other_ = 0;  // the slot that is not in force
  sealed::Refusal refusal_ = sealed::Refusal::kNone;
  bool writing_ = false;
  std::uint32_t writing_sequence_ = 0;
};

}  // namespace holdfast
