// SPDX-License-Identifier: Apache-2.0
// Watches the stream rather than the picture: at which rate it comes, and whether it is decided in time. Of sources
// that are no sensor (hal::Camera::live()) only a low rate is reported.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "base/math.hpp"
#include "base/status.hpp"
#include "base/units.hpp"

namespace holdfast::health {

struct Config {
  // Outside this window: DEGRADED. The sensor's 15 to 27 fps and a fifth beyond.
  Micros shortest_period{31'000};  // 32 fps
  Micros longest_period{83'000};   // 12 fps
  // A frame that is older when it is decided is late: exposure 18 ms, USB 40 ms, and half a period of 15 fps.
  Micros deadline{95'000};
  int most_late = 2;  // of the last kDeadlineFrames: 1 %
};

inline constexpr int kRateFrames = 16;       // the rate is a mean over so many
inline constexpr int kDeadlineFrames = 256;  // 10 s at 25 fps

struct State {
  struct Stamp {
    Micros at{};
    std::uint32_t sequence = 0;
    std::uint64_t came = 0;
  };
  std::uint64_t came = 0;                   // frames of the camera, accepted or not
  std::array<Stamp, kRateFrames> stamps{};  // a ring
  int stamp_count = 0;
  int newest = 0;
  std::array<std::uint64_t, kDeadlineFrames / 64> late{};  // a ring of bits
  int late_at = 0;
  std::uint32_t late_frames = 0;  // since start
};

// The stream begins anew: what came before says nothing about what follows.
inline void restart(State& state) {
  state.stamp_count = 0;
  state.late = {};
}

// A frame came, whatever becomes of it.
inline void came(State& state) {
  ++state.came;
}

// An accepted frame, after came(): `age` when it was decided. Too fast is judged by the sequence numbers, too slow by
// the frames that came: lost ones must not pass for a fast sensor, and what is lost cannot be decided on. One lost
// frame in a row of kRateFrames at 15 fps is none too few. Range: stamps advance (pipeline.cpp); ages any.
[[nodiscard]] inline Reason strain(State& state, const Config& config, Micros timestamp, std::uint32_t sequence,
                                   Micros age) {
  state.newest = (state.newest + 1) % kRateFrames;
  state.stamps[static_cast<std::size_t>(state.newest)] = {timestamp, sequence, state.came};
  if (state.stamp_count < kRateFrames) ++state.stamp_count;

  const bool late = age > config.deadline;
  state.late_at = (state.late_at + 1) % kDeadlineFrames;
  std::uint64_t& word = state.late[static_cast<std::size_t>(state.late_at) / 64];
  const std::uint64_t bit = std::uint64_t{1} << (state.late_at % 64);
  word = late ? word | bit : word & ~bit;
  if (late) count_up(state.late_frames);

  if (state.stamp_count == kRateFrames) {
    const State::Stamp& oldest = state.stamps[static_cast<std::size_t>((state.newest + 1) % kRateFrames)];
    const std::int64_t periods{static_cast<std::uint32_t>(sequence - oldest.sequence)};
    const auto frames = static_cast<std::int64_t>(state.came - oldest.came);
    const Micros time = timestamp - oldest.at;
    if (time < config.shortest_period * periods || time > config.longest_period * frames) return Reason::kFrameRate;
  }
  int late_ones = 0;
  for (const std::uint64_t bits : state.late) late_ones += std::popcount(bits);
  return late_ones > config.most_late ? Reason::kDeadline : Reason::kNone;
}

}  // namespace holdfast::health
