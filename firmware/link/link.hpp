// SPDX-License-Identifier: Apache-2.0
// What all frames on serial have in common: tables of fields, check sum, and how frames are found in a stream of bytes.
//
// Wire: COBS(payload) and one 0x00. A payload is the fields of its kind's table in order, little endian; it begins with
// version and kind and ends in a CRC-16 (base/crc16.hpp) over all bytes before it. A table is the only place that
// knows an offset: encoder, decoder, LINK.md and the header for robots (toolchain/robot) are made from it.
//
// Beside text: a frame also begins with 0x00 there, and its first three bytes are then 00, any, version. Versions end
// before TAB, and no line of text holds such a byte: no line is ever taken for a frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <type_traits>

#include "base/cobs.hpp"

namespace holdfast::link {

inline constexpr std::uint8_t kVersion = 1;
inline constexpr std::uint8_t kLastVersion = 8;  // TAB is 9
enum class Kind : std::uint8_t {
  kStatus = 1,
  kCommand = 2,
  kAnswer = 3,
  kDisplacement = 4,
  kRest = 5,
  kEvidence = 6,
  kLoad = 7
};

inline constexpr std::size_t kMaxPayloadBytes = 35;
inline constexpr std::size_t kMinPayloadBytes = 4;  // version, kind, CRC
// COBS adds one byte, whatever the payload: it has no block of 254 bytes.
[[nodiscard]] constexpr std::size_t wire_bytes(std::size_t payload_bytes) {
  return payload_bytes + 2;
}
inline constexpr std::size_t kMaxWireBytes = wire_bytes(kMaxPayloadBytes);
static_assert(cobs::max_encoded_bytes(kMaxPayloadBytes) + 1 == kMaxWireBytes);

// A number of a field, or a bit of one, in words. Numbers are sent on the wire and never re-used.
struct Row {
  std::uint8_t number;
  std::string_view name;
  std::string_view meaning;
};

enum class WireType : std::uint8_t { kU8, kU16, kU32, kI16, kI32 };

[[nodiscard]] constexpr std::size_t bytes_of(WireType type) {
  return type == WireType::kU8 ? 1 : type == WireType::kU16 || type == WireType::kI16 ? 2 : 4;
}

template <typename Message>
struct Field {
  std::string_view name;
  std::uint8_t offset;  // bytes from the start of the payload
  WireType type;
  std::string_view unit;  // of one count
  std::string_view meaning;
  std::uint32_t (*get)(const Message&);        // wire bits, sign extended; null: the CRC
  void (*put)(Message&, std::uint32_t value);  // null: constant or computed
};

template <auto Value, typename Message>
std::uint32_t get_constant(const Message& /*message*/) {
  return static_cast<std::uint32_t>(Value);
}

template <auto Member, typename Message>
std::uint32_t get(const Message& message) {
  return static_cast<std::uint32_t>(message.*Member);
}

template <auto Member, typename Message>
void put(Message& message, std::uint32_t value) {
  message.*Member = static_cast<std::remove_cvref_t<decltype(message.*Member)>>(value);
}

template <typename Table>
[[nodiscard]] constexpr std::size_t payload_bytes(const Table& fields) {
  return fields.back().offset + bytes_of(fields.back().type);
}

// Version and kind first, no gap or overlap, and the CRC last: it covers all bytes before it.
template <typename Table>
[[nodiscard]] constexpr bool is_layout(const Table& fields) {
  std::size_t offset = 0;
  for (const auto& field : fields) {
    if (field.offset != offset) return false;
    offset += bytes_of(field.type);
  }
  return fields[0].name == "version" && fields[1].name == "kind" && fields.back().name == "crc16" &&
         bytes_of(fields.back().type) == 2 && offset <= kMaxPayloadBytes;
}

struct Payload {
  std::array<std::uint8_t, kMaxPayloadBytes> bytes{};
  std::size_t size = 0;
};

enum class DecodeError : std::uint8_t {
  kNone,
  kLength,   // not as many bytes as a frame of this kind has
  kFraming,  // no delimiter at the end, or no valid COBS before it
  kCrc,      // damaged on the way
  kVersion,  // sound, but of another layout
  kKind,     // sound, but of another kind
  kState,    // sound, but a state that this version does not know
};

// Fills in the CRC and writes the frame; returns wire_bytes(payload.size).
// Range: kMinPayloadBytes <= payload.size, wire_bytes(payload.size) <= wire.size().
std::size_t seal(Payload& payload, std::span<std::uint8_t> wire);

// `wire`: one frame, from behind the delimiter before it up to and with its own. kNone: its CRC is right.
[[nodiscard]] DecodeError open(std::span<const std::uint8_t> wire, Payload& payload);

namespace detail {

void store(Payload& payload, std::size_t offset, std::size_t bytes, std::uint32_t value);
[[nodiscard]] std::uint32_t load(const Payload& payload, std::size_t offset, std::size_t bytes);

}  // namespace detail

template <typename Message, std::size_t N>
std::size_t encode(const std::array<Field<Message>, N>& fields, const Message& message, std::span<std::uint8_t> wire) {
  Payload payload;
  payload.size = payload_bytes(fields);
  for (const Field<Message>& field : fields) {
    if (field.get != nullptr) detail::store(payload, field.offset, bytes_of(field.type), field.get(message));
  }
  return seal(payload, wire);
}

// `payload`: as open() or a Receiver left it. `message` is filled when kNone is returned.
template <typename Message, std::size_t N>
[[nodiscard]] DecodeError read(const std::array<Field<Message>, N>& fields, const Payload& payload, Message& message) {
  const auto value = [&](const Field<Message>& field) {
    return detail::load(payload, field.offset, bytes_of(field.type));
  };
  if (value(fields[0]) != fields[0].get(message)) return DecodeError::kVersion;
  if (value(fields[1]) != fields[1].get(message)) return DecodeError::kKind;
  if (payload.size != payload_bytes(fields)) return DecodeError::kLength;
  for (const Field<Message>& field : fields) {
    if (field.put != nullptr) field.put(message, value(field));
  }
  return DecodeError::kNone;
}

enum class Event : std::uint8_t {
  kNone,
  kFrame,    // payload() is that of a sound frame, of any version and kind
  kDamaged,  // what began as a frame is none
  kText,     // text() has come; on a port without text, noise
};

// Finds the frames in a stream of bytes, and the text between them. Fixed memory; every 0x00 is a new beginning.
//
// A damaged or missing delimiter costs the frames beside it, and what follows to the end of that line. A 0x00 in the
// middle of a line is handed on with it: whoever reads lines refuses those with such a byte, so that the halves of a
// broken line never become a command.
class Receiver {
 public:
  Event push(std::uint8_t byte);
  // Something has begun that may be a frame, or was none, and has not ended.
  [[nodiscard]] bool in_frame() const { return place_ == Place::kLost || (place_ == Place::kBegun && count_ > 0); }
  // Nothing came for long: what has begun is no frame, and what comes is text. One byte alone is text as well.
  Event give_up();

  // Both of the last push().
  [[nodiscard]] const Payload& payload() const { return payload_; }
  [[nodiscard]] std::span<const std::uint8_t> text() const { return std::span(buffer_).first(text_); }

  // Since start; they wrap.
  [[nodiscard]] std::uint32_t frames() const { return frames_; }
  [[nodiscard]] std::uint32_t damaged() const { return damaged_; }

 private:
  enum class Place : std::uint8_t { kBegun, kText, kLost };
  Event end();
  Event text(std::size_t count);

  std::array<std::uint8_t, kMaxWireBytes> buffer_{};
  std::size_t count_ = 0;  // bytes of buffer_ since the last delimiter
  std::size_t text_ = 0;
  Payload payload_;
  std::uint32_t frames_ = 0;
  std::uint32_t damaged_ = 0;
  Place place_ = Place::kBegun;
  bool in_line_ = false;  // text came, and its line has not ended
};

}  // namespace holdfast::link
