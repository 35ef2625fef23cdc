// SPDX-License-Identifier: Apache-2.0
// The status frame: one message per camera frame for whoever holds the other end of the serial line.
// How it goes on the wire: link.hpp. The layouts are frozen; another layout is another version. A device of one finger
// sends version 1. One of two sends version 1 with the hand's state, or, where it is told so, version 2: the same
// fields at the same places, and behind them what each finger says.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string_view>

#include "base/status.hpp"
#include "base/units.hpp"
#include "link/link.hpp"

namespace holdfast::status_frame {

using link::DecodeError;

inline constexpr std::uint16_t kOldestAge = std::numeric_limits<std::uint16_t>::max();
// The receiver's rule (DESIGN.md): GRIP_OK counts only while the last change of ALIVE is younger than this.
inline constexpr Micros kFreshFor{150'000};

struct StatusFrame {
  std::uint16_t sequence = 0;      // counts status frames, wraps; a gap is a lost frame
  std::uint32_t timestamp_us = 0;  // see low_timestamp_us()
  std::uint16_t age_100us = kOldestAge;
  DeviceState state = DeviceState::kBoot;
  Reason reason = Reason::kNone;  // a newer firmware may send numbers that kReasons does not list
  bool slip = false;
  bool grip_ok = false;
  bool features_valid = false;  // false: markers and the four features below are 0 and mean nothing
  bool alive = false;
  std::uint8_t markers = 0;
  std::int32_t vx_um_s = 0;
  std::int32_t vy_um_s = 0;
  std::int32_t entropy_nat_q16 = 0;
  std::int32_t entropy_rate_nat_s_q8 = 0;
  // Version 2: the left finger in bit 0, the right one in bit 1. `fingers` 0: version 1, which does not tell.
  std::uint8_t fingers = 0;
  std::uint8_t healthy = 0;
  std::uint8_t contact = 0;
  friend constexpr bool operator==(const StatusFrame&, const StatusFrame&) = default;
};

// Low 32 bits of the frame's timestamp: wraps after 71.6 minutes.
[[nodiscard]] constexpr std::uint32_t low_timestamp_us(Micros timestamp) {
  return static_cast<std::uint32_t>(timestamp.count() & 0xFFFFFFFF);
}

// Age in 0.1 ms, rounded up: never younger than the truth. A negative age comes from a broken clock and
// counts as kOldestAge, like all ages from 6.5535 s on. Range: any.
[[nodiscard]] constexpr std::uint16_t age_100us(Micros age) {
  constexpr Micros kOldest{std::int64_t{kOldestAge} * 100};
  if (age < Micros{0} || age > kOldest) return kOldestAge;
  return static_cast<std::uint16_t>((age.count() + 99) / 100);
}

struct Flag {
  std::uint8_t bit;
  std::string_view name;
  std::string_view meaning;
  bool StatusFrame::*member;
};

inline constexpr std::array<Flag, 4> kFlags{{
    {0, "slip", "the debounced decision: the object slips", &StatusFrame::slip},
    {1, "grip_ok", "level of the line GRIP_OK; counts only while ALIVE is fresh", &StatusFrame::grip_ok},
    {2, "features_valid", "markers and features belong to this frame; otherwise they are 0",
     &StatusFrame::features_valid},
    {3, "alive", "level of the line ALIVE; toggles once per accepted frame", &StatusFrame::alive},
}};

using Field = link::Field<StatusFrame>;

namespace detail {

inline std::uint32_t get_flags(const StatusFrame& frame) {
  std::uint32_t bits = 0;
  for (const Flag& flag : kFlags) bits |= (frame.*flag.member ? 1U : 0U) << flag.bit;
  return bits;
}

inline void put_flags(StatusFrame& frame, std::uint32_t bits) {
  for (const Flag& flag : kFlags) frame.*flag.member = ((bits >> flag.bit) & 1U) != 0;
}

}  // namespace detail

// clang-format off
inline constexpr std::array<Field, 14> kFields{{
    {"version", 0, link::WireType::kU8, "-", "layout of this table: 1", link::get_constant<link::kVersion>, nullptr},
    {"kind", 1, link::WireType::kU8, "-", "1: status frame", link::get_constant<link::Kind::kStatus>, nullptr},
    {"sequence", 2, link::WireType::kU16, "1", "counts status frames, wraps; a gap is a lost frame",
     link::get<&StatusFrame::sequence>, link::put<&StatusFrame::sequence>},
    {"timestamp_us", 4, link::WireType::kU32, "us", "start of the picture's exposure on the sensor's clock, low 32 bits",
     link::get<&StatusFrame::timestamp_us>, link::put<&StatusFrame::timestamp_us>},
    {"age_100us", 8, link::WireType::kU16, "0.1 ms",
     "from that start to the sending of this frame, rounded up; 65535: 6.5535 s or more, or unknown",
     link::get<&StatusFrame::age_100us>, link::put<&StatusFrame::age_100us>},
    {"state", 10, link::WireType::kU8, "-", "see States",
     link::get<&StatusFrame::state>, link::put<&StatusFrame::state>},
    {"reason", 11, link::WireType::kU8, "-", "see Reasons; a number not listed there comes from newer firmware",
     link::get<&StatusFrame::reason>, link::put<&StatusFrame::reason>},
    {"flags", 12, link::WireType::kU8, "bits", "see Flags", detail::get_flags, detail::put_flags},
    {"markers", 13, link::WireType::kU8, "1", "how many markers the features stand on",
     link::get<&StatusFrame::markers>, link::put<&StatusFrame::markers>},
    {"vx_um_s", 14, link::WireType::kI32, "um/s", "mean speed of the markers, +x right",
     link::get<&StatusFrame::vx_um_s>, link::put<&StatusFrame::vx_um_s>},
    {"vy_um_s", 18, link::WireType::kI32, "um/s", "mean speed of the markers, +y down",
     link::get<&StatusFrame::vy_um_s>, link::put<&StatusFrame::vy_um_s>},
    {"entropy_nat_q16", 22, link::WireType::kI32, "nat/65536", "entropy of the displacements' lengths, 0 to ln 15",
     link::get<&StatusFrame::entropy_nat_q16>, link::put<&StatusFrame::entropy_nat_q16>},
    {"entropy_rate_nat_s_q8", 26, link::WireType::kI32, "nat/s/256", "change of the entropy per second",
     link::get<&StatusFrame::entropy_rate_nat_s_q8>, link::put<&StatusFrame::entropy_rate_nat_s_q8>},
    {"crc16", 30, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 29", nullptr, nullptr},
}};
// clang-format on

inline constexpr std::size_t kPayloadBytes = link::payload_bytes(kFields);
inline constexpr std::size_t kWireBytes = link::wire_bytes(kPayloadBytes);

static_assert(link::is_layout(kFields));
static_assert(kPayloadBytes == 32 && kWireBytes == 34, "version 1 is frozen");

inline constexpr std::uint8_t kHandVersion = 2;

// Version 2: the fields of version 1, and three more before the CRC.
inline constexpr std::array<Field, 17> kHandFields = [] {
  std::array<Field, 17> fields{};
  std::copy(kFields.begin(), kFields.end() - 1, fields.begin());
  fields[0] = {"version", 0, link::WireType::kU8, "-", "layout of this table: 2", link::get_constant<kHandVersion>,
               nullptr};
  fields[13] = {"fingers",
                30,
                link::WireType::kU8,
                "bits",
                "fingers that there are: bit 0 left, bit 1 right",
                link::get<&StatusFrame::fingers>,
                link::put<&StatusFrame::fingers>};
  fields[14] = {"healthy",
                31,
                link::WireType::kU8,
                "bits",
                "of these, in state OK or SLIP by what each sees alone",
                link::get<&StatusFrame::healthy>,
                link::put<&StatusFrame::healthy>};
  fields[15] = {"contact",
                32,
                link::WireType::kU8,
                "bits",
                "of these, with something that touches the gel",
                link::get<&StatusFrame::contact>,
                link::put<&StatusFrame::contact>};
  fields[16] = {"crc16", 33, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 32", nullptr, nullptr};
  return fields;
}();

inline constexpr std::size_t kHandPayloadBytes = link::payload_bytes(kHandFields);
inline constexpr std::size_t kMostWireBytes = link::wire_bytes(kHandPayloadBytes);

static_assert(link::is_layout(kHandFields));
static_assert(kHandPayloadBytes == 35 && kMostWireBytes == 37, "version 2 is frozen");

// Version 2 where the frame tells of fingers. Returns kWireBytes or kMostWireBytes: every status frame of a version has
// the same length on the wire. Range: so much room.
std::size_t encode(const StatusFrame& frame, std::span<std::uint8_t> wire);

struct [[nodiscard]] Decoded {
  DecodeError error = DecodeError::kNone;
  StatusFrame frame;  // filled when ok()
  [[nodiscard]] bool ok() const { return error == DecodeError::kNone; }
};

// `payload`: as a link::Receiver left it.
Decoded read(const link::Payload& payload);

// `wire`: one frame, from behind the delimiter before it up to and with its own.
Decoded decode(std::span<const std::uint8_t> wire);

}  // namespace holdfast::status_frame
