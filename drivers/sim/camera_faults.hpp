// SPDX-License-Identifier: Apache-2.0
// Makes any camera misbehave by plan: a decorator with a schedule of faults, counted in frames of the camera inside.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/sim/clock.hpp"
#include "hal/camera.hpp"

namespace holdfast::sim {

enum class CameraFault : std::uint8_t {
  kNone,
  kOff,        // the sensor sends nothing: no frame, no sequence number; long enough off is a timeout
  kDropped,    // the frame is lost on the way: its sequence number is missing
  kBad,        // the driver throws the transfer away and says so
  kStuck,      // the bytes of the frame before the fault, with the stamp and number of this one
  kTorn,       // the first half of this frame's bytes, then the frame before's from the same place on
  kGarbage,    // random bytes of the same length
  kLate,       // arrives `by` late, with its true timestamp; what follows queues up behind it
  kBackwards,  // stamped `by` before the frame before it
  kGone,       // the stream ends here; the next `count` calls of start() are refused, then it is plugged in again
};

struct FaultSpan {
  std::uint64_t first = 0;  // index of the first frame it takes, from 0, counted over restarts
  std::uint64_t count = 1;  // frames (kGone: see there)
  CameraFault fault = CameraFault::kNone;
  std::chrono::microseconds by{};  // kLate, kBackwards
};

class FaultyCamera final : public hal::Camera {
 public:
  // `schedule`: ordered by `first`; of spans that overlap the earlier one counts.
  // `max_bytes`: the longest frame of the camera inside; room for the copies of kStuck, kTorn and kGarbage is taken
  // here, once (a longer frame allocates). Lends one frame at a time.
  FaultyCamera(hal::Camera& inside, Clock& clock, std::vector<FaultSpan> schedule, std::size_t max_bytes)
      : inside_(inside), clock_(clock), schedule_(std::move(schedule)), kept_(max_bytes), made_(max_bytes) {}

  // How many frames of the camera inside have been used up.
  [[nodiscard]] std::uint64_t index() const { return index_; }

 private:
  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame& frame) override;
  void do_stop() override;
  [[nodiscard]] std::string_view do_identity() const override { return inside_.identity(); }
  [[nodiscard]] bool do_live() const override { return inside_.live(); }

  [[nodiscard]] const FaultSpan& fault_at(std::uint64_t index) const;
  [[nodiscard]] hal::Capture hand_out(hal::Frame& frame, std::chrono::microseconds deadline);

  hal::Camera& inside_;
  Clock& clock_;
  std::vector<FaultSpan> schedule_;
  std::vector<std::uint8_t> kept_;  // bytes of the frame before, for kStuck and kTorn
  std::vector<std::uint8_t> made_;  // bytes of kGarbage and kTorn
  std::size_t kept_bytes_ = 0;
  hal::Frame true_frame_;  // as the camera inside gave it: what goes back with release()
  hal::Frame shown_;       // as it is handed out
  bool holding_ = false;   // a late frame waits for `due_`
  std::chrono::microseconds due_{};
  std::chrono::microseconds last_timestamp_{};
  std::uint64_t index_ = 0;
  std::uint32_t off_frames_ = 0;  // never sent since start(): the sequence closes over them
  std::uint64_t refusals_ = 0;
  std::uint32_t random_ = 0x9E3779B9;  // xorshift32 state, not 0
};

}  // namespace holdfast::sim
