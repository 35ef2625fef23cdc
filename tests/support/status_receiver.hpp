// SPDX-License-Identifier: Apache-2.0
// Hears status frames alone, and what is damaged.
#pragma once

#include <cstdint>
#include <optional>

#include "link/link.hpp"
#include "link/status_frame.hpp"

namespace holdfast::test {

class StatusReceiver {
 public:
  std::optional<status_frame::Decoded> push(std::uint8_t byte) {
    const link::Event event = frames_.push(byte);
    if (event == link::Event::kDamaged) return status_frame::Decoded{status_frame::DecodeError::kFraming, {}};
    if (event != link::Event::kFrame) return std::nullopt;
    const status_frame::Decoded decoded = status_frame::read(frames_.payload());
    if (decoded.error == status_frame::DecodeError::kKind) return std::nullopt;
    return decoded;
  }

 private:
  link::Receiver frames_;
};

}  // namespace holdfast::test
