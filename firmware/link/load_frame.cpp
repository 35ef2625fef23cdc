// SPDX-License-Identifier: Apache-2.0
#include "link/load_frame.hpp"

namespace holdfast::load_frame {

// Every value is in its field's range by its type's.
LoadFrame frame_of(std::uint16_t sequence, std::uint8_t finger, const load::Load& load) {
  static_assert(unit::Millinewtons::kMin >= INT16_MIN && unit::Millinewtons::kMax <= INT16_MAX);
  static_assert(unit::Permille::kMax <= UINT16_MAX);
  LoadFrame frame{};
  frame.sequence = sequence;
  frame.finger = finger;
  frame.basis = static_cast<std::uint8_t>(load.basis);
  frame.flags = static_cast<std::uint8_t>((load.within ? 1 : 0) | (load.strained ? 2 : 0));
  frame.shear_x_mn = static_cast<std::int16_t>(load.shear_x.raw());
  frame.shear_y_mn = static_cast<std::int16_t>(load.shear_y.raw());
  frame.normal_mn = static_cast<std::int16_t>(load.normal.raw());
  frame.friction_use_permille = static_cast<std::uint16_t>(load.friction_use.raw());
  return frame;
}

std::size_t encode(const LoadFrame& frame, std::span<std::uint8_t, kWireBytes> wire) {
  return link::encode(kFields, frame, wire);
}

std::optional<LoadFrame> read(const link::Payload& payload) {
  LoadFrame frame;
  if (link::read(kFields, payload, frame) != link::DecodeError::kNone) return std::nullopt;
  return frame;
}

}  // namespace holdfast::load_frame
