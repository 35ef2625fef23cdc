// SPDX-License-Identifier: Apache-2.0
// A camera that shows a fixed list of luma pictures, over and over, in virtual time. Takes its memory when
// built. Not modelled: a queue that overflows. A reader that comes late gets every picture, at once and with
// its old stamp.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/sim/clock.hpp"
#include "hal/camera.hpp"
#include "vision/luma.hpp"

namespace holdfast::sim {

class CameraMemory final : public hal::Camera {
 public:
  struct Config {
    std::chrono::microseconds period{40'000};   // exposure to exposure: 25 fps
    std::chrono::microseconds latency{40'000};  // start of exposure to arrival: one period at least
    std::uint64_t cycles = 1;                   // how often the whole list is shown
    bool live = false;                          // a sensor: from the second round on every picture has new noise
    std::string_view identity{};
  };

  // `pictures` point at memory of the caller, which outlives the camera.
  CameraMemory(Clock& clock, std::vector<LumaView> pictures, const Config& config)
      : clock_(clock), pictures_(std::move(pictures)), config_(config) {
    std::size_t most = 0;
    for (const LumaView& picture : pictures_) most = std::max(most, bytes_of(picture));
    if (config_.live) room_.reserve(most);
  }

  // Frames handed out and not given back.
  [[nodiscard]] int borrowed() const { return borrowed_; }

 private:
  [[nodiscard]] static std::size_t bytes_of(const LumaView& picture) {
    return static_cast<std::size_t>(picture.stride) * static_cast<std::size_t>(picture.height);
  }
  // Each start begins with the first picture, exposed now, as sequence 0.
  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame& /*frame*/) override { --borrowed_; }
  void do_stop() override {}
  [[nodiscard]] std::string_view do_identity() const override { return config_.identity; }
  [[nodiscard]] bool do_live() const override { return config_.live; }

  Clock& clock_;
  std::vector<LumaView> pictures_;
  Config config_;
  std::chrono::microseconds exposure_{};  // of the next frame
  std::uint64_t shown_ = 0;               // since start
  std::uint64_t drawn_ = 0;               // ever
  std::vector<std::uint8_t> room_;        // of the frame that is lent, where it has noise of its own
  int borrowed_ = 0;
};

}  // namespace holdfast::sim
