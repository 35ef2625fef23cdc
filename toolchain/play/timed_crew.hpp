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

 private:
  class TimedTask final : public hal::Job {
   public:
    TimedTask(hal::Job& task, TimedCrew& crew) : task_(task), crew_(crew) {}

   private:
    void do_work(std::size_t worker) override {
      const double start = thread_us();
      task_.work(worker);
      crew_.spent_us_[worker] += thread_us() - start;
    }
    hal::Job& task_;
    TimedCrew& crew_;
  };

  [[nodiscard]] std::size_t do_size() const override { return crew_.size(); }
  void do_run(hal::Job& task) override {
    TimedTask timed(task, *this);
    const double start = thread_us();
    crew_.run(timed);
    caller_us_ += thread_us() - start;
  }

  hal::Crew& crew_;
  std::array<double, hal::kMaxWorkers> spent_us_{};
  double caller_us_ = 0;  // in run(), work and waiting
};

}  // namespace holdfast::tool
