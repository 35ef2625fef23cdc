// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace holdfast::hal {

// The voltage that the board runs on. Below its limit (4.63 V on a Raspberry Pi) USB devices drop out and frames come
// torn, long before the board itself fails.
class Supply {
 public:
  enum class State : std::uint8_t { kUnknown, kGood, kLow };
  static constexpr std::array<std::string_view, 3> kNames{"not_reported", "good", "low"};

  virtual ~Supply() = default;
  // As it was read last, a second ago at most. Waits for nothing: it is asked between two frames.
  [[nodiscard]] State state() const { return do_state(); }

 private:
  [[nodiscard]] virtual State do_state() const = 0;
};

}  // namespace holdfast::hal
