// SPDX-License-Identifier: Apache-2.0
// A sensor in real time: pictures taken beforehand (film.hpp), each handed out at its moment.
//
// Modelled: the frame rate; the way from exposure to here; the driver's buffers. Those that are full keep what came
// first, as V4L2's do, and what the sensor sends meanwhile is lost: a process that was stopped first meets the frames
// of when it was stopped.
// Not modelled: exposure and transfer times that vary, what goes wrong with a camera (camera_faults.hpp).
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "drivers/sim/film.hpp"
#include "hal/camera.hpp"
#include "hal/clock.hpp"

namespace holdfast::sim {

class PacedCamera final : public hal::Camera {
 public:
  struct Config {
    std::chrono::microseconds period{40'000};
    std::chrono::microseconds latency{40'000};   // exposure and USB, DESIGN.md
    std::chrono::microseconds touch{1'200'000};  // an object is held from then on; max(): never
    int buffers = 3;
    std::string identity = "28D1-D7C6";
  };

  // Film and clock outlive it.
  PacedCamera(const Film& film, hal::Clock& clock, Config config);

 private:
  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] std::string_view do_identity() const override { return config_.identity; }

  void fill_buffers(std::chrono::microseconds now);

  const Film& film_;
  Film::Picture room_;  // of the frame that is lent
  hal::Clock& clock_;
  Config config_;
  std::chrono::microseconds began_{};  // exposure of frame 0
  bool ever_started_ = false;
  std::int64_t next_ = 0;           // to be handed out
  std::int64_t buffered_end_ = -1;  // behind the last one that the full buffers hold
  std::int64_t after_buffers_ = 0;  // the first one that found room again
};

}  // namespace holdfast::sim
