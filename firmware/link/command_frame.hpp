// SPDX-License-Identifier: Apache-2.0
// What the robot asks of the firmware, and the answer. How both go on the wire: link.hpp.
//
// Every command is answered, also one that is refused. An answer that does not come is asked for by sending the same
// frame again: `Once` sees to it that a repetition is answered and not executed a second time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "base/units.hpp"
#include "link/link.hpp"

namespace holdfast::command_frame {

// Numbers are sent on the wire and never re-used.
enum class Command : std::uint8_t { kTare = 1, kOpening = 2, kRelease = 3, kArm = 4, kGrip = 5 };

struct CommandInfo {
  Command command;
  std::string_view name;
  std::string_view meaning;
  std::string_view argument;
  std::uint8_t max_argument;  // from 0 on
};

inline constexpr std::array<CommandInfo, 5> kCommands{{
    {Command::kTare, "TARE", "forget the rest position of the markers and learn it anew",
     "0: only while nothing touches the gel; 1: even then", 1},
    {Command::kOpening, "OPENING", "the gripper opens: loss of contact is no slip, for `opening_max_ms` at most",
     "1: begins; 0: has ended", 1},
    {Command::kRelease, "RELEASE", "lower the grip force step by step, to let the object go", "0", 0},
    {Command::kArm, "ARM", "leave a latched fault; activates the gripper anew", "0", 0},
    {Command::kGrip, "GRIP", "move the gripper", "1: close and hold with the starting force; 0: open", 1},
}};

// Null: a number that is not listed, from a newer sender.
[[nodiscard]] constexpr const CommandInfo* info(Command command) {
  for (const CommandInfo& row : kCommands) {
    if (row.command == command) return &row;
  }
  return nullptr;
}

// Numbers are sent on the wire and never re-used.
enum class Outcome : std::uint8_t {
  kDone = 0,
  kTouching = 1,
  kState = 2,
  kUnknown = 3,
  kArgument = 4,
  kLocked = 5,
  kOverdue = 6
};

struct ResultInfo {
  Outcome result;
  std::string_view name;
  std::string_view meaning;
  std::string_view cause;
  std::string_view next;
};

inline constexpr std::array<ResultInfo, 7> kResults{{
    {Outcome::kDone, "done", "taken; what comes of it is in the status frames", "-", "-"},
    {Outcome::kTouching, "touching", "refused: something touches the gel", "the object is still between the fingers",
     "open the gripper, or send TARE with argument 1"},
    {Outcome::kState, "state", "refused: no gripper is set up", "the parameter `gripper` is 0",
     "set it to the gripper that is wired, and restart"},
    {Outcome::kUnknown, "unknown", "refused: this firmware does not know the command", "a newer sender",
     "update the firmware"},
    {Outcome::kArgument, "argument", "refused: the argument is out of the command's range", "a mistake of the sender's",
     "look at the table of commands"},
    {Outcome::kLocked, "locked", "refused: this is the console's port, and it is locked",
     "nobody unlocked the console, or its cable was out since",
     "send it on the port `link`, unlock the console, or start holdfastd with --host-commands"},
    {Outcome::kOverdue, "overdue", "refused: OPENING lasted for `opening_max_ms` and was not ended",
     "OPENING is sent again and again", "send OPENING 0 when the gripper has opened, and OPENING 1 the next time"},
}};

struct CommandFrame {
  std::uint16_t sequence = 0;  // the sender's choice
  Command command{};           // a newer sender may send numbers that kCommands does not list
  std::uint8_t argument = 0;
  friend constexpr bool operator==(const CommandFrame&, const CommandFrame&) = default;
};

struct AnswerFrame {
  std::uint16_t sequence = 0;
  Command command{};
  Outcome result{};  // a newer firmware may send numbers that kResults does not list
  friend constexpr bool operator==(const AnswerFrame&, const AnswerFrame&) = default;
};

// What is wrong with the frame itself; kDone: nothing.
[[nodiscard]] constexpr Outcome check(const CommandFrame& frame) {
  const CommandInfo* const row = info(frame.command);
  if (row == nullptr) return Outcome::kUnknown;
  return frame.argument <= row->max_argument ? Outcome::kDone : Outcome::kArgument;
}

// clang-format off
inline constexpr std::array<link::Field<CommandFrame>, 6> kCommandFields{{
    {"version", 0, link::WireType::kU8, "-", "layout of this table: 1", link::get_constant<link::kVersion>, nullptr},
    {"kind", 1, link::WireType::kU8, "-", "2: command frame", link::get_constant<link::Kind::kCommand>, nullptr},
    {"sequence", 2, link::WireType::kU16, "1", "chosen by the sender, another one for each new command; comes back in the answer",
     link::get<&CommandFrame::sequence>, link::put<&CommandFrame::sequence>},
    {"command", 4, link::WireType::kU8, "-", "see Commands",
     link::get<&CommandFrame::command>, link::put<&CommandFrame::command>},
    {"argument", 5, link::WireType::kU8, "-", "see Commands",
     link::get<&CommandFrame::argument>, link::put<&CommandFrame::argument>},
    {"crc16", 6, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 5", nullptr, nullptr},
}};

inline constexpr std::array<link::Field<AnswerFrame>, 6> kAnswerFields{{
    {"version", 0, link::WireType::kU8, "-", "layout of this table: 1", link::get_constant<link::kVersion>, nullptr},
    {"kind", 1, link::WireType::kU8, "-", "3: answer frame", link::get_constant<link::Kind::kAnswer>, nullptr},
    {"sequence", 2, link::WireType::kU16, "1", "of the command", link::get<&AnswerFrame::sequence>, link::put<&AnswerFrame::sequence>},
    {"command", 4, link::WireType::kU8, "-", "of the command", link::get<&AnswerFrame::command>, link::put<&AnswerFrame::command>},
    {"result", 5, link::WireType::kU8, "-", "see Results; a number not listed there comes from newer firmware",
     link::get<&AnswerFrame::result>, link::put<&AnswerFrame::result>},
    {"crc16", 6, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 5", nullptr, nullptr},
}};
// clang-format on

inline constexpr std::size_t kCommandBytes = link::wire_bytes(link::payload_bytes(kCommandFields));
inline constexpr std::size_t kAnswerBytes = link::wire_bytes(link::payload_bytes(kAnswerFields));

static_assert(link::is_layout(kCommandFields) && link::is_layout(kAnswerFields));
static_assert(kCommandBytes == 10 && kAnswerBytes == 10, "version 1 is frozen");

// Both return the size of `wire`: all frames of a kind have the same length.
std::size_t encode(const CommandFrame& frame, std::span<std::uint8_t, kCommandBytes> wire);
std::size_t encode(const AnswerFrame& frame, std::span<std::uint8_t, kAnswerBytes> wire);

// `payload`: as a link::Receiver left it. Nothing: of another version, kind or length.
[[nodiscard]] std::optional<CommandFrame> read_command(const link::Payload& payload);
[[nodiscard]] std::optional<AnswerFrame> read_answer(const link::Payload& payload);

// Executes what is new and answers what is repeated. One for each port: senders number their commands on their own.
//
// A repetition is the same frame again, less than kForget after the one before. The time ends it because a sender that
// starts anew may begin with the same number: its command must not be answered "done" and left undone.
class Once {
 public:
  static constexpr Micros kForget{1'000'000};

  // `execute`: Outcome(const CommandFrame&), for a command that check() passed. A clock that was set
  // back ends it as well.
  template <typename Execute>
  [[nodiscard]] AnswerFrame answer(const CommandFrame& frame, Micros now, const Execute& execute) {
    if (!any_ || frame != last_ || now < heard_ || now - heard_ >= kForget) {
      result_ = check(frame);
      if (result_ == Outcome::kDone) result_ = execute(frame);
    }
    any_ = true;
    last_ = frame;
    heard_ = now;
    return {frame.sequence, frame.command, result_};
  }

 private:
  bool any_ = false;
  CommandFrame last_;
  Outcome result_{};
  Micros heard_{};
};

}  // namespace holdfast::command_frame
