// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/frame_log.hpp"

#include <algorithm>

namespace holdfast::log {
namespace {

MarkerField marker_field(const FrameRecord& record, std::span<const Arrow> arrows, int cols) {
  MarkerField out;
  out.header = record.header;
  out.frame = record.frame;
  cols = std::max(cols, 1);
  for (std::size_t i = 0; i < arrows.size(); ++i) {
    const Arrow& arrow = arrows[i];
    out.row.push_back(static_cast<std::uint8_t>(static_cast<int>(i) / cols));
    out.col.push_back(static_cast<std::uint8_t>(static_cast<int>(i) % cols));
    out.valid.push_back(arrow.valid ? 1 : 0);
    out.x_px.push_back(arrow.x_px);
    out.y_px.push_back(arrow.y_px);
    out.dx_px.push_back(arrow.dx_px);
    out.dy_px.push_back(arrow.dy_px);
  }
  return out;
}

template <IsMessage T>
std::uint16_t add_channel(McapWriter& writer, std::string_view topic) {
  return writer.add_channel(topic, schema_name<T>(), schema_text<T>());
}

}  // namespace

FrameLog::FrameLog(std::ostream& out, std::uint64_t begun_ns)
    : writer_(out),
      begun_ns_(begun_ns),
      slip_(add_channel<FrameRecord>(writer_, kSlipTopic)),
      markers_(add_channel<MarkerField>(writer_, kMarkersTopic)) {}

void FrameLog::add(const FrameRecord& since_begun, std::span<const Arrow> arrows, int cols,
                   std::span<const std::uint8_t> jpeg) {
  FrameRecord record = since_begun;
  const std::uint64_t at_ns = begun_ns_ + record.time_ns();
  record.header.stamp = {static_cast<std::int32_t>(at_ns / 1'000'000'000),
                         static_cast<std::uint32_t>(at_ns % 1'000'000'000)};
  if (!jpeg.empty()) {
    if (!camera_) camera_ = add_channel<CompressedImage>(writer_, kCameraTopic);
    writer_.write(*camera_, record.frame, at_ns, encode(CompressedImage{record.header, "jpeg", jpeg}));
  }
  writer_.write(slip_, record.frame, at_ns, encode(record));
  if (!arrows.empty()) writer_.write(markers_, record.frame, at_ns, encode(marker_field(record, arrows, cols)));
}

}  // namespace holdfast::log
