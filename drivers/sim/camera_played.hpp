// SPDX-License-Identifier: Apache-2.0
// A recording, or a filmed scene, as a camera in real time, again and again: for a desk without a sensor.
//
// Frames come when they came in the recording, counted from start(); whoever is late finds it waiting. At its end it
// begins anew, so that what was held is gone from one frame to the next. Steps of more than a second, or backwards,
// count as one frame's. A scene is filmed beforehand, grey, in the size that the firmware works on; faults that it asks
// for are not played. It is no sensor (hal::Camera::live()). Host only.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/recording.hpp"
#include "hal/camera.hpp"
#include "hal/clock.hpp"

namespace holdfast::sim {

class PlayedCamera final : public hal::Camera {
 public:
  struct Config {
    double fps = 0;                                        // of inputs that carry no time; 0: 25
    std::function<bool(long done, long all)> filmed = {};  // of a scene; false stops
  };
  // `path`: a scene file (.json), or what Recording::open() takes. The clock outlives the camera.
  [[nodiscard]] static Result<std::unique_ptr<PlayedCamera>> open(const std::filesystem::path& path, hal::Clock& clock,
                                                                  const Config& config);
  // The same of a recording that somebody has opened.
  [[nodiscard]] static std::unique_ptr<PlayedCamera> of(Recording recording, hal::Clock& clock);

  // Pixels, and frames of one round as far as known (-1).
  [[nodiscard]] const RecordingInfo& info() const { return info_; }
  [[nodiscard]] int rounds() const { return rounds_; }

 private:
  PlayedCamera(hal::Clock& clock, std::optional<Recording> recording, std::vector<RecordedFrame> film,
               const RecordingInfo& info)
      : clock_(clock), recording_(std::move(recording)), film_(std::move(film)), info_(info) {}

  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] std::string_view do_problem() const override { return problem_; }
  [[nodiscard]] bool do_live() const override { return false; }
  [[nodiscard]] bool load();
  [[nodiscard]] bool read(bool& ended);

  hal::Clock& clock_;
  std::optional<Recording> recording_;
  std::vector<RecordedFrame> film_;
  RecordingInfo info_;
  std::string problem_;
  RecordedFrame frame_;
  bool pending_ = false;
  std::size_t next_of_film_ = 0;
  Micros last_time_{};  // of the recording, of the frame before
  bool any_ = false;    // in this round
  Micros due_{};        // of the pending frame
  bool began_ = false;
  std::uint32_t sequence_ = 0;
  int rounds_ = 0;
};

}  // namespace holdfast::sim
