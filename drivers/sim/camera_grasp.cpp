// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_grasp.hpp"

#include <cmath>

#include "drivers/sim/scene/jpeg_encode.hpp"

namespace holdfast::sim {

bool GraspCamera::do_start() {
  start_ = clock_.now();
  frames_ = scene::frame_count(config_.grasp);
  next_ = 0;
  return true;
}

hal::Capture GraspCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  if (next_ >= frames_) return hal::Capture::kGone;
  const std::chrono::microseconds due =
      start_ + std::chrono::microseconds(std::llround(next_ * 1e6 / config_.grasp.fps));
  if (due > clock_.now() + timeout) {
    clock_.advance(timeout);
    return hal::Capture::kTimeout;
  }
  clock_.advance_to(due);
  film(next_);

  const bool luma = config_.format == hal::PixelFormat::kLuma8;
  frame.bytes = luma ? pixels_ : jpeg_;
  frame.format = config_.format;
  frame.width = config_.picture.width;
  frame.height = config_.picture.height;
  frame.stride = luma ? config_.picture.width : 0;
  frame.timestamp = due;
  frame.sequence = static_cast<std::uint32_t>(next_);
  ++next_;
  lent_ = frame;
  return frame.bytes.empty() ? hal::Capture::kBad : hal::Capture::kFrame;
}

void GraspCamera::film(int index) {
  const scene::PictureConfig& picture = config_.picture;
  truth_ = scene::at(config_.grasp, index / config_.grasp.fps);
  dots_ = scene::dot_centers_px(picture, scene::markers_at(config_.grasp, truth_, config_.grid));
  const scene::Imprint imprint = scene::imprint_px(picture, config_.grasp, truth_);
  const std::uint64_t seed = static_cast<std::uint64_t>(index);
  if (config_.format == hal::PixelFormat::kLuma8) {
    scene::render_luma(picture, dots_, &imprint, seed, pixels_);
    return;
  }
  scene::render_rgb(picture, dots_, &imprint, seed, pixels_);
  jpeg_ = scene::encode_jpeg(pixels_, picture.width, picture.height, scene::JpegInput::kRgb, config_.jpeg_quality);
}

}  // namespace holdfast::sim
