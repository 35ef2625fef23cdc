// SPDX-License-Identifier: Apache-2.0
// What the console answers when it does not do what it was asked: `ERR <number> <name>: <what>. Likely cause: <cause>.
// Next: <next>`. Numbers are never re-used; ERRORS.md lists them with the reasons of base/status.hpp.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace holdfast::console {

enum class Error : std::uint8_t {
  kNone = 0,
  kUnknownCommand = 1,
  kTooLong = 2,
  kDamaged = 3,
  kArguments = 4,
  kLocked = 10,
  kWrongCode = 11,
  kTooSoon = 12,
  kNoCode = 13,
  kUnknownParameter = 20,
  kNotANumber = 21,
  kRange = 22,
  kContradiction = 23,
  kNotStored = 24,
  kNotHere = 30,
  kNothingYet = 31,
  kRefused = 32,
  kInterrupted = 33,
};

struct ErrorInfo {
  Error error;
  std::string_view name;
  std::string_view what;
  std::string_view cause;
  std::string_view next;
};

inline constexpr std::array<ErrorInfo, 17> kErrors{{
    {Error::kUnknownCommand, "unknown_command", "there is no such command", "a typing error", "help lists them"},
    {Error::kTooLong, "line_too_long", "the line has more than 255 characters", "two lines run together, or noise",
     "send it again, shorter"},
    {Error::kDamaged, "line_damaged", "the line holds bytes that no key of text makes", "noise, or another baud rate",
     "check for 115200 8N1 and send it again"},
    {Error::kArguments, "arguments", "the arguments do not fit the command", "a typing error",
     "help with the command's name shows them"},
    {Error::kLocked, "locked", "the command changes something, and the console is locked", "nobody unlocked it",
     "unlock with the device's code"},
    {Error::kWrongCode, "wrong_code", "the code is wrong", "a typing error, or another device's code",
     "look at the device's label; each wrong code doubles the wait"},
    {Error::kTooSoon, "too_soon", "a wrong code was given not long ago", "too many tries",
     "wait as long as it says, then unlock again"},
    {Error::kNoCode, "no_code", "this device has no code, so nothing can be unlocked", "none was set up",
     "start holdfastd with --code-file"},
    {Error::kUnknownParameter, "unknown_parameter", "there is no such parameter", "a typing error", "get lists them"},
    {Error::kNotANumber, "not_a_number", "the value is no whole number", "a typing error, or a unit behind it",
     "give digits alone, in the parameter's unit"},
    {Error::kRange, "out_of_range", "the value is outside the parameter's range", "another unit, or a typing error",
     "give a value in the range"},
    {Error::kContradiction, "contradiction", "two settings contradict each other", "one was changed without the other",
     "change the other one first"},
    {Error::kNotStored, "not_stored", "the settings could not be stored", "this board was given no place for them",
     "start holdfastd with --settings"},
    {Error::kNotHere, "not_here", "this board cannot do that", "it needs a simulation build", "use a simulated board"},
    {Error::kNothingYet, "nothing_yet", "there is nothing to show yet", "no frame was accepted, or no fault happened",
     "wait for it; status says what the device is doing"},
    {Error::kRefused, "refused", "the device refuses this in its present state",
     "something touches the gel, or no gripper is set up", "status says the state; take the object away"},
    {Error::kInterrupted, "interrupted", "the command was ended by Ctrl-C", "somebody pressed it", "give it again"},
}};

// Range: any but kNone.
[[nodiscard]] constexpr const ErrorInfo& info(Error error) {
  for (const ErrorInfo& row : kErrors) {
    if (row.error == error) return row;
  }
  return kErrors[0];
}

}  // namespace holdfast::console
