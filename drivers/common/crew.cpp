// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/crew.hpp"

#include <linux/futex.h>
#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <climits>
#include <ctime>

namespace holdfast::drivers {
namespace {

// All that the threads agree on is in one word, so that each step below is one atomic operation:
//
//     bits 0-1   helpers inside the job
//     bits 2-3   helpers asleep (counted before they sleep; the run that wakes them sets it to 0)
//     bit  4     the generation is open: helpers may enter
//     bit  5     a helper entered this generation
//     bit  6     the threads shall end
//     bits 8-31  generation, one per run
//
// Why the orders suffice, on aarch64 as well. After publish, every change of the word up to the next publish is a
// read-modify-write, so it continues the release sequence of each earlier release, whoever makes it.
//   publish  exchange, release; enter  compare-and-swap, acquire: a helper that is inside sees job_ and all that the
//            caller wrote before run().
//   leave    fetch_sub, release; close and the wait after it, acquire: the caller that finds nobody inside sees all
//            that each helper wrote, and that each has read job_ for the last time.
//   A helper that is late finds the generation closed or its compare-and-swap undone by the close: it never reads
//   job_ of a run that is over. One that slept through all 2^24 generations and takes the new for the old misses a
//   run, as if it had come late.
//   sleep    compare-and-swap, relaxed: it hands over no data. Either it comes before the exchange of publish, which
//            then reads the count and wakes, or it fails. A helper counted but not yet asleep is turned back by the
//            kernel, which compares the word again under its own lock before it puts the thread to sleep.
constexpr std::uint32_t kOneInside = 1U << 0U;
constexpr std::uint32_t kOneAsleep = 1U << 2U;
constexpr std::uint32_t kOpen = 1U << 4U;
constexpr std::uint32_t kJoined = 1U << 5U;
constexpr std::uint32_t kEnd = 1U << 6U;
constexpr std::uint32_t kOneGeneration = 1U << 8U;
static_assert(Threads::kMaxHelpers <= 3, "two bits count them");
static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

constexpr std::uint32_t inside(std::uint32_t word) {
  return word & 3U;
}
constexpr std::uint32_t asleep_in(std::uint32_t word) {
  return word >> 2U & 3U;
}
constexpr std::uint32_t generation(std::uint32_t word) {
  return word / kOneGeneration;
}

// The futex of the Linux kernel is the word itself.
long futex(std::atomic<std::uint32_t>& word, int operation, std::uint32_t value) {
  static_assert(sizeof(word) == sizeof(std::uint32_t));
  return syscall(SYS_futex, &word, operation | FUTEX_PRIVATE_FLAG, value, nullptr, nullptr, 0);
}

// Tells the core that this is a wait: saves power, and leaves more to a sibling thread.
void pause_briefly() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield" : : : "memory");
#endif
}

std::chrono::nanoseconds monotonic_now() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::chrono::seconds{now.tv_sec} + std::chrono::nanoseconds{now.tv_nsec};
}

constexpr unsigned kPausesPerLook = 32;  // 1 us on x86, 0.1 us on a Cortex-A72; reading the clock takes 0.03 to 0.1 us

}  // namespace

Threads::Threads(const Config& config) {
  const std::size_t wanted = std::clamp<std::size_t>(config.workers, 1, hal::kMaxWorkers) - 1;
  for (std::size_t i = 0; i < wanted; ++i) {
    Helper& helper = helpers_[i];
    helper.crew = this;
    helper.worker = i + 1;
    const auto entry = [](void* argument) -> void* {
      const auto* self = static_cast<const Helper*>(argument);
      self->crew->serve(self->worker);
      return nullptr;
    };
    if (pthread_create(&helper.thread, nullptr, entry, &helper) != 0) break;
    ++helpers_made_;
    pthread_setname_np(helper.thread, "holdfast-helper");
  }
}

Threads::~Threads() {
  word_.fetch_or(kEnd, std::memory_order_relaxed);
  futex(word_, FUTEX_WAKE, INT_MAX);
  for (std::size_t i = 0; i < helpers_made_; ++i) pthread_join(helpers_[i].thread, nullptr);
}

std::size_t Threads::asleep() const {
  return asleep_in(word_.load(std::memory_order_relaxed));
}

void Threads::do_run(hal::Job& job) {
  ++counts_.runs;
  if (helpers_made_ == 0) {
    ++counts_.alone;
    job.work(0);
    return;
  }
  job_ = &job;
  const std::uint32_t next = (generation(word_.load(std::memory_order_relaxed)) + 1) * kOneGeneration;
  const std::uint32_t before = word_.exchange(next | kOpen, std::memory_order_release);
  if (asleep_in(before) != 0) futex(word_, FUTEX_WAKE, INT_MAX);
  job.work(0);
  std::uint32_t word = word_.fetch_and(~kOpen, std::memory_order_acquire);
  if ((word & kJoined) == 0) ++counts_.alone;
  for (unsigned n = 1; inside(word) != 0; ++n) {
    pause_briefly();
    if (n % kPausesPerLook == 0) sched_yield();  // the helper may have lost the core that we are on
    word = word_.load(std::memory_order_acquire);
  }
}

void Threads::serve(std::size_t worker) {
  std::uint32_t served = generation(0);
  for (;;) {
    std::uint32_t word = await(served);
    if ((word & kEnd) != 0) return;
    if (word_.compare_exchange_strong(word, (word | kJoined) + kOneInside, std::memory_order_acquire,
                                      std::memory_order_relaxed)) {
      served = generation(word);
      job_->work(worker);
      word_.fetch_sub(kOneInside, std::memory_order_release);
    }
  }
}

// Returns the word when it says that there is something to do: an open generation other than `served`, or the end.
std::uint32_t Threads::await(std::uint32_t served) {
  const auto is_news = [served](std::uint32_t word) {
    return (word & kEnd) != 0 || ((word & kOpen) != 0 && generation(word) != served);
  };
  for (;;) {
    std::uint32_t word = word_.load(std::memory_order_relaxed);
    const std::chrono::nanoseconds begin = monotonic_now();
    for (unsigned n = 1; !is_news(word); ++n) {
      pause_briefly();
      if (n % kPausesPerLook == 0 && monotonic_now() - begin > kSpin) break;
      word = word_.load(std::memory_order_relaxed);
    }
    do {
      if (is_news(word)) return word;
    } while (!word_.compare_exchange_weak(word, word + kOneAsleep, std::memory_order_relaxed));
    // Counted. Within this generation nothing new can come: it is closed, or served. The others' steps change the
    // word as well, so it is the generation that tells whether to sleep again.
    const std::uint32_t counted = generation(word);
    word += kOneAsleep;
    while (generation(word) == counted && (word & kEnd) == 0) {
      futex(word_, FUTEX_WAIT, word);
      word = word_.load(std::memory_order_relaxed);
    }
  }
}

}  // namespace holdfast::drivers
