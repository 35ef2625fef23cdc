// SPDX-License-Identifier: Apache-2.0
// The GelSight Mini through libcamera: for systems that leave cameras to it. Same pictures, same contract as
// camera_v4l2.hpp, which is the one to use: libcamera has threads of its own and takes memory for every request (how
// much is measured in tests/system), so the promise "no heap call after start" does not hold with it.
//
// libcamera offers of this sensor's controls only some, in units of its own: those of camera_controls.hpp are set on
// the video node beside it.
// Versions: written for 0.0.3 (Debian 12). What changed up to 0.7: generateConfiguration() takes a span from 0.1 on,
// planes() returns a span, metadata() a const reference; the calls here are spelled so that all of these compile.
// Seen to compile: 0.0.3 and 0.4.0 (Debian 13); every build tries declarations of 0.4 (tests/linux/libcamera_v0_4).
#pragma once

#include <memory>
#include <string_view>

#include "drivers/linux/camera_v4l2.hpp"
#include "hal/camera.hpp"

namespace holdfast::drivers {

class LibcameraCamera final : public hal::Camera {
 public:
  explicit LibcameraCamera(const V4l2Camera::Config& config);
  ~LibcameraCamera() override;
  LibcameraCamera(const LibcameraCamera&) = delete;
  LibcameraCamera& operator=(const LibcameraCamera&) = delete;

  // As V4l2Camera's.
  [[nodiscard]] const V4l2Camera::Counts& counts() const;

 private:
  struct State;

  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame& frame) override;
  void do_stop() override;
  [[nodiscard]] std::string_view do_identity() const override;
  [[nodiscard]] std::string_view do_problem() const override;
  [[nodiscard]] std::string_view do_unset() const override;
  [[nodiscard]] bool do_steady() const override;

  std::unique_ptr<State> state_;
};

}  // namespace holdfast::drivers
