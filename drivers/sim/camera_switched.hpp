// SPDX-License-Identifier: Apache-2.0
// Makes any camera misbehave by hand, now and until told otherwise: for the console's `fault`. A plan of faults, frame
// by frame, is camera_faults.hpp's.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "hal/camera.hpp"

namespace holdfast::sim {

enum class CameraSwitch : std::uint8_t { kNone, kOff, kStuck, kBad, kGarbage, kDark, kGone };

class SwitchedCamera final : public hal::Camera {
 public:
  // `max_bytes`: of the longest frame inside; room for copies is taken here, once.
  SwitchedCamera(hal::Camera& inside, std::size_t max_bytes) : inside_(inside), bytes_(max_bytes) {}

  void set(CameraSwitch what) {
    what_ = what;
    kept_ = 0;
  }

 private:
  [[nodiscard]] bool do_start() override { return what_ != CameraSwitch::kGone && inside_.start(); }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame& /*frame*/) override { inside_.release(true_frame_); }
  void do_stop() override { inside_.stop(); }
  [[nodiscard]] std::string_view do_identity() const override { return inside_.identity(); }
  [[nodiscard]] std::string_view do_problem() const override {
    return what_ == CameraSwitch::kGone
               ? "the camera is unplugged. Likely cause: `fault camera gone`. Next: `fault off`"
               : inside_.problem();
  }
  [[nodiscard]] bool do_live() const override { return inside_.live(); }

  hal::Camera& inside_;
  CameraSwitch what_ = CameraSwitch::kNone;
  hal::Frame true_frame_;
  std::vector<std::uint8_t> bytes_;
  std::size_t kept_ = 0;  // bytes of the picture that kStuck repeats
  std::uint32_t random_ = 1;
};

}  // namespace holdfast::sim
