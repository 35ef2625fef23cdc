// SPDX-License-Identifier: Apache-2.0
// Helper threads. What depends on who comes first is forced: tasks wait for each other, and a signal handler holds a
// helper where it stands. Every wait is for a condition, with a deadline that only a fault reaches.
#include "drivers/common/crew.hpp"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <functional>
#include <utility>

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using drivers::Threads;

namespace {

// False after 20 s: qemu on a loaded machine may take a second. Tasks note what they find and the test judges it after
// the run: CppUTest's checks belong to one thread, and a failed one leaves by an exception.
template <typename Condition>
bool reached(const Condition& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds{20};
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    sched_yield();
  }
  return true;
}

class Doing final : public hal::Job {
 public:
  explicit Doing(std::function<void(std::size_t)> act) : act_(std::move(act)) {}

 private:
  void do_work(std::size_t worker) override { act_(worker); }
  std::function<void(std::size_t)> act_;
};

class Nothing final : public hal::Job {
 private:
  void do_work(std::size_t) override {}
};

// Pieces are plain integers on purpose: one done twice at a time, or not yet visible to the caller, is a data race
// that ThreadSanitizer reports even when the sums happen to be right.
class Pieces final : public hal::Job {
 public:
  static constexpr std::size_t kPieces = 61;

  void begin() { next_.store(0, std::memory_order_relaxed); }
  [[nodiscard]] bool each_done(unsigned times) const {
    return std::all_of(done_.begin(), done_.end(), [times](unsigned done) { return done == times; });
  }
  [[nodiscard]] unsigned visits(std::size_t worker) const { return visits_[worker]; }

 private:
  void do_work(std::size_t worker) override {
    ++visits_[worker];
    for (;;) {
      const std::size_t piece = next_.fetch_add(1, std::memory_order_relaxed);
      if (piece >= kPieces) return;
      ++done_[piece];
    }
  }

  std::atomic<std::size_t> next_{0};
  std::array<unsigned, kPieces> done_{};
  std::array<unsigned, hal::kMaxWorkers> visits_{};
};

// Holds a helper outside of any task: SIGUSR1's handler does not return before it is let go.
std::atomic<bool> held{false};
std::atomic<bool> let_go{false};
void hold(int) {
  held.store(true);
  while (!let_go.load()) sched_yield();
  held.store(false);
}

// A run in which the caller does not return before all helpers have entered.
bool all_enter(
    Threads& crew, const std::function<void(std::size_t)>& act = [](std::size_t) {}) {
  std::atomic<std::size_t> entered{0};
  bool all = false;
  Doing task([&](std::size_t worker) {
    act(worker);
    ++entered;
    if (worker == 0) all = reached([&] { return entered == crew.size(); });
  });
  crew.run(task);
  return all;
}

bool all_asleep(const Threads& crew) {
  return reached([&] { return crew.asleep() == crew.size() - 1; });
}

}  // namespace

TEST_GROUP(Crew){};

TEST(Crew, EveryPieceIsDoneExactlyOnceAndSeenByTheCaller) {
  for (std::size_t count = 1; count <= hal::kMaxWorkers; ++count) {
    Threads crew({.workers = count});
    LONGS_EQUAL(count, crew.size());
    Pieces task;
    for (unsigned run = 1; run <= 5000; ++run) {
      task.begin();
      crew.run(task);
      CHECK(task.each_done(run));
    }
    LONGS_EQUAL(5000, crew.counts().runs);
    LONGS_EQUAL(5000, task.visits(0));
    unsigned joined = 0;
    for (std::size_t worker = 1; worker < hal::kMaxWorkers; ++worker) {
      CHECK(task.visits(worker) <= 5000);
      if (worker >= count) LONGS_EQUAL(0, task.visits(worker));
      joined += task.visits(worker);
    }
    CHECK(joined >= crew.counts().runs - crew.counts().alone);
    if (count == 1) LONGS_EQUAL(5000, crew.counts().alone);
  }
}

TEST(Crew, HelpersWorkAtTheSameTimeUnderTheirOwnNumbers) {
  Threads crew({.workers = 4});
  std::array<std::atomic<unsigned>, hal::kMaxWorkers> visits{};
  std::atomic<std::size_t> entered{0}, met{0};
  Doing task([&](std::size_t worker) {
    ++visits[worker];
    ++entered;
    if (reached([&] { return entered == 4; })) ++met;  // helpers wait, too: all four are inside at once
  });
  crew.run(task);
  LONGS_EQUAL(4, met.load());
  for (const auto& count : visits) LONGS_EQUAL(1, count.load());
  LONGS_EQUAL(0, crew.counts().alone);
}

TEST(Crew, TheCallerWaitsForAHelperThatIsInside) {
  Threads crew({.workers = 2});
  for (int round = 0; round < 100; ++round) {
    std::atomic<bool> inside{false}, caller_is_done{false};
    bool helper_came = false, caller_was_done = false;  // not atomic: run() hands over what helpers wrote
    Doing task([&](std::size_t worker) {
      if (worker == 0) {
        helper_came = reached([&] { return inside.load(); });
        caller_is_done = true;
      } else {
        inside = true;
        const bool done = reached([&] { return caller_is_done.load(); });
        sched_yield();
        caller_was_done = done;
      }
    });
    crew.run(task);
    CHECK(helper_came);
    CHECK(caller_was_done);
  }
}

TEST(Crew, AHelperThatIsHeldUpOutsideKeepsNobodyWaiting) {
  Threads crew({.workers = 2});
  pthread_t helper{};
  CHECK(all_enter(crew, [&](std::size_t worker) {
    if (worker == 1) helper = pthread_self();
  }));

  struct sigaction action {};
  struct sigaction before {};
  action.sa_handler = hold;
  LONGS_EQUAL(0, sigaction(SIGUSR1, &action, &before));
  held = false;
  let_go = false;
  LONGS_EQUAL(0, pthread_kill(helper, SIGUSR1));
  Nothing nothing;
  // Runs go on meanwhile: ThreadSanitizer delivers a signal to a thread that is awake only.
  const bool caught = reached([&] {
    crew.run(nothing);
    return held.load();
  });
  CHECK(caught);
  const std::uint64_t alone = crew.counts().alone;
  Pieces task;
  for (unsigned run = 1; run <= 1000; ++run) {
    task.begin();
    crew.run(task);
    CHECK(task.each_done(run));
  }
  LONGS_EQUAL(1000, crew.counts().alone - alone);
  let_go = true;
  CHECK(reached([&] { return !held.load(); }));
  CHECK(all_asleep(crew));
  LONGS_EQUAL(0, task.visits(1));  // it came back when the last run was over, and left that task alone
  CHECK(all_enter(crew));
  LONGS_EQUAL(0, sigaction(SIGUSR1, &before, nullptr));
}

TEST(Crew, SleepersAreWokenEveryTime) {
  Threads crew({.workers = 4});
  for (int round = 0; round < 50; ++round) {
    CHECK(all_asleep(crew));
    CHECK(all_enter(crew));
  }
}

TEST(Crew, EndsWhetherItsHelpersSleepSpinOrHaveNotBegun) {
  Nothing nothing;
  for (int round = 0; round < 50; ++round) {
    { const Threads just_made({.workers = 4}); }
    {
      Threads spinning({.workers = 4});
      CHECK(all_enter(spinning));
    }
    {
      Threads on_the_way({.workers = 4});
      for (int run = 0; run <= round % 4; ++run) on_the_way.run(nothing);
    }
    const Threads sleeping({.workers = 4});
    CHECK(all_asleep(sleeping));
  }
}

TEST(Crew, AThreadThatCannotBeMadeMeansASmallerCrew) {
  pthread_attr_t usual, impossible;
  LONGS_EQUAL(0, pthread_getattr_default_np(&usual));
  LONGS_EQUAL(0, pthread_attr_init(&impossible));
  LONGS_EQUAL(0, pthread_attr_setstacksize(&impossible, std::size_t{1} << 47U));  // all of the address space
  LONGS_EQUAL(0, pthread_setattr_default_np(&impossible));
  Threads crew({.workers = 4});
  LONGS_EQUAL(0, pthread_setattr_default_np(&usual));
  pthread_attr_destroy(&impossible);
  pthread_attr_destroy(&usual);

  LONGS_EQUAL(1, crew.size());
  Pieces task;
  crew.run(task);
  CHECK(task.each_done(1));
  LONGS_EQUAL(1, crew.counts().alone);
}

TEST(Crew, CutsTheNumberOfWorkersToWhatThereIs) {
  LONGS_EQUAL(1, Threads({.workers = 0}).size());
  LONGS_EQUAL(hal::kMaxWorkers, Threads({.workers = 100}).size());
}
