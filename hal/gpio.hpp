// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace holdfast::hal {

// The output lines in the words of the application; pins, chips and polarity belong to the board.
enum class Line : std::uint8_t {
  kGripOk,  // HIGH only while healthy, referenced and no slip
  kAlive,   // toggles once per accepted frame
};
inline constexpr int kLineCount = 2;

enum class Level : bool { kLow = false, kHigh = true };

class Gpio {
 public:
  virtual ~Gpio() = default;
  // Drives the line; false: the line did not take the level (stolen, stuck or the chip refused).
  [[nodiscard]] bool set(Line line, Level level) { return do_set(line, level); }

 private:
  [[nodiscard]] virtual bool do_set(Line line, Level level) = 0;
};

}  // namespace holdfast::hal
