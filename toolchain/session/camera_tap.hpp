// SPDX-License-Identifier: Apache-2.0
// A camera, and a copy of what it gave last: what the firmware saw, also where a plan of faults tore it on the way.
#pragma once

#include <chrono>
#include <cstdint>
#include <string_view>
#include <vector>

#include "hal/camera.hpp"

namespace holdfast::tool {

class CameraTap final : public hal::Camera {
 public:
  explicit CameraTap(hal::Camera& inside) : inside_(inside) {}
  // The frame last given, its bytes among them; empty ones: nothing came at the last try.
  [[nodiscard]] const hal::Frame& given() const { return given_; }
  // How many were given.
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  [[nodiscard]] bool do_start() override { return inside_.start(); }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override {
    const hal::Capture got = inside_.next(frame, timeout);
    given_.bytes = {};
    if (got != hal::Capture::kFrame) return got;
    bytes_.assign(frame.bytes.begin(), frame.bytes.end());
    given_ = frame;
    given_.bytes = bytes_;
    ++count_;
    return got;
  }
  void do_release(const hal::Frame& frame) override { inside_.release(frame); }
  void do_stop() override { inside_.stop(); }
  [[nodiscard]] std::string_view do_identity() const override { return inside_.identity(); }
  [[nodiscard]] std::string_view do_problem() const override { return inside_.problem(); }
  [[nodiscard]] std::string_view do_unset() const override { return inside_.unset(); }
  [[nodiscard]] bool do_steady() const override { return inside_.steady(); }
  [[nodiscard]] bool do_live() const override { return inside_.live(); }

  hal::Camera& inside_;
  std::vector<std::uint8_t> bytes_;
  hal::Frame given_;
  std::uint64_t count_ = 0;
};

}  // namespace holdfast::tool
