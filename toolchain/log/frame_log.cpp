// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/frame_log.hpp"

#include <algorithm>
#include <cmath>

namespace holdfast::log {
namespace {

// To the microsecond, as all times of the firmware.
std::uint64_t time_ns(const LogFrame& frame) {
  return static_cast<std::uint64_t>(std::llround(std::max(frame.told.t_s, 0.0) * 1e6)) * 1000;
}

Header header_of(const LogFrame& frame) {
  const std::uint64_t ns = time_ns(frame);
  Header header;
  header.stamp = {static_cast<std::int32_t>(ns / 1'000'000'000), static_cast<std::uint32_t>(ns % 1'000'000'000)};
  return header;
}

MarkerField marker_field(const LogFrame& frame) {
  MarkerField out;
  out.header = header_of(frame);
  out.frame = static_cast<std::uint32_t>(frame.told.frame);
  const int cols = std::max(frame.cols, 1);
  for (std::size_t i = 0; i < frame.arrows.size(); ++i) {
    const tool::Arrow& arrow = frame.arrows[i];
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

SlipState slip_state(const LogFrame& frame) {
  const tool::ReportFrame& told = frame.told;
  SlipState out;
  out.header = header_of(frame);
  out.frame = static_cast<std::uint32_t>(told.frame);
  out.state = static_cast<std::uint8_t>(told.state);
  out.state_name = info(told.state).name;
  out.reason = static_cast<std::uint8_t>(told.reason);
  out.reason_name = info(told.reason).name;
  out.slip = told.slip;
  out.grip_ok = told.grip_ok;
  out.alive = frame.alive;
  out.accepted = told.accepted;
  out.features_valid = told.features_valid;
  out.rates_valid = told.rates_valid;
  out.markers = static_cast<std::uint32_t>(told.markers);
  out.vx_mm_s = told.vx_mm_s;
  out.vy_mm_s = told.vy_mm_s;
  out.entropy_nat = told.entropy_nat;
  out.entropy_rate_nat_s = told.entropy_rate_nat_s;
  out.decided_us = frame.decided_us;
  std::transform(told.histogram.begin(), told.histogram.end(), out.histogram.begin(),
                 [](int count) { return static_cast<std::uint32_t>(count); });
  return out;
}

FrameLog::FrameLog(std::ostream& out)
    : writer_(out),
      slip_(add_channel<SlipState>(writer_, kSlipTopic)),
      markers_(add_channel<MarkerField>(writer_, kMarkersTopic)) {}

void FrameLog::add(const LogFrame& frame) {
  const SlipState state = slip_state(frame);
  const std::uint64_t at_ns = time_ns(frame);
  if (!frame.jpeg.empty()) {
    if (!camera_) camera_ = add_channel<CompressedImage>(writer_, kCameraTopic);
    CompressedImage picture;
    picture.header = state.header;
    picture.data = frame.jpeg;
    writer_.write(*camera_, state.frame, at_ns, encode(picture));
  }
  writer_.write(slip_, state.frame, at_ns, encode(state));
  if (!frame.arrows.empty()) writer_.write(markers_, state.frame, at_ns, encode(marker_field(frame)));
}

}  // namespace holdfast::log
