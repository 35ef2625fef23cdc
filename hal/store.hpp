// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast::hal {

// A durable place for one record, in two slots that are written in turn: what lies in one of them outlives the power
// while the other one is written. Which slot is in force is the caller's business (firmware/store/slot_store.hpp), and
// that one is never written.
//
// Writing takes as long as the medium does, seconds on an SD card, so that it runs beside the caller: begin() takes a
// copy and returns at once, state() tells when the bytes are durable. No heap after the board has started.
class Store {
 public:
  enum class State : std::uint8_t {
    kIdle,    // nothing was written yet
    kBusy,    // what begin() took is on its way
    kDone,    // it is durable
    kFailed,  // it may or may not be there, whole or in pieces; error() says why
  };
  static constexpr std::size_t kSlots = 2;

  virtual ~Store() = default;
  // What a slot can hold; 0: nothing can be stored.
  [[nodiscard]] std::size_t slot_bytes() const { return do_slot_bytes(); }
  // As the board found it when it started; untouched by begin(). Range: slot below kSlots. Whoever reads it trusts
  // nothing in it.
  [[nodiscard]] std::span<const std::uint8_t> found(std::size_t slot) const {
    return slot < kSlots ? do_found(slot) : std::span<const std::uint8_t>{};
  }
  // False: the medium did not say what lies there, and found() means nothing. Zeros that could be read are what a place
  // holds that was never written to. Range: slot below kSlots.
  [[nodiscard]] bool readable(std::size_t slot) const { return slot < kSlots && do_readable(slot); }
  // Over the beginning of a slot. `both`: once that is durable, over the other one as well, and it is over when both
  // are; for slots of which neither holds anything. False: no such slot, nothing to write, too much for a slot, or
  // still busy.
  [[nodiscard]] bool begin(std::size_t slot, std::span<const std::uint8_t> bytes, bool both = false) {
    if (slot >= kSlots || bytes.empty() || bytes.size() > slot_bytes() || state() == State::kBusy) return false;
    do_begin(slot, bytes, both);
    return true;
  }
  [[nodiscard]] State state() const { return do_state(); }
  // The system's number (errno) of a kFailed.
  [[nodiscard]] int error() const { return do_error(); }

 private:
  [[nodiscard]] virtual std::size_t do_slot_bytes() const = 0;
  [[nodiscard]] virtual std::span<const std::uint8_t> do_found(std::size_t slot) const = 0;
  [[nodiscard]] virtual bool do_readable(std::size_t slot) const = 0;
  virtual void do_begin(std::size_t slot, std::span<const std::uint8_t> bytes, bool both) = 0;
  [[nodiscard]] virtual State do_state() const = 0;
  [[nodiscard]] virtual int do_error() const = 0;
};

}  // namespace holdfast::hal
