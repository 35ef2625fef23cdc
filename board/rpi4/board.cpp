// SPDX-License-Identifier: Apache-2.0
// Raspberry Pi 4: the 40-pin header. board/README.md has the drawing; ground is beside, pins 9, 14, 20 and 25.
#include <array>

#include "board/linux/appliance.hpp"

namespace holdfast::board {

const Hardware& hardware() {
  using drivers::Wiring;
  using hal::Input;
  using hal::Line;
  // UART (GPIO14, GPIO15), I2C and SPI stay free. These pins have a pull-down at power-up: LOW says "not fine" until
  // the firmware drives them. (GPIO0 to GPIO8 have a pull-up.)
  static constexpr std::array<Wiring, 8> kWiring{{
      {.role = Line::kGripOk, .line = "GPIO17", .chip = {}},    // pin 11
      {.role = Line::kAlive, .line = "GPIO27", .chip = {}},     // pin 13
      {.role = Line::kIncrease, .line = "GPIO22", .chip = {}},  // pin 15
      {.role = Line::kDecrease, .line = "GPIO23", .chip = {}},  // pin 16
      {.role = Input::kTare, .line = "GPIO24", .chip = {}},     // pin 18
      {.role = Input::kOpening, .line = "GPIO25", .chip = {}},  // pin 22
      {.role = Input::kRelease, .line = "GPIO12", .chip = {}},  // pin 32
      {.role = Input::kArm, .line = "GPIO16", .chip = {}},      // pin 36
  }};
  static constexpr Hardware kHardware{.name = "rpi4", .wiring = kWiring, .supply = "rpi_volt"};
  return kHardware;
}

}  // namespace holdfast::board
