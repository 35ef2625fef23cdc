// SPDX-License-Identifier: Apache-2.0
// The load frame: the forces on the gel, for whoever watches. How it goes on the wire: link.hpp.
//
// A kind of its own, because the evidence frame's version 1 is frozen: a receiver that is older skips it. The layout of
// version 1 is frozen, too; another layout is another version.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "link/link.hpp"
#include "tactile/load.hpp"

namespace holdfast::load_frame {

// What came over the wire: a newer firmware may send numbers that kBases does not list.
struct LoadFrame {
  std::uint16_t sequence = 0;
  std::uint8_t finger = 0;
  std::uint8_t basis = 0;
  std::uint8_t flags = 0;
  std::int16_t shear_x_mn = 0;
  std::int16_t shear_y_mn = 0;
  std::int16_t normal_mn = 0;
  std::uint16_t friction_use_permille = 0;
  friend constexpr bool operator==(const LoadFrame&, const LoadFrame&) = default;
};

inline constexpr std::array<link::Row, 4> kBases{{
    {0, load::kBasisNames[0], "no reading: another lattice or pitch, or too many markers are missing"},
    {1, load::kBasisNames[1], "of a gel of 35 kPa, as the simulator has it: no weight was used"},
    {2, load::kBasisNames[2], "of this gel, by a weight for shear or for the normal load; the other has its scale"},
    {3, load::kBasisNames[3], "of this gel, by a weight for each"},
}};

// Bits of `flags`; all others are sent as 0.
inline constexpr std::array<link::Row, 2> kFlags{{
    {0, "within", "the contact is known to lie within the lattice; otherwise the errors are larger"},
    {1, "strained", "a marker moved by more than a quarter of the gel's thickness: beyond the linear range"},
}};

[[nodiscard]] LoadFrame frame_of(std::uint16_t sequence, std::uint8_t finger, const load::Load& load);

using Field = link::Field<LoadFrame>;

// clang-format off
inline constexpr std::array<Field, 11> kFields{{
    {"version", 0, link::WireType::kU8, "-", "layout of this table: 1", link::get_constant<link::kVersion>, nullptr},
    {"kind", 1, link::WireType::kU8, "-", "7: load frame", link::get_constant<link::Kind::kLoad>, nullptr},
    {"sequence", 2, link::WireType::kU16, "1", "of the status frame that came before it",
     link::get<&LoadFrame::sequence>, link::put<&LoadFrame::sequence>},
    {"finger", 4, link::WireType::kU8, "-", "0: left, or the only one; 1: right",
     link::get<&LoadFrame::finger>, link::put<&LoadFrame::finger>},
    {"basis", 5, link::WireType::kU8, "-", "what the forces stand on; see Basis",
     link::get<&LoadFrame::basis>, link::put<&LoadFrame::basis>},
    {"flags", 6, link::WireType::kU8, "bits", "see Load flags",
     link::get<&LoadFrame::flags>, link::put<&LoadFrame::flags>},
    {"shear_x_mn", 7, link::WireType::kI16, "mN", "force that the object lays on the gel, +x right",
     link::get<&LoadFrame::shear_x_mn>, link::put<&LoadFrame::shear_x_mn>},
    {"shear_y_mn", 9, link::WireType::kI16, "mN", "likewise, +y down",
     link::get<&LoadFrame::shear_y_mn>, link::put<&LoadFrame::shear_y_mn>},
    {"normal_mn", 11, link::WireType::kI16, "mN", "into the gel; below 0 by noise",
     link::get<&LoadFrame::normal_mn>, link::put<&LoadFrame::normal_mn>},
    {"friction_use_permille", 13, link::WireType::kU16, "1/1000", "shear over normal load; 0: less than 200 mN press",
     link::get<&LoadFrame::friction_use_permille>, link::put<&LoadFrame::friction_use_permille>},
    {"crc16", 15, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 14", nullptr, nullptr},
}};
// clang-format on

inline constexpr std::size_t kPayloadBytes = link::payload_bytes(kFields);
inline constexpr std::size_t kWireBytes = link::wire_bytes(kPayloadBytes);

static_assert(link::is_layout(kFields));
static_assert(kPayloadBytes == 17 && kWireBytes == 19, "version 1 is frozen");
static_assert(kBases.size() == load::kBasisNames.size());

// Returns kWireBytes.
std::size_t encode(const LoadFrame& frame, std::span<std::uint8_t, kWireBytes> wire);

// `payload`: as a link::Receiver left it. Nothing: of another version, kind or length.
[[nodiscard]] std::optional<LoadFrame> read(const link::Payload& payload);

}  // namespace holdfast::load_frame
