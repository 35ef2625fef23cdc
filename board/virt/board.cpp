// SPDX-License-Identifier: Apache-2.0
// qemu-system-aarch64 -M virt: the same program on an emulated machine, for tests/system. Its GPIO chip is a PL061 of
// eight unnamed lines; line 3 is the machine's own, the power button.
#include <array>

#include "board/linux/appliance.hpp"

namespace holdfast::board {

const Hardware& hardware() {
  using drivers::Wiring;
  using hal::Input;
  using hal::Line;
  constexpr std::string_view kChip = "9030000.pl061";
  static constexpr std::array<Wiring, 7> kWiring{{
      {.role = Line::kGripOk, .line = {}, .chip = kChip, .offset = 0},
      {.role = Line::kAlive, .line = {}, .chip = kChip, .offset = 1},
      {.role = Line::kIncrease, .line = {}, .chip = kChip, .offset = 2},
      {.role = Line::kDecrease, .line = {}, .chip = kChip, .offset = 4},
      {.role = Input::kTare, .line = {}, .chip = kChip, .offset = 5},
      {.role = Input::kOpening, .line = {}, .chip = kChip, .offset = 6},
      {.role = Input::kRelease, .line = {}, .chip = kChip, .offset = 7},
  }};
  // Emulation takes ten to twenty times as long as a Pi for a frame. What is claimed of real time is proved in virtual
  // time (holdfast faults); here it is that the same program does the same with a real kernel.
  static constexpr Hardware kHardware{"virt", kWiring, 20};
  return kHardware;
}

}  // namespace holdfast::board
