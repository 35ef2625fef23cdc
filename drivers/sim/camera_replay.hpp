// SPDX-License-Identifier: Apache-2.0
// Plays a recording as a camera in virtual time.
//
// Each frame moves the simulated clock to its own time stamp: recording time + the clock's time at start(). A
// later one moves it by the time-out only. One whose stamp is not newer than the one before it, or an hour after the
// clock, comes as it is, a frame's time after the one before it: of another clock's stamps a device has no use, and
// its own clock goes on.
// kGone at the end; error() then tells an ordinary end (empty) from a recording that breaks off.
// Host only: reading allocates.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "drivers/sim/clock.hpp"
#include "drivers/sim/recording.hpp"
#include "hal/camera.hpp"

namespace holdfast::sim {

class CameraReplay final : public hal::Camera {
 public:
  CameraReplay(Recording recording, Clock& clock);

  [[nodiscard]] const Recording& recording() const { return recording_; }
  [[nodiscard]] const std::string& error() const { return recording_.error(); }
  // The frame last given out by next(): what it was beside its pixels.
  [[nodiscard]] const RecordedFrame& current() const { return frame_; }

 private:
  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] bool do_live() const override { return false; }

  Recording recording_;
  Clock& clock_;
  RecordedFrame frame_;
  std::chrono::microseconds start_{};
  std::optional<std::chrono::microseconds> newest_;  // stamp that went forward
  std::chrono::microseconds given_at_{};             // when the frame before was
  std::chrono::microseconds period_{};  // between the last two frames that went forward; the nominal one at most
  bool pending_ = false;                // frame_ is read but its time has not come
  bool played_ = false;                 // a second start() plays from the beginning
};

}  // namespace holdfast::sim
