// SPDX-License-Identifier: Apache-2.0
// A camera that films a scripted grasp in virtual time: frame k shows the instant k / fps, is stamped
// start + k / fps and carries sequence k. No frame is ever dropped, late or damaged.
//
// Waiting for a frame moves the clock, at most by the timeout asked for. After the last frame the camera is
// gone; start() plays the grasp again from its beginning. One frame is lent at a time.
#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/grasp.hpp"
#include "drivers/sim/scene/render.hpp"
#include "hal/camera.hpp"

namespace holdfast::sim {

class GraspCamera final : public hal::Camera {
 public:
  struct Config {
    scene::GraspConfig grasp;
    scene::MarkerGrid grid;
    scene::PictureConfig picture = scene::camera_3280x2464();
    hal::PixelFormat format = hal::PixelFormat::kMjpeg;
    int jpeg_quality = 85;
  };

  GraspCamera(const Config& config, Clock& clock) : config_(config), clock_(clock) {}

  // Truth of the frame lent last; of time 0 before the first.
  [[nodiscard]] const scene::GraspTruth& truth() const { return truth_; }
  // The frame lent last, valid until the next one; empty before the first.
  [[nodiscard]] const hal::Frame& lent() const { return lent_; }
  // Exact centres of its dots in pixels of the picture, index = row * cols + col.
  [[nodiscard]] std::span<const scene::PointPx> dot_centers() const { return dots_; }

 private:
  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}

  void film(int index);

  Config config_;
  Clock& clock_;
  std::chrono::microseconds start_{};
  int frames_ = 0;
  int next_ = 0;
  scene::GraspTruth truth_;
  hal::Frame lent_;
  std::vector<scene::PointPx> dots_;
  std::vector<std::uint8_t> pixels_;
  std::vector<std::uint8_t> jpeg_;
};

}  // namespace holdfast::sim
