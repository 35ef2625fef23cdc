// SPDX-License-Identifier: Apache-2.0
#include "link/status_frame.hpp"

namespace holdfast::status_frame {

std::size_t encode(const StatusFrame& frame, std::span<std::uint8_t> wire) {
  return frame.fingers == 0 ? link::encode(kFields, frame, wire) : link::encode(kHandFields, frame, wire);
}

Decoded read(const link::Payload& payload) {
  Decoded decoded;
  decoded.error = link::read(kFields, payload, decoded.frame);
  if (decoded.error == DecodeError::kVersion) decoded.error = link::read(kHandFields, payload, decoded.frame);
  if (decoded.ok() && static_cast<std::size_t>(decoded.frame.state) >= kStates.size()) {
    return {DecodeError::kState, {}};
  }
  return decoded;
}

Decoded decode(std::span<const std::uint8_t> wire) {
  link::Payload payload;
  const DecodeError error = link::open(wire, payload);
  return error == DecodeError::kNone ? read(payload) : Decoded{error, {}};
}

}  // namespace holdfast::status_frame
