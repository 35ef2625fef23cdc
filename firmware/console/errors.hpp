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
  kWriteFailed = 25,
  kStillWriting = 26,
  kNotSigned = 27,
  kWrongSignature = 28,
  kTooOld = 29,
  kNotHere = 30,
  kNothingYet = 31,
  kRefused = 32,
  kInterrupted = 33,
  kBroken = 34,
  kWrongRecord = 35,
  kNotUsable = 36,
  kNotThisModel = 37,
  kOwnersAlone = 38,
};

struct ErrorInfo {
  Error error;
  std::string_view name;
  std::string_view what;
  std::string_view cause;
  std::string_view next;
};

inline constexpr std::array<ErrorInfo, 27> kErrors{{
    {Error::kUnknownCommand, "unknown_command", "there is no such command", "a typing error", "help lists them"},
    {Error::kTooLong, "line_too_long", "the line has more than 255 characters", "two lines run together, or noise",
     "send it again, shorter"},
    {Error::kDamaged, "line_damaged", "the line holds bytes that are not text", "noise, or another baud rate",
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
    {Error::kNotStored, "not_stored", "there is no place to store this", "this board was given none, or cannot use it",
     "start holdfastd with --settings and --models, and look at what it says when it starts"},
    {Error::kWriteFailed, "write_failed", "it could not be written, so that what was stored before stays",
     "the card is full, worn out, or can only be read", "make room or change the card, then give it again"},
    {Error::kStillWriting, "still_writing", "an earlier record is still being written", "a slow card",
     "give it again in some seconds"},
    {Error::kNotSigned, "not_signed", "this device stores only what its owner signed", "it was given its owner's key",
     "make it with holdfast settings compile --sign or holdfast model seal --sign and load it, or start holdfastd with "
     "--development"},
    {Error::kWrongSignature, "wrong_signature", "the signature is not the owner's, or not of these bytes",
     "signed with another key, or changed afterwards", "sign it with the key whose other half this device has"},
    {Error::kTooOld, "too_old", "the device has this record or a newer one",
     "an older file, or a wrong clock when it was made",
     "make it again on the host, with a right clock or a larger --sequence"},
    {Error::kNotHere, "not_here", "this board cannot do that", "it needs a simulation build", "use a simulated board"},
    {Error::kNothingYet, "nothing_yet", "there is nothing to show yet", "no frame was accepted, or no fault happened",
     "wait for it; status says what the device is doing"},
    {Error::kRefused, "refused", "the device refuses this in its present state",
     "something touches the gel, or no gripper is set up", "status says the state; take the object away"},
    {Error::kInterrupted, "interrupted", "the command was ended before it was done", "Ctrl-C, or a disconnected cable",
     "give it again"},
    {Error::kBroken, "broken", "what was loaded is not whole",
     "a line was lost or damaged on the way, or load was not begun",
     "begin again with load settings or load model; holdfast console --load sends all of it"},
    {Error::kWrongRecord, "wrong_record", "these bytes are no record of this kind and version",
     "another file, or made for another firmware",
     "give what holdfast settings or holdfast model wrote, with the holdfast of this firmware"},
    {Error::kNotUsable, "not_usable", "the record holds what this firmware does not know or allow",
     "made for another firmware", "make it again with the holdfast of this firmware"},
    {Error::kNotThisModel, "not_this_model", "this firmware cannot decide by the model; in place of this it says why",
     "made for another firmware", "compile and seal it again with the holdfast of this firmware"},
    {Error::kOwnersAlone, "owners_alone",
     "this decides when GRIP_OK may be HIGH, and only the device's owner may say it",
     "the device was given its owner's key",
     "write it into a TOML file, holdfast settings compile --sign, holdfast console --load, and reboot"},
}};

// Range: any but kNone.
[[nodiscard]] constexpr const ErrorInfo& info(Error error) {
  for (const ErrorInfo& row : kErrors) {
    if (row.error == error) return row;
  }
  return kErrors[0];
}

}  // namespace holdfast::console
