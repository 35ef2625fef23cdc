// SPDX-License-Identifier: Apache-2.0
// A durable place inside a test: two slots that the next `Store` of a test may start with.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hal/store.hpp"

namespace holdfast::sim {

class Store final : public hal::Store {
 public:
  explicit Store(std::size_t slot_bytes) : slots_{Slot(slot_bytes), Slot(slot_bytes)}, slot_bytes_(slot_bytes) {
    asked_.reserve(slot_bytes);
  }

  // What a fault does to it.
  [[nodiscard]] std::span<std::uint8_t> slot(std::size_t k) { return slots_[k]; }
  // Writes stay under way until finish().
  void set_slow(bool slow) { slow_ = slow; }
  void finish() {
    if (state_ == State::kBusy) end();
  }
  // Writes fail with this number of the system, after `bytes` of each; 0: they succeed.
  void set_failure(int error, std::size_t bytes = 0) {
    failure_ = error;
    most_ = bytes;
  }
  // The medium does not say what lies in its slots.
  void set_unreadable(bool unreadable) { unreadable_ = unreadable; }
  [[nodiscard]] int writes() const { return writes_; }

 private:
  using Slot = std::vector<std::uint8_t>;

  [[nodiscard]] std::size_t do_slot_bytes() const override { return slot_bytes_; }
  [[nodiscard]] std::span<const std::uint8_t> do_found(std::size_t k) const override { return slots_[k]; }
  [[nodiscard]] bool do_readable(std::size_t /*k*/) const override { return !unreadable_; }
  void do_begin(std::size_t k, std::span<const std::uint8_t> bytes, bool both) override {
    ++writes_;
    asked_.assign(bytes.begin(), bytes.end());
    into_ = k;
    both_ = both;
    state_ = State::kBusy;
    if (!slow_) end();
  }
  [[nodiscard]] State do_state() const override { return state_; }
  [[nodiscard]] int do_error() const override { return error_; }

  void end() {
    const std::size_t count = failure_ != 0 ? std::min(most_, asked_.size()) : asked_.size();
    std::copy_n(asked_.begin(), count, slots_[into_].begin());
    if (both_ && failure_ == 0) std::copy(asked_.begin(), asked_.end(), slots_[1 - into_].begin());
    error_ = failure_;
    state_ = failure_ != 0 ? State::kFailed : State::kDone;
  }

  std::array<Slot, kSlots> slots_;
  std::size_t slot_bytes_;
  Slot asked_;
  std::size_t into_ = 0;
  State state_ = State::kIdle;
  bool slow_ = false, both_ = false, unreadable_ = false;
  int failure_ = 0, error_ = 0, writes_ = 0;
  std::size_t most_ = 0;
};

}  // namespace holdfast::sim
