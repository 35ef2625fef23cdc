// SPDX-License-Identifier: Apache-2.0
// The flight recorder: the last ten seconds of frames with their markers, of a hand of two five, and the last events,
// in RAM. When the state becomes FAULT the frames are set aside, so that they can still be read after it has passed.
//
// Price: 270 kB of memory, 0.6 kB written per frame, and a copy of 135 kB per FAULT.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "app/pipeline.hpp"
#include "app/supervisor.hpp"
#include "base/status.hpp"
#include "base/units.hpp"
#include "link/marker_frame.hpp"

namespace holdfast {

// What a frame came to. Range: as in Features; void where `features` is false.
struct FlightFrame {
  Micros at{};  // when it was signalled, on the HAL's clock
  std::uint32_t sequence = 0;
  std::int32_t age_us = 0;  // from the start of its exposure; at most 2^31 - 1
  Reason quality = Reason::kNone;
  DeviceState state = DeviceState::kBoot;
  Reason reason = Reason::kNone;
  bool accepted = false, slip = false, grip_ok = false, features = false;
  std::uint8_t finger = 0;  // whose it is
  std::uint8_t markers = 0;
  GridSize grid;
  std::int32_t vx_um_s = 0, vy_um_s = 0;
  std::int32_t entropy_nat_q16 = 0, entropy_rate_nat_s_q8 = 0;
  std::array<marker_frame::Point, kMaxMarkers> displacement{};  // um; 0 where a marker is not valid
};

enum class EventKind : std::uint8_t {
  kState,
  kCameraStarted,
  kCameraGone,
  kCommand,
  kSetting,
  kUnlocked,
  kWrongCode,
  kFault,
  kSettings,
  kModel,
  kSupply
};

struct EventInfo {
  EventKind kind;
  std::string_view name;
  std::string_view a, b;  // what its two numbers are; empty: nothing
};

inline constexpr std::array<EventInfo, 11> kEvents{{
    {EventKind::kState, "state", "state", "reason"},
    {EventKind::kCameraStarted, "camera_started", "starts", "finger"},
    {EventKind::kCameraGone, "camera_gone", "reason", "finger"},
    {EventKind::kCommand, "command", "command", "result"},
    {EventKind::kSetting, "setting", "parameter", "value"},
    {EventKind::kUnlocked, "unlocked", "", ""},
    {EventKind::kWrongCode, "wrong_code", "tries", ""},
    {EventKind::kFault, "fault_injected", "fault", ""},
    {EventKind::kSettings, "settings", "found", "accepted"},  // settings::Found; 1: gone on with
    {EventKind::kModel, "model", "", "accepted"},             // a slot is damaged
    {EventKind::kSupply, "supply", "state", ""},              // hal::Supply::State
}};

struct FlightEvent {
  Micros at{};
  EventKind kind = EventKind::kState;
  std::int32_t a = 0, b = 0;
};

// The newest N, oldest first.
template <typename T, std::size_t N>
class Ring {
 public:
  [[nodiscard]] T& next() {
    T& slot = slots_[at_];
    at_ = (at_ + 1) % N;
    if (size_ < N) ++size_;
    return slot;
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] const T& operator[](std::size_t k) const { return slots_[(at_ + N - size_ + k) % N]; }
  void clear() { size_ = 0; }

 private:
  std::array<T, N> slots_{};
  std::size_t at_ = 0, size_ = 0;
};

class Recorder {
 public:
  static constexpr std::size_t kFrames = 256;  // of all fingers: 10 s at 25 fps of one
  static constexpr std::size_t kEventCount = 128;
  using Frames = Ring<FlightFrame, kFrames>;
  using Events = Ring<FlightEvent, kEventCount>;

  // After each frame of a finger, or each time that one did not come.
  void take(const pipeline::Result& result, const DisplacementField& field, const supervisor::Outputs& outputs,
            Micros now, int finger = 0);
  void note(EventKind kind, Micros now, std::int32_t a = 0, std::int32_t b = 0) { events_.next() = {now, kind, a, b}; }

  [[nodiscard]] const Frames& frames() const { return frames_; }
  // Those before the last FAULT; empty: there was none.
  [[nodiscard]] const Frames& before_fault() const { return before_fault_; }
  [[nodiscard]] const Events& events() const { return events_; }

 private:
  Frames frames_, before_fault_;
  Events events_;
  DeviceState state_ = DeviceState::kBoot;
  Reason reason_ = Reason::kNone;
};

}  // namespace holdfast
