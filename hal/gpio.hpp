// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

namespace holdfast::hal {

// The lines in the words of the application; pins, chips and polarity belong to the board.
enum class Line : std::uint8_t {
  kGripOk,    // HIGH only while healthy, referenced and no slip
  kAlive,     // toggles once per accepted frame
  kIncrease,  // a pulse: the gripper holds one step harder (grip/step_lines.hpp)
  kDecrease,  // a pulse: one step softer
};
inline constexpr int kLineCount = 4;

// What the robot may ask for by a wire of its own. HIGH asks.
enum class Input : std::uint8_t { kTare, kOpening, kRelease, kArm };
inline constexpr int kInputCount = 4;

enum class Level : bool { kLow = false, kHigh = true };

class Gpio {
 public:
  virtual ~Gpio() = default;
  // Drives the line and reads it back; false: the line did not take the level (stolen, stuck or the chip refused).
  [[nodiscard]] bool set(Line line, Level level) { return do_set(line, level); }
  // Level of an input; nothing when the board has none wired, or when the chip refused.
  [[nodiscard]] std::optional<Level> read(Input input) { return do_read(input); }

 private:
  [[nodiscard]] virtual bool do_set(Line line, Level level) = 0;
  [[nodiscard]] virtual std::optional<Level> do_read(Input input) = 0;
};

}  // namespace holdfast::hal
