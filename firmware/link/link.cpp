// SPDX-License-Identifier: Apache-2.0
#include "link/link.hpp"

#include "base/crc16.hpp"

namespace holdfast::link {
namespace {

constexpr std::size_t kCrcBytes = 2;

std::uint16_t crc_of(const Payload& payload) {
  return crc16(std::span(payload.bytes).first(payload.size - kCrcBytes));
}

// Terminals send CR for Enter, programs CR LF or LF.
bool ends_line(std::uint8_t byte) {
  return byte == '\n' || byte == '\r';
}

}  // namespace

namespace detail {

void store(Payload& payload, std::size_t offset, std::size_t bytes, std::uint32_t value) {
  for (std::size_t i = 0; i < bytes; ++i) payload.bytes[offset + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

std::uint32_t load(const Payload& payload, std::size_t offset, std::size_t bytes) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < bytes; ++i) value |= std::uint32_t{payload.bytes[offset + i]} << (8 * i);
  return value;
}

}  // namespace detail

std::size_t seal(Payload& payload, std::span<std::uint8_t> wire) {
  detail::store(payload, payload.size - kCrcBytes, kCrcBytes, crc_of(payload));
  const std::size_t encoded =
      *cobs::encode(std::span(payload.bytes).first(payload.size), wire.first(wire_bytes(payload.size) - 1));
  wire[encoded] = 0;
  return encoded + 1;
}

DecodeError open(std::span<const std::uint8_t> wire, Payload& payload) {
  if (wire.size() < wire_bytes(kMinPayloadBytes) || wire.size() > kMaxWireBytes) return DecodeError::kLength;
  if (wire.back() != 0) return DecodeError::kFraming;
  const auto size = cobs::decode(wire.first(wire.size() - 1), payload.bytes);
  if (size != wire.size() - 2) return DecodeError::kFraming;
  payload.size = *size;
  const bool sound = detail::load(payload, payload.size - kCrcBytes, kCrcBytes) == crc_of(payload);
  return sound ? DecodeError::kNone : DecodeError::kCrc;
}

Event Receiver::push(std::uint8_t byte) {
  text_ = 0;
  if (byte == 0) return end();
  if (place_ == Place::kLost) {
    if (ends_line(byte)) place_ = Place::kText;
    return Event::kNone;
  }
  if (place_ == Place::kText) count_ = 0;
  buffer_[count_++] = byte;
  if (place_ == Place::kText) return text(1);
  if (count_ == 2 && byte > kLastVersion) {
    place_ = Place::kText;
    return text(2);
  }
  if (count_ < kMaxWireBytes) return Event::kNone;
  place_ = Place::kLost;
  ++damaged_;
  return Event::kDamaged;
}

Event Receiver::give_up() {
  text_ = 0;
  const bool begun = place_ == Place::kBegun && count_ > 0;
  if (in_frame()) place_ = Place::kText;
  if (!begun) return Event::kNone;
  if (count_ == 1) return text(1);
  ++damaged_;
  return Event::kDamaged;
}

// A byte alone between two delimiters is no frame, but may be an empty line.
Event Receiver::end() {
  const std::size_t count = place_ == Place::kBegun ? count_ : 0;
  place_ = Place::kBegun;
  count_ = 0;
  if (count <= 1) {
    text_ = count;
    if (count == 1) in_line_ = !ends_line(buffer_[0]);
    if (in_line_) buffer_[text_++] = 0;
    in_line_ = false;
    return text_ > 0 ? Event::kText : Event::kNone;
  }
  buffer_[count] = 0;
  if (open(std::span(buffer_).first(count + 1), payload_) == DecodeError::kNone) {
    ++frames_;
    return Event::kFrame;
  }
  ++damaged_;
  return Event::kDamaged;
}

Event Receiver::text(std::size_t count) {
  text_ = count;
  in_line_ = !ends_line(buffer_[count - 1]);
  return Event::kText;
}

}  // namespace holdfast::link
