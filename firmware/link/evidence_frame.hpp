// SPDX-License-Identifier: Apache-2.0
// The evidence frame: what the verdict of a status frame stands on. How it goes on the wire: link.hpp.
//
// A kind of its own, because version 1 of the status frame is frozen and full. The layout of version 1 is frozen, too;
// another layout is another version.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "link/link.hpp"
#include "slip/evidence.hpp"
#include "tactile/contact.hpp"
#include "tactile/types.hpp"

namespace holdfast::evidence_frame {

// What came over the wire: a newer firmware may send numbers that the tables below do not list.
struct EvidenceFrame {
  std::uint16_t sequence = 0;
  std::uint8_t finger = 0;
  std::uint8_t contact = 0;
  std::uint8_t evidence = 0;
  std::uint8_t unit = 0;
  std::uint8_t run = 0;
  std::uint16_t patches = 0;
  std::int32_t value_milli = 0;
  std::int32_t threshold_milli = 0;
  std::int16_t motion_log2_um_q8 = 0;
  std::int16_t coarse_log2_um_q8 = 0;
  std::int16_t growth_log2_q8 = 0;
  friend constexpr bool operator==(const EvidenceFrame&, const EvidenceFrame&) = default;
};

using link::Row;

inline constexpr std::uint8_t kContactUnknown = 255;
inline constexpr std::array<Row, 4> kContacts{{
    {0, contact::kPhaseNames[0], "nothing touches the gel"},
    {1, contact::kPhaseNames[1], "something touches the gel, and the contact grows"},
    {2, contact::kPhaseNames[2], "something touches the gel, and the contact does not grow"},
    {kContactUnknown, "UNKNOWN", "nobody can tell: the model does not read the picture between the markers"},
}};

inline constexpr std::array<Row, 6> kEvidences{{
    {0, kEvidenceNames[0], "there is none to show"},
    {1, kEvidenceNames[1], "motion of the relief that the object presses into the gel"},
    {2, kEvidenceNames[2], "motion of what is smoother or finer than the relief"},
    {3, kEvidenceNames[3], "a feature of the markers"},
    {4, kEvidenceNames[4], "the contact was lost: the patches of relief that are left"},
    {5, kEvidenceNames[5], "share of the relief that another has taken the place of"},
}};
static_assert(kEvidences.size() == kEvidenceNames.size() && kContacts.size() == contact::kPhaseNames.size() + 1);

// The unit's number is its place here.
inline constexpr std::array<std::string_view, 10> kUnits{"-",    "um",     "um/s", "nat",     "nat/s",
                                                         "log2", "1e-6/s", "1",    "patches", "%"};
[[nodiscard]] constexpr std::uint8_t unit_of(std::string_view unit) {
  std::uint8_t i = 0;
  while (i < kUnits.size() && kUnits[i] != unit) ++i;
  return i < kUnits.size() ? i : std::uint8_t{0};
}
static_assert(std::ranges::all_of(kFeatures,
                                  [](const FeatureInfo& feature) {
                                    return feature.unit == "log2(um)" || unit_of(feature.unit) != 0;
                                  }),
              "evidence::show() may name it");

// Of finger 0. `run`: pipeline::Result::run. What does not fit its field is cut.
[[nodiscard]] EvidenceFrame frame_of(std::uint16_t sequence, const evidence::Shown& shown,
                                     const contact::Contact& contact, const ImprintFeatures& imprint, std::int32_t run);

using Field = link::Field<EvidenceFrame>;

// clang-format off
inline constexpr std::array<Field, 15> kFields{{
    {"version", 0, link::WireType::kU8, "-", "layout of this table: 1", link::get_constant<link::kVersion>, nullptr},
    {"kind", 1, link::WireType::kU8, "-", "6: evidence frame", link::get_constant<link::Kind::kEvidence>, nullptr},
    {"sequence", 2, link::WireType::kU16, "1", "of the status frame that came before it",
     link::get<&EvidenceFrame::sequence>, link::put<&EvidenceFrame::sequence>},
    {"finger", 4, link::WireType::kU8, "-", "0: left, or the only one; 1: right",
     link::get<&EvidenceFrame::finger>, link::put<&EvidenceFrame::finger>},
    {"contact", 5, link::WireType::kU8, "-", "see Contact",
     link::get<&EvidenceFrame::contact>, link::put<&EvidenceFrame::contact>},
    {"evidence", 6, link::WireType::kU8, "-", "what decided, or is the strongest while nothing slips; see Evidence",
     link::get<&EvidenceFrame::evidence>, link::put<&EvidenceFrame::evidence>},
    {"unit", 7, link::WireType::kU8, "-", "of value and threshold; see Units",
     link::get<&EvidenceFrame::unit>, link::put<&EvidenceFrame::unit>},
    {"run", 8, link::WireType::kU8, "1", "frames in a row that said slip; counts up to the parameter `raise_frames`",
     link::get<&EvidenceFrame::run>, link::put<&EvidenceFrame::run>},
    {"patches", 9, link::WireType::kU16, "1", "patches of the gel into which something is pressed",
     link::get<&EvidenceFrame::patches>, link::put<&EvidenceFrame::patches>},
    {"value_milli", 11, link::WireType::kI32, "unit/1000", "of the evidence, in thousandths; cut where it does not fit",
     link::get<&EvidenceFrame::value_milli>, link::put<&EvidenceFrame::value_milli>},
    {"threshold_milli", 15, link::WireType::kI32, "unit/1000", "the model's first one for it, likewise",
     link::get<&EvidenceFrame::threshold_milli>, link::put<&EvidenceFrame::threshold_milli>},
    {"motion_log2_um_q8", 19, link::WireType::kI16, "log2(um)/256", "motion of the relief; 0: none",
     link::get<&EvidenceFrame::motion_log2_um_q8>, link::put<&EvidenceFrame::motion_log2_um_q8>},
    {"coarse_log2_um_q8", 21, link::WireType::kI16, "log2(um)/256", "motion of what is smoother or finer; 0: none",
     link::get<&EvidenceFrame::coarse_log2_um_q8>, link::put<&EvidenceFrame::coarse_log2_um_q8>},
    {"growth_log2_q8", 23, link::WireType::kI16, "log2/256", "of the relief since the picture that it is compared with",
     link::get<&EvidenceFrame::growth_log2_q8>, link::put<&EvidenceFrame::growth_log2_q8>},
    {"crc16", 25, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 24", nullptr, nullptr},
}};
// clang-format on

inline constexpr std::size_t kPayloadBytes = link::payload_bytes(kFields);
inline constexpr std::size_t kWireBytes = link::wire_bytes(kPayloadBytes);

static_assert(link::is_layout(kFields));
static_assert(kPayloadBytes == 27 && kWireBytes == 29, "version 1 is frozen");

// Returns kWireBytes.
std::size_t encode(const EvidenceFrame& frame, std::span<std::uint8_t, kWireBytes> wire);

// `payload`: as a link::Receiver left it. Nothing: of another version, kind or length.
[[nodiscard]] std::optional<EvidenceFrame> read(const link::Payload& payload);

}  // namespace holdfast::evidence_frame
