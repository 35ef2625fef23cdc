// SPDX-License-Identifier: Apache-2.0
// The observer outside: reads the tape of another process and holds it against the receiver's rule (DESIGN.md,
// Outputs): no receiver may be told "fine", GRIP_OK HIGH and the last edge of ALIVE younger than 150 ms, at any moment
// later than 150 ms after the truth turned unsafe.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "base/status.hpp"
#include "base/units.hpp"
#include "drivers/sim/tape.hpp"

namespace holdfast::faults {

inline constexpr Micros kReceiversRule{150'000};

struct Judgement {
  Micros unsafe_fine{};              // told "fine" against the rule, in all
  Micros to_safe{};                  // from the truth's turn to the last "fine" of that fault; the longest
  std::optional<Micros> to_recover;  // from the end of the last fault to "fine"; none: not again
  Micros slowest_recovery{};         // of all that recovered
  Micros fine{};                     // told "fine", in all
  std::set<Reason> fault_reasons;    // of every FAULT that was said
  std::set<Reason> reasons;          // of every state that was said
  std::uint32_t faults = 0;          // how often FAULT was entered, after the first OK
  std::vector<Micros> fault_at;      // when
  DeviceState last_state = DeviceState::kBoot;
  Reason last_reason = Reason::kNone;
  bool fine_at_end = false;  // by the lines: the state is what the firmware says
  bool ended = false;        // in order: the process lived to the end
  Micros end{};
};

// Takes events in the order of their time, but for kUnsafe, which may come ahead of its time.
class Judge {
 public:
  void take(const sim::TapeEvent& event);
  // No more events: what lasts until `end` is counted.
  [[nodiscard]] Judgement finish();
  [[nodiscard]] const Judgement& so_far() const { return judgement_; }

 private:
  struct Unsafe {
    std::uint8_t which = 0;
    Micros from{};
    Micros to{};
  };
  void until(Micros time);
  void told_fine(Micros from, Micros to);

  Judgement judgement_;
  std::vector<Unsafe> unsafe_;
  Micros now_{};
  bool grip_ok_ = false;
  std::optional<Micros> alive_at_;
  bool was_ok_ = false;
  Micros last_end_{};  // of the faults that are over
  Micros recovered_from_{};
};

}  // namespace holdfast::faults
