// SPDX-License-Identifier: Apache-2.0
// How long each task takes, in buckets: what the console's `tasks` shows. Fixed memory, one look at the clock per task.
//
// Buckets: exact below 16 us, then eight to the octave, so that a percentile is told within an eighth (rounded up).
// Without a clock, and in virtual time, nothing is counted or everything takes no time.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/math.hpp"
#include "base/units.hpp"
#include "hal/clock.hpp"

namespace holdfast {

enum class Task : std::uint8_t { kDecode, kTrack, kFeatures, kClassify, kSignal, kFrame, kAge, kServe, kConsole };

struct TaskInfo {
  Task task;
  std::string_view name;
  Micros budget;  // what takes longer is late
  std::string_view what;
};

inline constexpr std::array<TaskInfo, 9> kTasks{{
    {Task::kDecode, "decode", Micros{20'000}, "camera's JPEG to luma"},
    {Task::kTrack, "track", Micros{5'000}, "luma to markers"},
    {Task::kFeatures, "features", Micros{5'000}, "markers and imprint to features"},
    {Task::kClassify, "judge", Micros{1'000}, "features to request"},
    {Task::kSignal, "signal", Micros{2'000}, "request to lines and link"},
    {Task::kFrame, "frame", Micros{33'000}, "arrival to edge, all of the above"},
    {Task::kAge, "age", Micros{95'000}, "start of exposure to edge"},
    {Task::kServe, "serve", Micros{5'000}, "commands, wires and gripper, each time around"},
    {Task::kConsole, "console", Micros{5'000}, "this console, each time around"},
}};

namespace timing {

class Histogram {
 public:
  void add(Micros took) {
    const std::int64_t us = std::clamp<std::int64_t>(took.count(), 0, kMostUs);
    count_up(buckets_[bucket_of(static_cast<std::uint32_t>(us))]);
    count_up(count_);
    most_ = std::max(most_, Micros{us});
  }
  void clear() { *this = {}; }

  [[nodiscard]] std::uint32_t count() const { return count_; }
  [[nodiscard]] Micros most() const { return most_; }
  // The time that `permille` of all laps do not exceed, rounded up to the end of its bucket. Range: 0..1000.
  [[nodiscard]] Micros quantile(std::uint32_t permille) const {
    const std::uint64_t rank = (std::uint64_t{count_} * permille + 999) / 1000;
    std::uint64_t seen = 0;
    for (std::size_t k = 0; k < kBuckets; ++k) {
      seen += buckets_[k];
      if (seen >= rank && seen > 0) return std::min(Micros{end_of(k)}, most_);
    }
    return most_;
  }

 private:
  static constexpr std::int64_t kMostUs = (std::int64_t{1} << 24) - 1;  // 16.8 s
  static constexpr std::size_t kBuckets = 16 + 8 * 20;

  // Range: us < 2^24.
  [[nodiscard]] static constexpr std::size_t bucket_of(std::uint32_t us) {
    if (us < 16) return us;
    const auto octave = static_cast<std::uint32_t>(31 - std::countl_zero(us));  // 4..23
    return 16 + 8 * (octave - 4) + ((us >> (octave - 3)) & 7);
  }
  // The longest time that falls into it.
  [[nodiscard]] static constexpr std::int64_t end_of(std::size_t bucket) {
    if (bucket < 16) return static_cast<std::int64_t>(bucket);
    const std::size_t octave = (bucket - 16) / 8 + 4;
    const std::int64_t step = std::int64_t{1} << (octave - 3);
    return (std::int64_t{8} + static_cast<std::int64_t>((bucket - 16) % 8)) * step + step - 1;
  }

  std::array<std::uint32_t, kBuckets> buckets_{};
  std::uint32_t count_ = 0;
  Micros most_{};
};

// One frame's way through the stages: begin(), then a lap at the end of each. A frame that is refused halfway has no
// laps of the stages that it did not reach.
class Stopwatch {
 public:
  void use(const hal::Clock& clock) { clock_ = &clock; }
  void begin() {
    if (clock_ != nullptr) last_ = clock_->now();
  }
  void lap(Task task) {
    if (clock_ == nullptr) return;
    const Micros now = clock_->now();
    add(task, now - last_);
    last_ = now;
  }
  void add(Task task, Micros took) {
    const auto k = static_cast<std::size_t>(task);
    histograms_[k].add(took);
    if (took > kTasks[k].budget) count_up(late_[k]);
  }
  void clear() {
    histograms_ = {};
    late_ = {};
  }
  [[nodiscard]] const Histogram& of(Task task) const { return histograms_[static_cast<std::size_t>(task)]; }
  [[nodiscard]] std::uint32_t late(Task task) const { return late_[static_cast<std::size_t>(task)]; }

 private:
  const hal::Clock* clock_ = nullptr;
  Micros last_{};
  std::array<Histogram, kTasks.size()> histograms_{};
  std::array<std::uint32_t, kTasks.size()> late_{};
};

}  // namespace timing
}  // namespace holdfast
