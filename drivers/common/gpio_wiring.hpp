// SPDX-License-Identifier: Apache-2.0
// Where the board's wires are: from the words of the wiring table to a chip and an offset, as the kernel lists them.
//
// Chips are found by label and lines by name, never by a chip's number: it depends on the kernel's version (the
// header of a Raspberry Pi 5 has been on gpiochip4, then on gpiochip0) and on what else is plugged in. Whatever is not
// certain is refused with a message; nothing is guessed. Runs before start(): messages take memory.
// Not here: asking the kernel, requesting lines and reading them back (the board's driver does).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include "hal/gpio.hpp"

namespace holdfast::drivers {

// What the application calls it.
using Role = std::variant<hal::Line, hal::Input>;
[[nodiscard]] std::string_view name_of(const Role& role);

inline constexpr std::uint32_t kNoOffset = 0xFFFFFFFF;

// One row of a board's table. A line by its name; or by the label of its chip and its offset there, on kernels that
// name no lines. A name with a label: the name on that chip.
struct Wiring {
  Role role;
  std::string_view line;             // "GPIO17"; empty: by offset
  std::string_view chip;             // "pinctrl-bcm2711"; empty: on whatever chip has the name
  std::uint32_t offset = kNoOffset;  // within the chip
  bool active_low = false;           // HIGH in the application's words is 0 V on the wire
};

struct LineInfo {
  std::string_view name;  // empty: the kernel has none
  bool used = false;      // by the kernel or by another process
  std::string_view user;  // what it calls itself; may be empty
};

struct ChipInfo {
  std::string_view name;  // the kernel's, "gpiochip0"; the same chip may be listed twice, under two device files
  std::string_view label;
  std::span<const LineInfo> lines;
};

struct Place {
  std::size_t chip = 0;  // index into the chips given
  std::uint32_t offset = 0;
  friend bool operator==(const Place&, const Place&) = default;
};

struct [[nodiscard]] Found {
  Place place;
  std::string error;  // one line: what, likely cause, next step; empty: found, and free
  bool held = false;  // the error is that somebody else has it
  [[nodiscard]] bool ok() const { return error.empty(); }
};

Found find(std::span<const ChipInfo> chips, const Wiring& wiring);

// All rows of a table; two rows may not be one line. Returns the first error, empty: `places` are those of `table`.
// Range: places.size() == table.size().
[[nodiscard]] std::string find_all(std::span<const ChipInfo> chips, std::span<const Wiring> table,
                                   std::span<Place> places);

}  // namespace holdfast::drivers
