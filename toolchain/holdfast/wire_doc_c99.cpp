// SPDX-License-Identifier: Apache-2.0
// The header for robots. What depends on the tables is generated; the rest is the text below, which is compiled and
// held against the firmware by tests/toolchain/robot_link_test.cpp and tests/fuzz/link_check.hpp.
#include <algorithm>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/status.hpp"
#include "link/command_frame.hpp"
#include "link/link.hpp"
#include "link/status_frame.hpp"
#include "toolchain/holdfast/wire_doc.hpp"

namespace holdfast::wire_doc {
namespace {

namespace sf = status_frame;
namespace cf = command_frame;

template <typename Number>
std::string text(Number number) {
  return std::to_string(static_cast<std::int64_t>(number));
}

std::string upper(std::string_view name) {
  std::string out(name);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::toupper(letter)); });
  return out;
}

// One named number of an enum, for both the enum and the function of its names.
struct Word {
  std::string constant;
  std::string number;
  std::string name;
  std::string meaning;
};
using Words = std::vector<Word>;

template <typename Table, typename NumberOf, typename MeaningOf>
Words words(std::string_view prefix, const Table& table, NumberOf number, MeaningOf meaning) {
  Words out;
  for (const auto& row : table) {
    out.push_back(
        {std::string(prefix) + upper(row.name), text(row.*number), std::string(row.name), std::string(row.*meaning)});
  }
  return out;
}

std::string enum_of(std::string_view tag, const Words& words) {
  std::string out = "enum " + std::string(tag) + " {\n";
  for (std::size_t i = 0; i < words.size(); ++i) {
    const Word& word = words[i];
    out +=
        "  " + word.constant + " = " + word.number + (i + 1 < words.size() ? "," : "") + "  // " + word.meaning + "\n";
  }
  return out + "};\n\n";
}

std::string names_of(std::string_view function, const Words& words) {
  std::string out = "static inline const char *" + std::string(function) + "(uint8_t number) {\n  switch (number) {\n";
  for (const Word& word : words) out += "    case " + word.constant + ": return \"" + word.name + "\";\n";
  return out + "    default: return \"?\";\n  }\n}\n\n";
}

std::string_view type_of(link::WireType type) {
  switch (type) {
    case link::WireType::kU8:
      return "uint8_t";
    case link::WireType::kU16:
      return "uint16_t";
    case link::WireType::kU32:
      return "uint32_t";
    case link::WireType::kI16:
      return "int16_t";
    case link::WireType::kI32:
      return "int32_t";
  }
  return "";
}

std::string_view suffix_of(link::WireType type) {
  return type_of(type).substr(0, type_of(type).size() - 2);
}

template <typename Table>
std::string struct_of(std::string_view name, const Table& fields) {
  std::string out = "typedef struct {\n";
  for (const auto& field : fields) {
    if (field.put == nullptr) continue;
    const std::string unit = field.unit == "-" ? "" : std::string(field.unit) + "; ";
    out += "  " + std::string(type_of(field.type)) + " " + std::string(field.name) + ";  // " + unit +
           std::string(field.meaning) + "\n";
  }
  return out + "} " + std::string(name) + ";\n\n";
}

// get: payload -> struct; put: struct -> payload.
template <typename Table>
std::string gets_of(std::string_view into, const Table& fields) {
  std::string out;
  for (const auto& field : fields) {
    if (field.put == nullptr) continue;
    out += "  " + std::string(into) + "->" + std::string(field.name) + " = holdfast_get_" +
           std::string(suffix_of(field.type)) + "(receiver->bytes + " + text(field.offset) + ");\n";
  }
  return out;
}

template <typename Table>
std::string puts_of(std::string_view from, const Table& fields) {
  std::string out;
  for (const auto& field : fields) {
    if (field.put == nullptr) continue;
    out += "  holdfast_put_" + std::string(suffix_of(field.type)) + "(payload + " + text(field.offset) + ", " +
           std::string(from) + "->" + std::string(field.name) + ");\n";
  }
  return out;
}

std::string replaced(std::string text, std::string_view what, std::string_view by) {
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + by.size())) {
    text.replace(at, what.size(), by);
  }
  return text;
}

constexpr std::string_view kHead = R"(// SPDX-License-Identifier: Apache-2.0
// clang-format off
// Written by wire_doc from the tables that the firmware encodes with (firmware/link/LINK.md); do not edit.
//
// The robot's end of a serial line to holdfastd, for C99 and C++: no heap, no globals, nothing to link. Zeroed
// structs are ready for use. README.md, beside this file, shows a program.
#ifndef HOLDFAST_LINK_H
#define HOLDFAST_LINK_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum {
  HOLDFAST_LINK_VERSION = @VERSION@,
  HOLDFAST_LINK_MAX_WIRE = @MAX_WIRE@,
  HOLDFAST_STATUS_PAYLOAD = @STATUS_PAYLOAD@,
  HOLDFAST_COMMAND_PAYLOAD = @COMMAND_PAYLOAD@,
  HOLDFAST_ANSWER_PAYLOAD = @ANSWER_PAYLOAD@,
  HOLDFAST_COMMAND_WIRE = @COMMAND_WIRE@,  // what holdfast_link_command() writes: one 0x00 before the frame as well
  HOLDFAST_GRIP_FRESH_MS = @FRESH_MS@
};

// What holdfast_link_push() returns when it is not 0.
enum {
  HOLDFAST_KIND_STATUS = @KIND_STATUS@,
  HOLDFAST_KIND_COMMAND = @KIND_COMMAND@,
  HOLDFAST_KIND_ANSWER = @KIND_ANSWER@,
  HOLDFAST_LINK_DAMAGED = -1,  // what began as a frame is none; dropped
  HOLDFAST_LINK_OTHER = -2     // a sound frame of a version, kind or length that this header does not know
};

)";

constexpr std::string_view kMachinery = R"(static inline uint8_t holdfast_get_uint8(const uint8_t *p) { return p[0]; }

static inline uint16_t holdfast_get_uint16(const uint8_t *p) {
  return (uint16_t)((uint32_t)p[0] | ((uint32_t)p[1] << 8));
}

static inline uint32_t holdfast_get_uint32(const uint8_t *p) {
  return (uint32_t)p[0] | ((uint32_t)p[1] << 8) | ((uint32_t)p[2] << 16) | ((uint32_t)p[3] << 24);
}

static inline int32_t holdfast_get_int32(const uint8_t *p) {
  const uint32_t bits = holdfast_get_uint32(p);
  int32_t value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline void holdfast_put_uint8(uint8_t *p, uint8_t value) { p[0] = value; }

static inline void holdfast_put_uint16(uint8_t *p, uint16_t value) {
  p[0] = (uint8_t)(value & 0xFFu);
  p[1] = (uint8_t)((uint32_t)value >> 8);
}

// CRC-16/CCITT-FALSE, bit by bit: a frame is short.
static inline uint16_t holdfast_crc16(const uint8_t *bytes, size_t count) {
  uint32_t crc = 0xFFFFu;
  size_t i;
  int bit;
  for (i = 0; i < count; ++i) {
    crc ^= (uint32_t)bytes[i] << 8;
    for (bit = 0; bit < 8; ++bit) crc = (crc << 1) ^ ((crc & 0x8000u) != 0 ? 0x11021u : 0u);
  }
  return (uint16_t)crc;
}

// ---------------------------------------------------------------------------------------------- what arrives

typedef struct {
  uint8_t bytes[HOLDFAST_LINK_MAX_WIRE];  // since the last 0x00; behind a frame its payload, until the next push
  uint8_t count;
  uint8_t place;     // 0: a frame may have begun, 1: in text, 2: in what is to be dropped up to the end of a line
  uint32_t frames;   // heard since start, of any kind; wraps
  uint32_t damaged;  // the same of HOLDFAST_LINK_DAMAGED
} holdfast_receiver;

// COBS, in place. Returns how many bytes come out, 0: no valid COBS.
static inline size_t holdfast_link_unstuff(uint8_t *bytes, size_t count) {
  size_t from = 0, to = 0, run;
  while (from < count) {
    run = (size_t)bytes[from++] - 1u;
    if (run > count - from) return 0;
    for (; run > 0; --run) bytes[to++] = bytes[from++];
    if (from < count) bytes[to++] = 0;
  }
  return to;
}

// Give it every byte that comes. Returns 0 most of the time, the kind of the frame that this byte completes, or what
// happened (HOLDFAST_LINK_...). Text between frames is passed over.
static inline int holdfast_link_push(holdfast_receiver *receiver, uint8_t byte) {
  uint8_t *const bytes = receiver->bytes;
  size_t size;
  if (byte != 0) {
    if (receiver->place == 2 && (byte == '\n' || byte == '\r')) receiver->place = 1;
    if (receiver->place != 0) return 0;
    bytes[receiver->count++] = byte;
    if (receiver->count == 2 && byte > @LAST_VERSION@) receiver->place = 1;
    if (receiver->count < HOLDFAST_LINK_MAX_WIRE) return 0;
    receiver->place = 2;
    ++receiver->damaged;
    return HOLDFAST_LINK_DAMAGED;
  }
  size = receiver->place == 0 ? receiver->count : 0;
  receiver->place = 0;
  receiver->count = 0;
  if (size < 2) return 0;
  size = holdfast_link_unstuff(bytes, size);
  if (size < @MIN_PAYLOAD@ || holdfast_crc16(bytes, size - 2) != holdfast_get_uint16(bytes + size - 2)) {
    ++receiver->damaged;
    return HOLDFAST_LINK_DAMAGED;
  }
  ++receiver->frames;
  if (bytes[0] != HOLDFAST_LINK_VERSION) return HOLDFAST_LINK_OTHER;
  if ((bytes[1] == HOLDFAST_KIND_STATUS && size == HOLDFAST_STATUS_PAYLOAD) ||
      (bytes[1] == HOLDFAST_KIND_COMMAND && size == HOLDFAST_COMMAND_PAYLOAD) ||
      (bytes[1] == HOLDFAST_KIND_ANSWER && size == HOLDFAST_ANSWER_PAYLOAD)) {
    return bytes[1];
  }
  return HOLDFAST_LINK_OTHER;
}

// After HOLDFAST_KIND_STATUS, before the next push. 0: the state is one that this header does not know, and `status`
// is not filled; the frame counts as not heard.
static inline int holdfast_link_status(const holdfast_receiver *receiver, holdfast_status *status) {
  if (receiver->bytes[@STATE_OFFSET@] > @LAST_STATE@) return 0;
@STATUS_GETS@  return 1;
}

// After HOLDFAST_KIND_ANSWER, before the next push.
static inline void holdfast_link_answer(const holdfast_receiver *receiver, holdfast_answer *answer) {
@ANSWER_GETS@}

// -------------------------------------------------------------------------------------------------- what is sent

// Writes the command's frame; send all HOLDFAST_COMMAND_WIRE bytes. Another command takes another sequence; the same
// frame again asks for the answer again.
static inline void holdfast_link_command(const holdfast_command *command, uint8_t wire[HOLDFAST_COMMAND_WIRE]) {
  uint8_t payload[HOLDFAST_COMMAND_PAYLOAD];
  size_t i, code = 1;
  payload[0] = HOLDFAST_LINK_VERSION;
  payload[1] = HOLDFAST_KIND_COMMAND;
@COMMAND_PUTS@  holdfast_put_uint16(payload + HOLDFAST_COMMAND_PAYLOAD - 2, holdfast_crc16(payload, HOLDFAST_COMMAND_PAYLOAD - 2));
  memset(wire, 0, HOLDFAST_COMMAND_WIRE);
  wire[code] = 1;
  for (i = 0; i < HOLDFAST_COMMAND_PAYLOAD; ++i) {
    if (payload[i] == 0) {
      code = i + 2;
      wire[code] = 1;
    } else {
      wire[i + 2] = payload[i];
      ++wire[code];
    }
  }
}

// Whether this answer is the command's.
static inline int holdfast_link_answers(const holdfast_answer *answer, const holdfast_command *command) {
  return answer->sequence == command->sequence && answer->command == command->command;
}

// -------------------------------------------------------------------------------------------- the receiver's rule

typedef struct {
  uint32_t changed_ms;  // when `alive` changed last
  uint8_t flags;        // of the last frame
  uint8_t known;        // a frame has come: its `alive` can be compared with
  uint8_t fresh;        // `alive` has changed, and was never found too old since
} holdfast_grip;

// Whether the grip may be taken for good now. Ask as often as you act on it, at least once a day: what was found too
// old stays so until `alive` changes again, even when the clock comes round.
static inline int holdfast_grip_ok(holdfast_grip *grip, uint32_t now_ms) {
  if (now_ms - grip->changed_ms >= HOLDFAST_GRIP_FRESH_MS) grip->fresh = 0;
  return grip->fresh && (grip->flags & HOLDFAST_FLAG_GRIP_OK) != 0;
}

// With every status frame. `now_ms`: when it arrived, by a clock of your own that never stands still and wraps at 2^32.
static inline void holdfast_grip_update(holdfast_grip *grip, const holdfast_status *status, uint32_t now_ms) {
  (void)holdfast_grip_ok(grip, now_ms);
  if (grip->known && ((grip->flags ^ status->flags) & HOLDFAST_FLAG_ALIVE) != 0) {
    grip->changed_ms = now_ms;
    grip->fresh = 1;
  }
  grip->flags = status->flags;
  grip->known = 1;
}

#endif
)";

}  // namespace

std::string link_header() {
  Words flags;
  for (const sf::Flag& flag : sf::kFlags) {
    flags.push_back(
        {"HOLDFAST_FLAG_" + upper(flag.name), text(1U << flag.bit), std::string(flag.name), std::string(flag.meaning)});
  }
  const Words states = words("HOLDFAST_STATE_", kStates, &StateInfo::state, &StateInfo::meaning);
  const Words reasons = words("HOLDFAST_REASON_", kReasons, &ReasonInfo::reason, &ReasonInfo::what);
  Words commands = words("HOLDFAST_COMMAND_", cf::kCommands, &cf::CommandInfo::command, &cf::CommandInfo::meaning);
  for (std::size_t i = 0; i < commands.size(); ++i) {
    commands[i].meaning += " (argument " + std::string(cf::kCommands[i].argument) + ")";
  }
  const Words results = words("HOLDFAST_RESULT_", cf::kResults, &cf::ResultInfo::result, &cf::ResultInfo::meaning);
  const auto* const state_field = std::find_if(sf::kFields.begin(), sf::kFields.end(),
                                               [](const sf::Field& field) { return field.name == "state"; });

  std::string out(kHead);
  out += enum_of("holdfast_flag", flags) + enum_of("holdfast_state", states) + enum_of("holdfast_reason", reasons) +
         enum_of("holdfast_command_number", commands) + enum_of("holdfast_result", results);
  out += "// As in LINK.md; \"?\": a number from a newer firmware.\n" + names_of("holdfast_state_name", states) +
         names_of("holdfast_reason_name", reasons) + names_of("holdfast_command_name", commands) +
         names_of("holdfast_result_name", results);
  out += struct_of("holdfast_status", sf::kFields) + struct_of("holdfast_command", cf::kCommandFields) +
         struct_of("holdfast_answer", cf::kAnswerFields);
  out += kMachinery;
  const std::pair<std::string_view, std::string> values[] = {
      {"@VERSION@", text(link::kVersion)},
      {"@LAST_VERSION@", text(link::kLastVersion)},
      {"@MAX_WIRE@", text(link::kMaxWireBytes)},
      {"@MIN_PAYLOAD@", text(link::kMinPayloadBytes)},
      {"@STATUS_PAYLOAD@", text(sf::kPayloadBytes)},
      {"@COMMAND_PAYLOAD@", text(link::payload_bytes(cf::kCommandFields))},
      {"@ANSWER_PAYLOAD@", text(link::payload_bytes(cf::kAnswerFields))},
      {"@COMMAND_WIRE@", text(1 + cf::kCommandBytes)},
      {"@FRESH_MS@", text(sf::kFreshFor.count() / 1000)},
      {"@KIND_STATUS@", text(link::Kind::kStatus)},
      {"@KIND_COMMAND@", text(link::Kind::kCommand)},
      {"@KIND_ANSWER@", text(link::Kind::kAnswer)},
      {"@STATE_OFFSET@", text(state_field->offset)},
      {"@LAST_STATE@", text(kStates.back().state)},
      {"@STATUS_GETS@", gets_of("status", sf::kFields)},
      {"@ANSWER_GETS@", gets_of("answer", cf::kAnswerFields)},
      {"@COMMAND_PUTS@", puts_of("command", cf::kCommandFields)},
  };
  for (const auto& [what, by] : values) out = replaced(std::move(out), what, by);
  return out;
}

}  // namespace holdfast::wire_doc
