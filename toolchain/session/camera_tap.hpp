// SPDX-License-Identifier: Apache-2.0
// A camera, and a copy of what it gave last: what the firmware saw, also where a plan of faults tore it on the way.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "hal/camera.hpp"

namespace holdfast::tool {

class CameraTap final : public hal::Camera {
 public:
  explicit CameraTap(hal::Camera& inside) : inside_(inside) {}
  // Of the frame last given, when it is JPEG; else nothing.
  [[nodiscard]] const std::vector<std::uint8_t>& jpeg() const { return jpeg_; }

 private:
  [[nodiscard]] bool do_start() override { return inside_.start(); }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override {
    const hal::Capture got = inside_.next(frame, timeout);
    jpeg_.clear();
    if (got == hal::Capture::kFrame && frame.format == hal::PixelFormat::kMjpeg) {
      jpeg_.assign(frame.bytes.begin(), frame.bytes.end());
    }
    return got;
  }
  void do_release(const hal::Frame& frame) override { inside_.release(frame); }
  void do_stop() override { inside_.stop(); }
  [[nodiscard]] std::string_view do_identity() const override { return inside_.identity(); }
  [[nodiscard]] std::string_view do_problem() const override { return inside_.problem(); }
  [[nodiscard]] bool do_live() const override { return inside_.live(); }

  hal::Camera& inside_;
  std::vector<std::uint8_t> jpeg_;
};

}  // namespace holdfast::tool
