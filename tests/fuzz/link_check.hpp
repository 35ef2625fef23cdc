// SPDX-License-Identifier: Apache-2.0
// What must hold for any bytes on a serial line, for libFuzzer (link_fuzz.cpp) and for the tests; and the streams that
// both start from. The oracle looks at a stream as a whole and at its numbers in LINK.md; firmware and robot's header
// take it byte by byte.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "link/command_frame.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/load_frame.hpp"
#include "link/status_frame.hpp"
#include "toolchain/robot/holdfast_link.h"

namespace holdfast::test {

using LinkBytes = std::vector<std::uint8_t>;

inline LinkBytes bytes_of(std::string_view text) {
  return {text.begin(), text.end()};
}

inline LinkBytes operator+(LinkBytes a, const LinkBytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

// CRC-16/CCITT-FALSE by long division.
inline int slow_crc16(std::span<const std::uint8_t> bytes) {
  int crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    for (int bit = 7; bit >= 0; --bit) {
      const bool out = ((crc >> 15) & 1) != ((byte >> bit) & 1);
      crc = ((crc << 1) & 0xFFFF) ^ (out ? 0x1021 : 0);
    }
  }
  return crc;
}

// The frame around `body`, a payload without its CRC of fewer than 200 bytes: each run up to a zero, behind its length.
inline LinkBytes frame_around(LinkBytes body) {
  const int crc = slow_crc16(body);
  body.push_back(static_cast<std::uint8_t>(crc & 0xFF));
  body.push_back(static_cast<std::uint8_t>(crc >> 8));
  body.push_back(0);
  LinkBytes wire;
  for (auto from = body.begin(); from != body.end();) {
    const auto zero = std::find(from, body.end(), 0);
    wire.push_back(static_cast<std::uint8_t>(zero - from + 1));
    wire.insert(wire.end(), from, zero);
    from = zero + 1;
  }
  wire.push_back(0);
  return wire;
}

// The payload of a sound frame, from what stands between two delimiters.
inline std::optional<LinkBytes> payload_of(const LinkBytes& piece) {
  LinkBytes out;
  for (std::size_t at = 0; at < piece.size();) {
    const std::size_t end = at + piece[at];
    if (end > piece.size()) return std::nullopt;
    out.insert(out.end(), piece.begin() + static_cast<std::ptrdiff_t>(at) + 1,
               piece.begin() + static_cast<std::ptrdiff_t>(end));
    if (end < piece.size()) out.push_back(0);
    at = end;
  }
  if (out.size() < 4 || out.size() > 35) return std::nullopt;
  const std::size_t body = out.size() - 2;
  const int crc = out[body] + 256 * out[body + 1];
  return crc == slow_crc16(std::span(out).first(body)) ? std::optional(out) : std::nullopt;
}

struct LinkHeard {
  std::vector<LinkBytes> frames;  // payloads
  LinkBytes text;
  std::uint32_t damaged = 0;
  friend bool operator==(const LinkHeard&, const LinkHeard&) = default;
};

// LINK.md, Frames beside lines of text.
inline LinkHeard oracle_hears(std::span<const std::uint8_t> stream) {
  LinkHeard heard;
  for (std::size_t from = 0; from < stream.size();) {
    const auto rest = stream.subspan(from);
    const auto size = static_cast<std::size_t>(std::find(rest.begin(), rest.end(), 0) - rest.begin());
    const bool ended = size < rest.size();
    const LinkBytes piece(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(size));
    from += size + 1;
    LinkBytes text;
    if (size < 2 || piece[1] > 8) {
      if (size >= 2 || ended) text = piece;
    } else if (size >= 37) {
      ++heard.damaged;
      const auto line_end =
          std::find_if(piece.begin() + 37, piece.end(), [](std::uint8_t byte) { return byte == '\n' || byte == '\r'; });
      if (line_end != piece.end()) text.assign(line_end + 1, piece.end());
    } else if (ended) {
      const auto payload = payload_of(piece);
      if (payload) heard.frames.push_back(*payload);
      if (!payload) ++heard.damaged;
    }
    if (ended && !text.empty() && text.back() != '\n' && text.back() != '\r') text.push_back(0);
    heard.text.insert(heard.text.end(), text.begin(), text.end());
  }
  return heard;
}

inline bool same(const status_frame::StatusFrame& a, const holdfast_status& b) {
  const auto flag = [&](int bit) { return ((b.flags >> bit) & 1) != 0; };
  return a.sequence == b.sequence && a.timestamp_us == b.timestamp_us && a.age_100us == b.age_100us &&
         static_cast<int>(a.state) == b.state && static_cast<int>(a.reason) == b.reason && a.slip == flag(0) &&
         a.grip_ok == flag(1) && a.features_valid == flag(2) && a.alive == flag(3) && a.markers == b.markers &&
         a.vx_um_s == b.vx_um_s && a.vy_um_s == b.vy_um_s && a.entropy_nat_q16 == b.entropy_nat_q16 &&
         a.entropy_rate_nat_s_q8 == b.entropy_rate_nat_s_q8 && a.fingers == b.fingers && a.healthy == b.healthy &&
         a.contact == b.contact;
}

inline bool same(const command_frame::AnswerFrame& a, const holdfast_answer& b) {
  return a.sequence == b.sequence && static_cast<int>(a.command) == b.command && static_cast<int>(a.result) == b.result;
}

inline bool same(const evidence_frame::EvidenceFrame& a, const holdfast_evidence& b) {
  return a.sequence == b.sequence && a.finger == b.finger && a.contact == b.contact && a.evidence == b.evidence &&
         a.unit == b.unit && a.run == b.run && a.patches == b.patches && a.value_milli == b.value_milli &&
         a.threshold_milli == b.threshold_milli && a.motion_log2_um_q8 == b.motion_log2_um_q8 &&
         a.coarse_log2_um_q8 == b.coarse_log2_um_q8 && a.growth_log2_q8 == b.growth_log2_q8;
}

inline bool same(const load_frame::LoadFrame& a, const holdfast_load& b) {
  return a.sequence == b.sequence && a.finger == b.finger && a.basis == b.basis && a.flags == b.flags &&
         a.shear_x_mn == b.shear_x_mn && a.shear_y_mn == b.shear_y_mn && a.normal_mn == b.normal_mn &&
         a.friction_use_permille == b.friction_use_permille;
}

// What both sides make of a sound frame: the same, or a finding.
inline std::string check_frame(const link::Payload& payload, const holdfast_receiver& robot, int kind) {
  namespace cf = command_frame;
  const LinkBytes body(payload.bytes.begin(), payload.bytes.begin() + static_cast<std::ptrdiff_t>(payload.size) - 2);
  const status_frame::Decoded status = status_frame::read(payload);
  const auto command = cf::read_command(payload);
  const auto answer = cf::read_answer(payload);
  const auto evidence = evidence_frame::read(payload);
  const auto load = load_frame::read(payload);
  const bool known_state = kind == HOLDFAST_KIND_STATUS && body[10] <= 5;
  if (status.ok() != known_state) return "a status frame that one of them does not take";
  if (command.has_value() != (kind == HOLDFAST_KIND_COMMAND)) return "a command that one of them does not take";
  if (answer.has_value() != (kind == HOLDFAST_KIND_ANSWER)) return "an answer that one of them does not take";
  if (evidence.has_value() != (kind == HOLDFAST_KIND_EVIDENCE)) return "evidence that one of them does not take";
  if (load.has_value() != (kind == HOLDFAST_KIND_LOAD)) return "a load that one of them does not take";
  holdfast_status robot_status{};
  if (kind == HOLDFAST_KIND_STATUS && (holdfast_link_status(&robot, &robot_status) != 0) != status.ok()) {
    return "a state that one of them does not take";
  }
  if (status.ok() && !same(status.frame, robot_status)) return "another status";
  if (answer) {
    holdfast_answer robot_answer{};
    holdfast_link_answer(&robot, &robot_answer);
    std::array<std::uint8_t, cf::kAnswerBytes> wire{};
    cf::encode(*answer, wire);
    if (!same(*answer, robot_answer)) return "another answer";
    if (!std::ranges::equal(wire, frame_around(body))) return "an answer that is encoded otherwise";
  }
  if (evidence) {
    holdfast_evidence robot_evidence{};
    holdfast_link_evidence(&robot, &robot_evidence);
    std::array<std::uint8_t, evidence_frame::kWireBytes> wire{};
    evidence_frame::encode(*evidence, wire);
    if (!same(*evidence, robot_evidence)) return "another evidence";
    if (!std::ranges::equal(wire, frame_around(body))) return "evidence that is encoded otherwise";
  }
  if (load) {
    holdfast_load robot_load{};
    holdfast_link_load(&robot, &robot_load);
    std::array<std::uint8_t, load_frame::kWireBytes> wire{};
    load_frame::encode(*load, wire);
    if (!same(*load, robot_load)) return "another load";
    if (!std::ranges::equal(wire, frame_around(body))) return "a load that is encoded otherwise";
  }
  if (command) {
    const holdfast_command sent{command->sequence, static_cast<std::uint8_t>(command->command), command->argument};
    std::array<std::uint8_t, HOLDFAST_COMMAND_WIRE> robot_wire{};
    std::array<std::uint8_t, cf::kCommandBytes> wire{};
    holdfast_link_command(&sent, robot_wire.data());
    cf::encode(*command, wire);
    if (!std::ranges::equal(wire, frame_around(body))) return "a command that is encoded otherwise";
    if (!std::ranges::equal(std::span(robot_wire).subspan<1>(), wire) || robot_wire[0] != 0) {
      return "a command that the robot encodes otherwise";
    }
  }
  return "";
}

// A finding in words; empty: nothing to say.
//   * the firmware hears the frames, the text and the damage that the oracle hears
//   * the robot's header hears the same at every byte, and reads the same from every frame
inline std::string check_link_bytes(std::span<const std::uint8_t> stream) {
  link::Receiver firmware;
  holdfast_receiver robot{};
  LinkHeard heard;
  for (const std::uint8_t byte : stream) {
    const link::Event event = firmware.push(byte);
    const int kind = holdfast_link_push(&robot, byte);
    const auto text = firmware.text();
    if ((event == link::Event::kText) == text.empty()) return "text without its event";
    heard.text.insert(heard.text.end(), text.begin(), text.end());
    if (event == link::Event::kDamaged) ++heard.damaged;
    if ((kind == HOLDFAST_LINK_DAMAGED) != (event == link::Event::kDamaged)) return "damage for one of them";
    if ((kind > 0 || kind == HOLDFAST_LINK_OTHER) != (event == link::Event::kFrame)) return "a frame for one of them";
    if (event != link::Event::kFrame) continue;
    const link::Payload& payload = firmware.payload();
    heard.frames.emplace_back(payload.bytes.begin(), payload.bytes.begin() + static_cast<std::ptrdiff_t>(payload.size));
    if (!std::equal(heard.frames.back().begin(), heard.frames.back().end(), robot.bytes)) return "another payload";
    if (std::string finding = check_frame(payload, robot, kind); !finding.empty()) return finding;
  }
  const LinkHeard want = oracle_hears(stream);
  if (heard.frames != want.frames) return "the oracle hears other frames";
  if (heard.text != want.text) return "the oracle hears another text";
  if (heard.damaged != want.damaged || firmware.damaged() != want.damaged || robot.damaged != want.damaged) {
    return "the oracle counts another number of damaged frames";
  }
  const auto frames = static_cast<std::uint32_t>(want.frames.size());
  return firmware.frames() == frames && robot.frames == frames ? "" : "the oracle counts another number of frames";
}

// A stream of sound frames and of bytes as they are, from a script: bytes hardly ever make a CRC.
inline LinkBytes link_stream(std::span<const std::uint8_t> script) {
  LinkBytes stream;
  std::size_t at = 0;
  const auto next = [&] { return at < script.size() ? script[at++] : std::uint8_t{0}; };
  while (at < script.size()) {
    const std::uint8_t op = next();
    if (op < 0x80) {
      for (int i = op % 16; i >= 0; --i) stream.push_back(next());
      continue;
    }
    constexpr std::array<int, 8> kKind{0, 1, 2, 3, 0, 6, 7, 3};
    constexpr std::array<int, 8> kBody{0, 30, 6, 6, 0, 0, 25, 15};
    const int kind = kKind[op % 8U];
    const bool of_hand = kind == 1 && (op & 0x20) != 0;
    const int size = kind == 0 ? 2 + op / 4 % 16 * 2 : of_hand ? 33 : kBody[static_cast<std::size_t>(kind)];
    const std::uint8_t version = of_hand ? 2 : 1;
    LinkBytes body{(op & 0x40) != 0 ? next() : version, static_cast<std::uint8_t>(kind)};
    while (body.size() < static_cast<std::size_t>(size)) body.push_back(next());
    stream = stream + frame_around(body);
  }
  return stream;
}

// Streams with each kind of frame, lines between them, and one for each thing that goes wrong on a line.
inline std::vector<LinkBytes> link_seeds() {
  const LinkBytes status = frame_around(
      {1, 1, 1, 2, 4, 3, 2, 1, 0x9C, 1, 3, 98, 13, 63, 0x24, 0xFA, 0xFF, 0xFF, 0xFA, 0, 0, 0, 0, 0, 2, 0, 0, 4, 0, 0});
  const LinkBytes of_hand = frame_around({2,    1,    1, 2, 4, 3, 2, 1, 0x9C, 1, 3, 98, 13, 63, 0x24, 0xFA, 0xFF,
                                          0xFF, 0xFA, 0, 0, 0, 0, 0, 2, 0,    0, 4, 0,  0,  3,  2,    3});
  const LinkBytes command = frame_around({1, 2, 7, 0, 5, 1});
  const LinkBytes answer = frame_around({1, 3, 7, 0, 5, 0});
  const LinkBytes evidence =
      frame_around({1, 6, 1, 2, 0, 2, 1, 1, 2, 45, 0, 0, 0xF0, 0, 0, 0xD0, 0x84, 0, 0, 0xF1, 5, 0, 1, 0xF4, 0xFF});
  const LinkBytes load = frame_around({1, 7, 1, 2, 0, 2, 1, 0xD4, 0xFE, 0x90, 1, 0xE2, 4, 0x90, 1});
  const LinkBytes line = bytes_of("help\n");
  const LinkBytes zero{0};
  LinkBytes bad = status;
  bad[9] ^= 4;
  const LinkBytes cut(status.begin(), status.begin() + 20);
  return {status + status + answer,
          status + evidence + load + zero + line + evidence + load,
          line + zero + status + line + zero + answer + line,
          zero + command + zero + command + line,
          line + bad + status,
          zero + bad + line,
          zero + cut + line + line + zero + status,
          zero + cut + zero + line,
          bytes_of("ta") + zero + bytes_of("re\n") + zero + status,
          zero + bytes_of("\n") + zero + bytes_of("x") + zero,
          LinkBytes(40, 3) + line + line + zero + status,
          status + of_hand + zero + line + zero + of_hand,
          frame_around({1, 4, 0, 0}) + frame_around({2, 1, 9, 9}) + frame_around({1, 2}) + status,
          frame_around({1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0})};
}

}  // namespace holdfast::test
