// SPDX-License-Identifier: Apache-2.0
// Helper threads that wait for work beside the caller: hal::Crew for every Linux board.
//
// The threads are made once and end with the object. A run publishes the job and wakes whoever sleeps; the caller
// works at once and never waits for a helper that has not entered. A helper without work watches for kSpin (the next
// run of the same frame comes sooner than a sleeper could wake), then sleeps on a futex. run() takes no lock and no
// memory, and calls the kernel only to wake sleepers or to yield to a helper that lost its core inside the job.
//
// One thread at a time calls run(), and a job does not call it. Give helpers the caller's priority: one that
// was preempted inside the job keeps the caller waiting. Helpers inherit the signal mask of the thread that makes
// them. Errors: none stops the firmware; a thread that the kernel did not grant makes size() less.
#pragma once

#include <pthread.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "hal/crew.hpp"

namespace holdfast::drivers {

class Threads final : public hal::Crew {
 public:
  static constexpr std::size_t kMaxHelpers = hal::kMaxWorkers - 1;
  // Price: so much of a core per run that nobody follows. Waking a sleeper takes the kernel about as long.
  static constexpr std::chrono::nanoseconds kSpin{50'000};

  struct Config {
    std::size_t workers = hal::kMaxWorkers;  // the caller included; cut to 1..kMaxWorkers
  };
  // Since start; for the thread that calls run().
  struct Counts {
    std::uint64_t runs = 0;
    std::uint64_t alone = 0;  // runs that no helper entered
  };

  explicit Threads(const Config& config);
  ~Threads() override;
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

  [[nodiscard]] const Counts& counts() const { return counts_; }
  // Helpers that sleep, or are about to, and have to be woken by the next run.
  [[nodiscard]] std::size_t asleep() const;

 private:
  struct Helper {
    Threads* crew = nullptr;
    std::size_t worker = 0;
    pthread_t thread{};
  };

  [[nodiscard]] std::size_t do_size() const override { return 1 + helpers_made_; }
  void do_run(hal::Job& job) override;
  void serve(std::size_t worker);
  [[nodiscard]] std::uint32_t await(std::uint32_t served);

  // In one cache line, as a helper needs both at once. job_ is written only while nobody is inside.
  alignas(64) std::atomic<std::uint32_t> word_{0};
  hal::Job* job_ = nullptr;

  alignas(64) std::array<Helper, kMaxHelpers> helpers_{};
  std::size_t helpers_made_ = 0;
  Counts counts_;
};

}  // namespace holdfast::drivers
