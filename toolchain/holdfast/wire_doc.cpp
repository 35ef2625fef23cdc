// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/wire_doc.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <string_view>

#include "app/status_frame.hpp"
#include "base/status.hpp"

namespace holdfast::wire_doc {
namespace {

namespace sf = status_frame;

std::string text(std::size_t number) {
  return std::to_string(number);
}

std::string row(std::initializer_list<std::string_view> cells) {
  std::string line = "|";
  for (const std::string_view cell : cells) line += " " + std::string(cell) + " |";
  return line + "\n";
}

std::string head(std::initializer_list<std::string_view> cells) {
  std::string lines = row(cells) + "|";
  for (std::size_t i = 0; i < cells.size(); ++i) lines += "---|";
  return lines + "\n";
}

std::string_view name_of(sf::WireType type) {
  switch (type) {
    case sf::WireType::kU8:
      return "u8";
    case sf::WireType::kU16:
      return "u16";
    case sf::WireType::kU32:
      return "u32";
    case sf::WireType::kI32:
      return "i32";
  }
  return "";
}

// A grasp that slips: every field differs from 0 and from its neighbours.
constexpr sf::StatusFrame kExample{.sequence = 513,
                                   .timestamp_us = 16'909'060,
                                   .age_100us = 412,
                                   .state = DeviceState::kSlip,
                                   .reason = Reason::kSlipDetected,
                                   .slip = true,
                                   .grip_ok = false,
                                   .features_valid = true,
                                   .alive = true,
                                   .markers = 63,
                                   .vx_um_s = -1500,
                                   .vy_um_s = 250,
                                   .entropy_nat_q16 = 131'072,
                                   .entropy_rate_nat_s_q8 = 1024};

std::string example() {
  std::array<std::uint8_t, sf::kWireBytes> wire{};
  sf::encode(kExample, wire);
  std::string out = "```\n";
  for (std::size_t i = 0; i < wire.size(); ++i) {
    char hex[4];
    std::snprintf(hex, sizeof hex, "%02x", static_cast<unsigned>(wire[i]));
    out += std::string(hex) + (i + 1 == wire.size() || i % 17 == 16 ? "\n" : " ");
  }
  out += "```\n";
  const auto number = [](std::int64_t value) { return std::to_string(value); };
  out += "sequence " + number(kExample.sequence) + ", timestamp " + number(kExample.timestamp_us) + " us, age " +
         number(kExample.age_100us) + " x 0.1 ms, state " + std::string(info(kExample.state).name) + ", reason " +
         std::string(info(kExample.reason).name) + ", flags slip + features_valid + alive, " +
         number(kExample.markers) + " markers, vx " + number(kExample.vx_um_s) + " um/s, vy " +
         number(kExample.vy_um_s) + " um/s, entropy " + number(kExample.entropy_nat_q16) +
         " / 65536 nat, entropy rate " + number(kExample.entropy_rate_nat_s_q8) + " / 256 nat/s.\n";
  return out;
}

}  // namespace

std::string status_frame_markdown() {
  std::string out =
      "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
      "<!-- Written by wire_doc from firmware/app/status_frame.hpp and firmware/base/status.hpp; do not "
      "edit. -->\n"
      "# Status frame, version " +
      text(sf::kVersion) +
      "\n\n"
      "Sent once per camera frame. On the wire: COBS of the payload, then one 0x00; " +
      text(sf::kWireBytes) + " bytes in all, always. The payload has " + text(sf::kPayloadBytes) +
      " bytes, little endian, integers in two's complement.\n\n";
  out += head({"byte", "name", "type", "unit", "meaning"});
  for (const sf::Field& field : sf::kFields) {
    out +=
        row({text(field.offset), "`" + std::string(field.name) + "`", name_of(field.type), field.unit, field.meaning});
  }
  out +=
      "\nCRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected, no final xor; \"123456789\" "
      "gives "
      "0x29B1. A receiver drops a frame whose length, COBS or CRC is wrong and waits for the next 0x00. It "
      "ignores "
      "flag bits that it does not know.\n\n"
      "GRIP_OK counts only while ALIVE toggles (the receiver's rule): a frame that does not arrive is not "
      "fine.\n\n"
      "## Flags\n\n";
  out += head({"bit", "name", "meaning"});
  for (const sf::Flag& flag : sf::kFlags) out += row({text(flag.bit), flag.name, flag.meaning});
  out += "\nAll other bits are sent as 0.\n\n## States\n\n";
  out += head({"number", "name", "meaning"});
  for (const StateInfo& state : kStates) {
    out += row({text(static_cast<std::size_t>(state.state)), state.name, state.meaning});
  }
  out += "\n## Reasons\n\n";
  out += head({"number", "name", "what", "likely cause", "next step"});
  for (const ReasonInfo& reason : kReasons) {
    out += row({text(static_cast<std::size_t>(reason.reason)), "`" + std::string(reason.name) + "`", reason.what,
                reason.cause, reason.next});
  }
  return out + "\n## Example\n\n" + example();
}

}  // namespace holdfast::wire_doc
