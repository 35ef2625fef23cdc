// SPDX-License-Identifier: Apache-2.0
#include "app/status_frame.hpp"

#include "base/crc16.hpp"

namespace holdfast::status_frame {
namespace {

constexpr std::size_t kCrcOffset = kFields.back().offset;
using Payload = std::array<std::uint8_t, kPayloadBytes>;

void store(Payload& payload, const Field& field, std::uint32_t value) {
  for (std::size_t i = 0; i < bytes_of(field.type); ++i) {
    payload[field.offset + i] = static_cast<std::uint8_t>(value >> (8 * i));
  }
}

std::uint32_t load(const Payload& payload, const Field& field) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < bytes_of(field.type); ++i) {
    value |= std::uint32_t{payload[field.offset + i]} << (8 * i);
  }
  return value;
}

std::uint16_t crc_of(const Payload& payload) {
  return crc16(std::span(payload).first<kCrcOffset>());
}

}  // namespace

std::size_t encode(const StatusFrame& frame, std::span<std::uint8_t, kWireBytes> wire) {
  Payload payload;
  for (const Field& field : kFields) {
    store(payload, field, field.get != nullptr ? field.get(frame) : crc_of(payload));
  }
  // 32 bytes are one COBS block more or less: always 33 encoded bytes.
  static_assert(kPayloadBytes < 254);
  const std::size_t encoded = *cobs::encode(payload, wire.first<kWireBytes - 1>());
  wire[encoded] = 0;
  return encoded + 1;
}

Decoded decode(std::span<const std::uint8_t> wire) {
  if (wire.size() != kWireBytes) return {DecodeError::kLength, {}};
  if (wire.back() != 0) return {DecodeError::kFraming, {}};
  Payload payload;
  if (cobs::decode(wire.first(kWireBytes - 1), payload) != kPayloadBytes) return {DecodeError::kFraming, {}};
  if (load(payload, kFields.back()) != crc_of(payload)) return {DecodeError::kCrc, {}};
  if (load(payload, kFields[0]) != kVersion) return {DecodeError::kVersion, {}};
  if (load(payload, kFields[1]) != kKindStatus) return {DecodeError::kKind, {}};

  Decoded decoded;
  for (const Field& field : kFields) {
    if (field.put != nullptr) field.put(decoded.frame, load(payload, field));
  }
  if (static_cast<std::size_t>(decoded.frame.state) >= kStates.size()) return {DecodeError::kState, {}};
  return decoded;
}

std::optional<Decoded> Receiver::push(std::uint8_t byte) {
  if (byte != 0) {
    if (count_ < kWireBytes) buffer_[count_++] = byte;
    return std::nullopt;
  }
  const std::size_t count = count_;
  count_ = 0;
  if (count == 0) return std::nullopt;  // delimiters may repeat
  if (count == kWireBytes) return Decoded{DecodeError::kLength, {}};
  buffer_[count] = 0;
  return decode(std::span(buffer_).first(count + 1));
}

}  // namespace holdfast::status_frame
