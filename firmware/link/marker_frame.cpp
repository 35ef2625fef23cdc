// SPDX-License-Identifier: Apache-2.0
#include "link/marker_frame.hpp"

#include <algorithm>
#include <limits>

#include "base/math.hpp"

namespace holdfast::marker_frame {
namespace {

std::int16_t cut(std::int64_t um) {
  using Limits = std::numeric_limits<std::int16_t>;
  return static_cast<std::int16_t>(std::clamp<std::int64_t>(um, Limits::min(), Limits::max()));
}

// `point(i)`: of marker i, when it is valid.
template <typename Valid, typename PointOf>
MarkerFrame piece_of(GridSize grid, std::uint16_t sequence, std::int32_t piece, Valid valid, PointOf point) {
  MarkerFrame frame{};
  frame.sequence = sequence;
  frame.rows = grid.rows;
  frame.cols = grid.cols;
  const std::int32_t first = piece * kPerFrame;
  frame.first = static_cast<std::uint8_t>(first);
  for (std::int32_t k = 0; k < kPerFrame && first + k < grid.count(); ++k) {
    if (!valid(first + k)) continue;
    frame.valid = static_cast<std::uint8_t>(frame.valid | 1U << k);
    frame.points[idx(k)] = point(first + k);
  }
  return frame;
}

}  // namespace

MarkerFrame displacement_piece(const DisplacementField& field, std::uint16_t sequence, std::int32_t piece) {
  return piece_of(
      field.grid, sequence, piece, [&](std::int32_t i) { return field.markers[idx(i)].valid; },
      [&](std::int32_t i) {
        return Point{cut(field.markers[idx(i)].dx.raw()), cut(field.markers[idx(i)].dy.raw())};
      });
}

std::optional<Middle> middle_of(const MarkerField& rest) {
  std::int64_t sum_x = 0;
  std::int64_t sum_y = 0;
  std::int32_t known = 0;
  for (std::int32_t i = 0; i < rest.grid.count(); ++i) {
    const Marker& marker = rest.markers[idx(i)];
    if (!marker.valid) continue;
    sum_x += marker.x.raw();
    sum_y += marker.y.raw();
    ++known;
  }
  if (known == 0) return std::nullopt;
  return Middle{PixelsQ8::from_raw(static_cast<std::int32_t>(div_round(sum_x, known))),
                PixelsQ8::from_raw(static_cast<std::int32_t>(div_round(sum_y, known)))};
}

// Range: offsets up to 2^22 in Q8 px times pitch_um of 5000: below 2^35.
MarkerFrame rest_piece(const MarkerField& rest, PixelsQ8 pitch, std::int32_t pitch_um, std::uint16_t sequence,
                       std::int32_t piece) {
  const Middle middle = middle_of(rest).value_or(Middle{});
  const auto micrometres = [&](std::int64_t offset_px_q8) {
    return cut(div_round(offset_px_q8 * pitch_um, pitch.raw()));
  };
  return piece_of(
      rest.grid, sequence, piece, [&](std::int32_t i) { return rest.markers[idx(i)].valid; },
      [&](std::int32_t i) {
        const Marker& marker = rest.markers[idx(i)];
        return Point{micrometres(std::int64_t{marker.x.raw()} - middle.x.raw()),
                     micrometres(std::int64_t{marker.y.raw()} - middle.y.raw())};
      });
}

std::size_t encode(link::Kind kind, const MarkerFrame& frame, std::span<std::uint8_t, kWireBytes> wire) {
  return link::encode(kind == link::Kind::kRest ? kRestFields : kDisplacementFields, frame, wire);
}

std::optional<MarkerFrame> read(link::Kind kind, const link::Payload& payload) {
  MarkerFrame frame;
  const auto& fields = kind == link::Kind::kRest ? kRestFields : kDisplacementFields;
  if (link::read(fields, payload, frame) != link::DecodeError::kNone) return std::nullopt;
  const std::int32_t count = std::int32_t{frame.rows} * frame.cols;
  if (count > kMaxMarkers || frame.first >= count || frame.first % kPerFrame != 0) return std::nullopt;
  return frame;
}

}  // namespace holdfast::marker_frame
