// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/frame_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "drivers/sim/scene/picture/jpeg_encode.hpp"

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

constexpr Color kHere{1, 0.75, 0, 1}, kWay{0.2, 0.8, 1, 1}, kFine{1, 1, 1, 1}, kAlarm{1, 0.25, 0.2, 1};
constexpr Color kBehind{0, 0, 0, 0.6};

std::vector<std::uint8_t> annotations(const FrameRecord& record, std::span<const Arrow> arrows, double arrow_px) {
  const Time& at = record.header.stamp;
  PointsAnnotation here{at, PointsAnnotation::kPoints, {}, kHere, {}, kHere, 2};
  PointsAnnotation way{at, PointsAnnotation::kLineList, {}, kWay, {}, kWay, 1};
  for (const Arrow& arrow : arrows) {
    if (!arrow.valid) continue;
    const Point2 to{(arrow.x_px + 0.5) / arrow_px, (arrow.y_px + 0.5) / arrow_px};
    here.points.push_back(to);
    way.points.push_back({to.x - arrow.dx_px / arrow_px, to.y - arrow.dy_px / arrow_px});
    way.points.push_back(to);
  }
  std::string text{record.state_name};
  if (record.reason != Reason::kNone) text += fmt::format(" ({})", record.reason_name);
  if (record.evidence != Evidence::kNone) {
    text += fmt::format("  {} {:.1f} of {:.1f} {}", record.evidence_name, record.evidence_value,
                        record.evidence_threshold, record.evidence_unit);
  }
  const bool alarm = record.state == DeviceState::kSlip || record.state == DeviceState::kFault;
  ImageAnnotations out;
  out.points = {std::move(way), std::move(here)};
  out.texts = {{at, {4, 16}, text, 12, alarm ? kAlarm : kFine, kBehind}};
  return encode(out);
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

void FrameLog::add(const FrameRecord& since_begun, std::span<const Arrow> arrows, int cols, const hal::Frame& given,
                   double arrow_px) {
  FrameRecord record = since_begun;
  const std::uint64_t at_ns = begun_ns_ + record.time_ns();
  record.header.stamp = {static_cast<std::int32_t>(at_ns / 1'000'000'000),
                         static_cast<std::uint32_t>(at_ns % 1'000'000'000)};
  std::vector<std::uint8_t> encoded;
  std::span<const std::uint8_t> jpeg = given.bytes;
  if (given.format != hal::PixelFormat::kMjpeg && !jpeg.empty()) {
    if (given.stride == given.width) {
      encoded = scene::encode_jpeg(jpeg, given.width, given.height, scene::JpegInput::kGrey, kQuality);
    }
    jpeg = encoded;
    encoded_ = encoded_ || !encoded.empty();
  }
  if (!jpeg.empty()) {
    if (!camera_) {
      camera_ = add_channel<CompressedImage>(writer_, kCameraTopic);
      annotations_ = add_channel<ImageAnnotations>(writer_, kAnnotationsTopic);
    }
    writer_.write(*camera_, record.frame, at_ns, encode(CompressedImage{record.header, "jpeg", jpeg}));
    writer_.write(*annotations_, record.frame, at_ns, annotations(record, arrows, arrow_px));
  }
  writer_.write(slip_, record.frame, at_ns, encode(record));
  if (!arrows.empty()) writer_.write(markers_, record.frame, at_ns, encode(marker_field(record, arrows, cols)));
}

void FrameLog::finish() {
  if (has_pictures()) {
    about_["pictures"] = encoded_ ? fmt::format("grey, encoded as JPEG of quality {} for this file", kQuality)
                                  : "as the camera sent them";
  }
  if (!about_.empty()) writer_.add_metadata("holdfast", about_);
  writer_.finish();
}

}  // namespace holdfast::log
