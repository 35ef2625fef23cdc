// SPDX-License-Identifier: Apache-2.0
// Several workers on one job: the caller and, on boards with cores to spare, helpers that wait for it.
#pragma once

#include <cstddef>

namespace holdfast::hal {

inline constexpr std::size_t kMaxWorkers = 4;

// A job that hands its work out piece by piece. It is done when the caller alone has worked on it, too: a helper
// that wakes late finds nothing left.
class Job {
 public:
  virtual ~Job() = default;
  // At most once per worker and run; worker 0 is the caller, the others come at the same time from other threads.
  void work(std::size_t worker) { do_work(worker); }

 private:
  virtual void do_work(std::size_t worker) = 0;
};

class Crew {
 public:
  virtual ~Crew() = default;
  // Workers, the caller included: 1 to kMaxWorkers.
  [[nodiscard]] std::size_t size() const { return do_size(); }
  // Works on the job and lets helpers that are awake in time work on it as well; returns when all who began have
  // returned. It never waits for a helper that has not begun: on a busy core that would cost a time slice
  // (measured: 0.4 ms became 4 to 8 ms).
  void run(Job& job) { do_run(job); }

 private:
  [[nodiscard]] virtual std::size_t do_size() const = 0;
  virtual void do_run(Job& job) = 0;
};

// The caller alone.
class Alone final : public Crew {
 private:
  [[nodiscard]] std::size_t do_size() const override { return 1; }
  void do_run(Job& job) override { job.work(0); }
};

}  // namespace holdfast::hal
