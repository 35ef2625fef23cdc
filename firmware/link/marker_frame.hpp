// SPDX-License-Identifier: Apache-2.0
// The marker frames: where the markers are, for whoever watches. Five markers a frame, because the wire's frames are
// short; a picture of 63 markers is 13 of them, 416 bytes. How they go on the wire: link.hpp.
//
// Beside the status frame they would fill a line of 115200 baud at 25 pictures a second, so the console sends those of
// every fifth picture. The layout of version 1 is frozen; another layout is another version.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "base/units.hpp"
#include "link/link.hpp"
#include "tactile/types.hpp"
#include "vision/markers.hpp"

namespace holdfast::marker_frame {

inline constexpr std::int32_t kPerFrame = 5;
inline constexpr std::int32_t kEvery = 5;        // pictures
inline constexpr std::int32_t kRestEvery = 125;  // pictures: who begins to listen later learns it within 5 s

struct Point {
  std::int16_t x_um = 0;
  std::int16_t y_um = 0;
  friend constexpr bool operator==(const Point&, const Point&) = default;
};

struct MarkerFrame {
  std::uint16_t sequence = 0;  // of the status frame of the same picture
  std::uint8_t rows = 0;
  std::uint8_t cols = 0;
  std::uint8_t first = 0;  // row * cols + col of the first of the five
  std::uint8_t valid = 0;  // bit k: marker first + k is seen and has a rest position
  std::array<Point, kPerFrame> points{};
  friend constexpr bool operator==(const MarkerFrame&, const MarkerFrame&) = default;
};

// How many frames a field of this size takes.
[[nodiscard]] constexpr std::int32_t frames_of(GridSize grid) {
  return (grid.count() + kPerFrame - 1) / kPerFrame;
}

// Piece `piece` of the field, in [0, frames_of(grid)). Lengths beyond +-32.767 mm, which no gel is wide, are cut.
[[nodiscard]] MarkerFrame displacement_piece(const DisplacementField& field, std::uint16_t sequence,
                                             std::int32_t piece);
// The mean of the positions that are valid; nothing: none is.
struct Middle {
  PixelsQ8 x;
  PixelsQ8 y;
};
[[nodiscard]] std::optional<Middle> middle_of(const MarkerField& rest);
// Rest positions from middle_of(). `pitch`: of the rest position, working image; `pitch_um`: the
// printed one. Range: pitch at least 1 raw.
[[nodiscard]] MarkerFrame rest_piece(const MarkerField& rest, PixelsQ8 pitch, std::int32_t pitch_um,
                                     std::uint16_t sequence, std::int32_t piece);

namespace detail {

template <std::size_t K>
[[nodiscard]] std::uint32_t get_x(const MarkerFrame& frame) {
  return static_cast<std::uint32_t>(frame.points[K].x_um);
}
template <std::size_t K>
[[nodiscard]] std::uint32_t get_y(const MarkerFrame& frame) {
  return static_cast<std::uint32_t>(frame.points[K].y_um);
}
template <std::size_t K>
void put_x(MarkerFrame& frame, std::uint32_t value) {
  frame.points[K].x_um = static_cast<std::int16_t>(value & 0xFFFF);
}
template <std::size_t K>
void put_y(MarkerFrame& frame, std::uint32_t value) {
  frame.points[K].y_um = static_cast<std::int16_t>(value & 0xFFFF);
}

}  // namespace detail

using Field = link::Field<MarkerFrame>;

// clang-format off
template <link::Kind kKind>
inline constexpr std::array<Field, 18> kFieldsOf{{
    {"version", 0, link::WireType::kU8, "-", "layout of this table: 1", link::get_constant<link::kVersion>, nullptr},
    {"kind", 1, link::WireType::kU8, "-", "4: displacement, 5: rest position", link::get_constant<kKind>, nullptr},
    {"sequence", 2, link::WireType::kU16, "1", "of the status frame of the same picture",
     link::get<&MarkerFrame::sequence>, link::put<&MarkerFrame::sequence>},
    {"rows", 4, link::WireType::kU8, "1", "of the lattice", link::get<&MarkerFrame::rows>, link::put<&MarkerFrame::rows>},
    {"cols", 5, link::WireType::kU8, "1", "of the lattice", link::get<&MarkerFrame::cols>, link::put<&MarkerFrame::cols>},
    {"first", 6, link::WireType::kU8, "1", "row * cols + col of the first of the five markers",
     link::get<&MarkerFrame::first>, link::put<&MarkerFrame::first>},
    {"valid", 7, link::WireType::kU8, "bits", "bit k: marker first + k is seen and has a rest position; its x and y are 0 otherwise",
     link::get<&MarkerFrame::valid>, link::put<&MarkerFrame::valid>},
    {"x0_um", 8, link::WireType::kI16, "um", "kind 4: displacement from rest; kind 5: rest position from the middle of all; +x right",
     detail::get_x<0>, detail::put_x<0>},
    {"y0_um", 10, link::WireType::kI16, "um", "likewise, +y down", detail::get_y<0>, detail::put_y<0>},
    {"x1_um", 12, link::WireType::kI16, "um", "marker first + 1", detail::get_x<1>, detail::put_x<1>},
    {"y1_um", 14, link::WireType::kI16, "um", "", detail::get_y<1>, detail::put_y<1>},
    {"x2_um", 16, link::WireType::kI16, "um", "marker first + 2", detail::get_x<2>, detail::put_x<2>},
    {"y2_um", 18, link::WireType::kI16, "um", "", detail::get_y<2>, detail::put_y<2>},
    {"x3_um", 20, link::WireType::kI16, "um", "marker first + 3", detail::get_x<3>, detail::put_x<3>},
    {"y3_um", 22, link::WireType::kI16, "um", "", detail::get_y<3>, detail::put_y<3>},
    {"x4_um", 24, link::WireType::kI16, "um", "marker first + 4", detail::get_x<4>, detail::put_x<4>},
    {"y4_um", 26, link::WireType::kI16, "um", "", detail::get_y<4>, detail::put_y<4>},
    {"crc16", 28, link::WireType::kU16, "-", "CRC-16 over bytes 0 to 27", nullptr, nullptr},
}};
// clang-format on

inline constexpr const auto& kDisplacementFields = kFieldsOf<link::Kind::kDisplacement>;
inline constexpr const auto& kRestFields = kFieldsOf<link::Kind::kRest>;
inline constexpr std::size_t kWireBytes = link::wire_bytes(link::payload_bytes(kDisplacementFields));

static_assert(link::is_layout(kDisplacementFields) && link::is_layout(kRestFields));
static_assert(kWireBytes == 32, "version 1 is frozen");

// `kind`: kDisplacement or kRest. Returns kWireBytes.
std::size_t encode(link::Kind kind, const MarkerFrame& frame, std::span<std::uint8_t, kWireBytes> wire);

// `payload`: as a link::Receiver left it. Nothing: of another version, kind or length, or no lattice has such a marker.
[[nodiscard]] std::optional<MarkerFrame> read(link::Kind kind, const link::Payload& payload);

}  // namespace holdfast::marker_frame
