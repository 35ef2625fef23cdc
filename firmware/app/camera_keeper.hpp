// SPDX-License-Identifier: Apache-2.0
// The camera's life: started, lost, started again with back-off, and never another sensor than the one that was stored
// for it, or the first.
//
// A camera that is gone is tried again after 0.1 s, then after twice that, up to 0.5 s. A stream without an accepted
// frame is started anew after 0.5 s, then after twice that, up to 4 s: some drivers resume on their own, and a restart
// takes them longer.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "base/crc32.hpp"
#include "base/math.hpp"
#include "base/status.hpp"
#include "base/units.hpp"
#include "hal/camera.hpp"
#include "hal/clock.hpp"
#include "params/params.hpp"
#include "store/checkpoint.hpp"

namespace holdfast::camera_keeper {

struct Config {
  // A sensor that was plugged in again is back within 2 s: its driver takes most of that.
  Micros first_retry{100'000};
  Micros longest_retry{500'000};
  Micros first_stall{500'000};
  Micros longest_stall{4'000'000};
  std::int32_t sensor = 0;  // number_of() the one that was stored for this finger; 0: the first that comes
};

// A serial number as a parameter, which is an integer: the low 30 bits of its CRC-32. 0: the driver cannot tell.
[[nodiscard]] inline std::int32_t number_of(std::string_view serial) {
  const auto* const bytes = reinterpret_cast<const std::uint8_t*>(serial.data());
  return static_cast<std::int32_t>(crc32({bytes, serial.size()}) & kMostSensor);
}

struct State {
  bool streaming = false;
  Reason why = Reason::kNone;     // of the last start that failed, or of the loss
  checkpoint::Identity sensor{};  // the first that came since start(); empty: none has
  std::uint32_t starts = 0;       // that succeeded after a loss, and the first one
  Micros try_at{};                // while it is gone
  Micros retry_after{};
  Micros stalled_since{};  // while it streams
  Micros stall_limit{};
};

enum class Kept : std::uint8_t {
  kAsItWas,    // it is not time for anything
  kCame,       // one that was gone streams
  kRestarted,  // a stream that had stalled begins anew
  kFailed,     // it was tried: State::why
};

// It is gone, or could not be started.
inline void lost(State& state, Reason why, Micros retry_after, Micros now) {
  state.streaming = false;
  state.why = why;
  state.retry_after = retry_after;
  state.try_at = now + retry_after;
}

inline void stopped(State& state) {
  state.streaming = false;
  state.why = Reason::kCameraGone;
}

// Starts the stream, or starts it anew. kNone; kCameraGone; kCameraWrong: another sensor, whose gel is another one.
[[nodiscard]] inline Reason open(State& state, const Config& config, hal::Camera& camera) {
  camera.stop();
  if (!camera.start()) return Reason::kCameraGone;
  const checkpoint::Identity sensor = checkpoint::identity_of(camera.identity());
  const bool expected = config.sensor == 0 || number_of(camera.identity()) == config.sensor;
  if (expected && state.sensor == checkpoint::Identity{}) state.sensor = sensor;
  if (expected && sensor == state.sensor) return Reason::kNone;
  camera.stop();
  return Reason::kCameraWrong;
}

// The first start. What the back-off begins with is set whether it succeeds or not.
[[nodiscard]] inline Reason start(State& state, const Config& config, hal::Camera& camera, Micros now) {
  state = {};
  state.stall_limit = config.first_stall;
  state.stalled_since = now;
  const Reason why = open(state, config, camera);
  if (why != Reason::kNone) {
    lost(state, why, config.first_retry, now);
    return why;
  }
  state.retry_after = config.first_retry;
  state.streaming = true;
  count_up(state.starts);
  return why;
}

inline void accepted(State& state, const Config& config, Micros now) {
  state.stalled_since = now;
  state.stall_limit = config.first_stall;
  state.retry_after = config.first_retry;
}

// Starts it (anew) when that is due. A stall, and the wait after a failure, count from this call on.
[[nodiscard]] inline Kept keep(State& state, const Config& config, hal::Camera& camera, const hal::Clock& clock) {
  const Micros now = clock.now();
  const bool was_gone = !state.streaming;
  if (was_gone ? now < state.try_at : now - state.stalled_since <= state.stall_limit) return Kept::kAsItWas;
  if (!was_gone) {
    state.stall_limit = std::min(state.stall_limit * 2, config.longest_stall);
    state.stalled_since = now;
  }
  const Reason why = open(state, config, camera);
  if (why != Reason::kNone) {
    lost(state, why, was_gone ? std::min(state.retry_after * 2, config.longest_retry) : config.first_retry,
         clock.now());
    return Kept::kFailed;
  }
  state.why = Reason::kNone;
  state.streaming = true;
  if (!was_gone) return Kept::kRestarted;
  count_up(state.starts);
  state.stalled_since = clock.now();
  return Kept::kCame;
}

}  // namespace holdfast::camera_keeper
