// SPDX-License-Identifier: Apache-2.0
// The status frame: one message per camera frame for whoever holds the other end of the serial line.
//
// Wire: COBS(payload) and one 0x00. The payload is kFields in order, little endian, and ends in a CRC-16
// (base/crc16.hpp) over all bytes before it; kFields is the only place that knows an offset. The layout of
// version 1 is frozen; another layout is another version. STATUS_FRAME.md is written from these tables.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>

#include "base/cobs.hpp"
#include "base/status.hpp"
#include "base/units.hpp"

namespace holdfast::status_frame {

inline constexpr std::uint8_t kVersion = 1;
inline constexpr std::uint8_t kKindStatus = 1;
inline constexpr std::uint16_t kOldestAge = std::numeric_limits<std::uint16_t>::max();

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

enum class WireType : std::uint8_t { kU8, kU16, kU32, kI32 };

[[nodiscard]] constexpr std::size_t bytes_of(WireType type) {
  return type == WireType::kU8 ? 1 : type == WireType::kU16 ? 2 : 4;
}

struct Field {
  std::string_view name;
  std::uint8_t offset;  // bytes from the start of the payload
  WireType type;
  std::string_view unit;  // of one count
  std::string_view meaning;
  std::uint32_t (*get)(const StatusFrame&);        // wire bits, sign extended; null: the CRC
  void (*put)(StatusFrame&, std::uint32_t value);  // null: constant or computed
};

namespace detail {

template <std::uint8_t Value>
std::uint32_t get_constant(const StatusFrame& /*frame*/) {
  return Value;
}

template <auto Member>
std::uint32_t get(const StatusFrame& frame) {
  return static_cast<std::uint32_t>(frame.*Member);
}

template <auto Member>
void put(StatusFrame& frame, std::uint32_t value) {
  frame.*Member = static_cast<std::remove_cvref_t<decltype(frame.*Member)>>(value);
}

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
    {"version", 0, WireType::kU8, "-", "layout of this table: 1", detail::get_constant<kVersion>, nullptr},
    {"kind", 1, WireType::kU8, "-", "1: status frame", detail::get_constant<kKindStatus>, nullptr},
    {"sequence", 2, WireType::kU16, "1", "counts status frames, wraps; a gap is a lost frame",
     detail::get<&StatusFrame::sequence>, detail::put<&StatusFrame::sequence>},
    {"timestamp_us", 4, WireType::kU32, "us", "start of the picture's exposure on the sensor's clock, low 32 bits",
     detail::get<&StatusFrame::timestamp_us>, detail::put<&StatusFrame::timestamp_us>},
    {"age_100us", 8, WireType::kU16, "0.1 ms",
     "from that start to the sending of this frame, rounded up; 65535: 6.5535 s or more, or unknown",
     detail::get<&StatusFrame::age_100us>, detail::put<&StatusFrame::age_100us>},
    {"state", 10, WireType::kU8, "-", "see States",
     detail::get<&StatusFrame::state>, detail::put<&StatusFrame::state>},
    {"reason", 11, WireType::kU8, "-", "see Reasons; a number not listed there comes from newer firmware",
     detail::get<&StatusFrame::reason>, detail::put<&StatusFrame::reason>},
    {"flags", 12, WireType::kU8, "bits", "see Flags", detail::get_flags, detail::put_flags},
    {"markers", 13, WireType::kU8, "1", "how many markers the features stand on",
     detail::get<&StatusFrame::markers>, detail::put<&StatusFrame::markers>},
    {"vx_um_s", 14, WireType::kI32, "um/s", "mean speed of the markers, +x right",
     detail::get<&StatusFrame::vx_um_s>, detail::put<&StatusFrame::vx_um_s>},
    {"vy_um_s", 18, WireType::kI32, "um/s", "mean speed of the markers, +y down",
     detail::get<&StatusFrame::vy_um_s>, detail::put<&StatusFrame::vy_um_s>},
    {"entropy_nat_q16", 22, WireType::kI32, "nat/65536", "entropy of the displacements' lengths, 0 to ln 15",
     detail::get<&StatusFrame::entropy_nat_q16>, detail::put<&StatusFrame::entropy_nat_q16>},
    {"entropy_rate_nat_s_q8", 26, WireType::kI32, "nat/s/256", "change of the entropy per second",
     detail::get<&StatusFrame::entropy_rate_nat_s_q8>, detail::put<&StatusFrame::entropy_rate_nat_s_q8>},
    {"crc16", 30, WireType::kU16, "-", "CRC-16 over bytes 0 to 29", nullptr, nullptr},
}};
// clang-format on

inline constexpr std::size_t kPayloadBytes = kFields.back().offset + bytes_of(kFields.back().type);
inline constexpr std::size_t kWireBytes = cobs::max_encoded_bytes(kPayloadBytes) + 1;

static_assert(
    [] {
      std::size_t offset = 0;
      for (const Field& field : kFields) {
        if (field.offset != offset) return false;
        offset += bytes_of(field.type);
      }
      return true;
    }(),
    "the fields follow each other without gap or overlap");
static_assert(kFields.back().name == "crc16", "the CRC is the last field: it covers all bytes before it");
static_assert(kPayloadBytes == 32 && kWireBytes == 34, "version 1 is frozen");

// Returns kWireBytes: every status frame has the same length on the wire.
std::size_t encode(const StatusFrame& frame, std::span<std::uint8_t, kWireBytes> wire);

enum class DecodeError : std::uint8_t {
  kNone,
  kLength,   // not as many bytes as a status frame has, the delimiter included
  kFraming,  // no delimiter at the end, or no valid COBS before it
  kCrc,      // damaged on the way
  kVersion,  // sound, but of another layout: `frame` is not filled
  kKind,     // sound, but not a status frame
  kState,    // sound, but a state that this version does not know
};

struct [[nodiscard]] Decoded {
  DecodeError error = DecodeError::kNone;
  StatusFrame frame;  // filled when ok()
  [[nodiscard]] bool ok() const { return error == DecodeError::kNone; }
};

// `wire`: one frame, from behind the delimiter before it up to and with its own.
Decoded decode(std::span<const std::uint8_t> wire);

// Finds the frames in a stream of bytes. Fixed memory; resynchronises at the next delimiter, so that one
// damaged or missing delimiter costs the two frames beside it at most.
class Receiver {
 public:
  // Returns a result with each delimiter that ends something; nothing in between.
  std::optional<Decoded> push(std::uint8_t byte);

 private:
  std::array<std::uint8_t, kWireBytes> buffer_{};
  std::size_t count_ = 0;  // bytes since the last delimiter; stops at kWireBytes, which is too many
};

}  // namespace holdfast::status_frame
