// SPDX-License-Identifier: Apache-2.0
// Another crew, and the CPU time that each worker spends inside the task.
//
// Wall time says more of who else is on the machine than of the work, so what counts is the critical path: the
// caller's CPU time outside of the parallel part, plus the longest worker's inside.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <numeric>

#include "hal/crew.hpp"
#include "toolchain/play/thread_time.hpp"

namespace holdfast::tool {

class TimedCrew final : public hal::Crew {
 public:
  explicit TimedCrew(hal::Crew& crew) : crew_(crew) {}

  void reset() {
    spent_us_ = {};
    caller_us_ = 0;
    together_ = true;
  }
  // Since reset(), of a caller that spent `caller_us` in all.
  [[nodiscard]] double path_us(double caller_us) const {
    return caller_us - caller_us_ + *std::max_element(spent_us_.begin(), spent_us_.end());
  }
  [[nodiscard]] double all_us(double caller_us) const {
    return caller_us - caller_us_ + std::accumulate(spent_us_.begin(), spent_us_.end(), 0.0);
  }
  // The helpers came too late to work.
  [[nodiscard]] bool alone() const {
    return std::all_of(spent_us_.begin() + 1, spent_us_.end(), [](double us) { return us == 0; });
  }
  // In every run since reset() all workers began within 100 us, which is about what waking a thread takes, and none
  // lost its core for longer than an interrupt takes.
  [[nodiscard]] bool together() const { return together_; }

 private:
  static constexpr double kWakeUs = 100;

  class TimedTask final : public hal::Job {
   public:
    TimedTask(hal::Job& task, TimedCrew& crew) : task_(task), crew_(crew) {}

   private:
    void do_work(std::size_t worker) override {
      const double began = wall_us();
      const double start = thread_us();
      task_.work(worker);
      const double spent = thread_us() - start;
      crew_.spent_us_[worker] += spent;
      crew_.began_us_[worker] = began;
      crew_.lost_us_[worker] = wall_us() - began - spent;
    }
    hal::Job& task_;
    TimedCrew& crew_;
  };

  [[nodiscard]] std::size_t do_size() const override { return crew_.size(); }
  void do_run(hal::Job& task) override {
    TimedTask timed(task, *this);
    began_us_ = {};
    lost_us_ = {};
    const double wall = wall_us();
    const double start = thread_us();
    crew_.run(timed);
    caller_us_ += thread_us() - start;
    const double end = wall_us();
    for (std::size_t i = 0; i < crew_.size(); ++i) {
      const double began =
          began_us_[i] > 0 ? began_us_[i] : end;  // one that was not needed in so short a run is not late
      if (began - wall > kWakeUs || lost_us_[i] > 5 + 0.02 * spent_us_[i]) together_ = false;
    }
  }

  hal::Crew& crew_;
  std::array<double, hal::kMaxWorkers> spent_us_{};
  double caller_us_ = 0;  // in run(), work and waiting
  // Of the last run, of each worker: when it began, and wall time inside beyond its CPU time.
  std::array<double, hal::kMaxWorkers> began_us_{};
  std::array<double, hal::kMaxWorkers> lost_us_{};
  bool together_ = true;
};

}  // namespace holdfast::tool
