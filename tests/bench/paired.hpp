// SPDX-License-Identifier: Apache-2.0
// How many times as fast ours is as a rival, whoever else uses the machine.
//
// Both work by turns in blocks of a few milliseconds. A block of one is paired with the block of the other right beside
// it, in changing order, and each pair gives a ratio of times per run. The figure is the median of the ratios; its 95 %
// interval is made of two of them (order statistics), so it assumes nothing of their distribution.
//
// Times are CPU time: of the thread, or of the critical path where a crew helps (toolchain/play/timed_crew.hpp). A pair
// does not count
//   when a thread lost its core in it: involuntary context switches, or wall time far from CPU time;
//   when a helper came late, which says more of the scheduler than of the work;
//   when the core was slower than it can be, because somebody else used the other half of it: cycles per instruction
//   out of band where the processor's counters can be read, and everywhere a loop of dense work beside each block
//   that takes longer than it does in the fastest tenth of the program's run.
// Those are counted and told. None of this looks at the ratio. What it cannot see is a neighbour's use of shared caches
// and memory: runs beside compilers differed by up to 3 %, of two threads by 5 %, which is more than the interval.
#pragma once

#include <fmt/format.h>
#include <linux/perf_event.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "toolchain/play/thread_time.hpp"
#include "toolchain/play/timed_crew.hpp"

namespace holdfast::bench {

// Cycles and instructions of this thread, in user mode; 0 where the machine has no counters, as in most virtual ones.
class Counters {
 public:
  struct Reading {
    std::uint64_t cycles = 0, instructions = 0;
  };
  [[nodiscard]] static const Counters& of_machine() {
    static const Counters counters;
    return counters;
  }
  [[nodiscard]] bool here() const { return cycles_ >= 0 && instructions_ >= 0; }
  [[nodiscard]] Reading read() const { return {value(cycles_), value(instructions_)}; }

 private:
  Counters() : cycles_(open(PERF_COUNT_HW_CPU_CYCLES)), instructions_(open(PERF_COUNT_HW_INSTRUCTIONS)) {}
  static int open(std::uint64_t event) {
    perf_event_attr wanted{};
    wanted.size = sizeof wanted;
    wanted.type = PERF_TYPE_HARDWARE;
    wanted.config = event;
    wanted.exclude_kernel = wanted.exclude_hv = 1;
    return static_cast<int>(syscall(SYS_perf_event_open, &wanted, 0, -1, -1, 0));
  }
  static std::uint64_t value(int counter) {
    std::uint64_t count = 0;
    return counter >= 0 && ::read(counter, &count, sizeof count) == sizeof count ? count : 0;
  }
  int cycles_, instructions_;
};

// Takes a real-time priority for this thread and those that it makes from now on, where the system grants it (root):
// a busy machine gives an ordinary thread a core for 4 ms at a time, and one picture takes the rival 16 ms. Says what
// the measure can rely on.
[[nodiscard]] inline std::string prepare() {
  const sched_param lowest{1};
  const bool granted = sched_setscheduler(0, SCHED_FIFO, &lowest) == 0;
  std::array<double, 1> load{};
  (void)getloadavg(load.data(), 1);
  return fmt::format("load {:.1f}; {} real-time priority; {} counters of cycles", load[0], granted ? "with" : "without",
                     Counters::of_machine().here() ? "with" : "without");
}

// Eight independent chains of additions, 10 us or so: as many instructions at once as a core can take, so that whoever
// takes a part of the core shows.
[[nodiscard]] inline double dense_work_us() {
  std::array<std::uint64_t, 8> sum{1, 2, 3, 4, 5, 6, 7, 8};
  const double start = tool::thread_us();
  for (std::uint64_t i = 0; i < 10'000; ++i) {
    for (std::uint64_t& s : sum) {
      s += i;
      asm volatile("" : "+r"(s));
    }
  }
  return tool::thread_us() - start;
}

// Something to do for all threads of a crew, 0.2 ms each.
class Busy final : public hal::Job {
 private:
  void do_work(std::size_t /*worker*/) override {
    for (int i = 0; i < 20; ++i) (void)dense_work_us();
  }
};

struct Side {
  std::function<void()> work;
  tool::TimedCrew* crew = nullptr;    // those who help with the work; reset for each block
  std::function<void()> before = {};  // before each block, not timed
};

struct Figure {
  double median = std::nan("");
  double low = std::nan("");  // of the 95 % interval
  double high = std::nan("");
  std::size_t kept = 0;
  std::size_t tried = 0;

  [[nodiscard]] std::string text() const { return fmt::format("{:.2f} ({:.2f} to {:.2f})", median, low, high); }
};

// Of the median, from at least six values.
[[nodiscard]] inline Figure figure_of(std::vector<double> values) {
  Figure figure;
  figure.kept = values.size();
  if (values.size() < 6) return figure;
  std::sort(values.begin(), values.end());
  const auto n = values.size();
  figure.median = (values[(n - 1) / 2] + values[n / 2]) / 2;
  // The largest rank k with P(fewer than k of n values below the median) <= 2.5 %: binomial with p = 1/2.
  double below = 0;
  std::size_t rank = 0;
  for (double term = std::pow(0.5, static_cast<double>(n)); below + term <= 0.025; ++rank) {
    below += term;
    term *= static_cast<double>(n - rank) / static_cast<double>(rank + 1);
  }
  figure.low = values[rank - 1];
  figure.high = values[n - rank];
  return figure;
}

class Pairs {
 public:
  static constexpr double kBlockUs = 3'000;
  static constexpr std::size_t kWanted = 101;    // pairs that count
  static constexpr std::size_t kPatience = 300;  // pairs in all

  // `blocks` of several runs, as long as kBlockUs; or, for work that has a state, of one run each.
  enum class Runs : std::uint8_t { kBlocks, kOne };
  explicit Pairs(Runs runs) : runs_(runs) {}

  [[nodiscard]] bool enough() const {
    return pairs_.size() >= kPatience || (pairs_.size() >= kWanted && kept() >= kWanted);
  }

  // One pair.
  void add(const Side& rival, const Side& ours) {
    if (runs_ == Runs::kBlocks && pairs_.empty()) {
      for (const Side* side : {&rival, &ours}) {
        const double us = std::max(1.0, (block(*side, 1), block(*side, 1).us));  // the first warms up
        (side == &rival ? rivals_calls_ : our_calls_) = std::max(1, static_cast<int>(std::lround(kBlockUs / us)));
      }
    }
    Pair pair;
    const auto probe = [&pair] {
      const double us = dense_work_us();
      probes_us().push_back(us);
      pair.probe_us = std::max(pair.probe_us, us);
    };
    probe();
    const bool rival_first = pairs_.size() % 2 == 0;
    for (const bool rivals : {rival_first, !rival_first}) {
      (rivals ? pair.rival : pair.ours) = rivals ? block(rival, rivals_calls_) : block(ours, our_calls_);
      probe();
    }
    pairs_.push_back(pair);
  }
  void run(const Side& rival, const Side& ours) {
    while (!enough()) add(rival, ours);
  }

  [[nodiscard]] Figure ratio() const {
    return of([](const Pair& p) { return p.rival.us / p.ours.us; });
  }
  [[nodiscard]] Figure rival_us() const {
    return of([](const Pair& p) { return p.rival.us; });
  }
  [[nodiscard]] Figure our_us() const {
    return of([](const Pair& p) { return p.ours.us; });
  }

 private:
  struct Block {
    double us = 0;  // of a call
    double cycles_per_instruction = 0;
    bool whole = false;  // nobody took the core
  };
  struct Pair {
    Block rival, ours;
    double probe_us = 0;
  };

  // Of this run of the program.
  static std::vector<double>& probes_us() {
    static std::vector<double> all;
    return all;
  }
  static long switches() {
    rusage used{};
    getrusage(RUSAGE_THREAD, &used);
    return used.ru_nivcsw;
  }
  static Block block(const Side& side, int calls) {
    const Counters& counters = Counters::of_machine();
    if (side.crew != nullptr) {
      // A thread that slept through the rival's block is woken late, and the pair would not count.
      Busy busy;
      side.crew->run(busy);
      side.crew->reset();
    }
    if (side.before) side.before();
    const long switched = switches();
    const Counters::Reading before = counters.read();
    const double wall = tool::wall_us();
    const double start = tool::thread_us();
    for (int i = 0; i < calls; ++i) side.work();
    const double own_us = tool::thread_us() - start;
    const double lost_us = tool::wall_us() - wall - own_us;
    const Counters::Reading after = counters.read();
    Block out;
    out.us = (side.crew != nullptr ? side.crew->path_us(own_us) : own_us) / calls;
    if (after.instructions > before.instructions) {
      out.cycles_per_instruction = static_cast<double>(after.cycles - before.cycles) /
                                   static_cast<double>(after.instructions - before.instructions);
    }
    // Reading the clocks takes some microseconds; an interrupt, 2 % of a block.
    out.whole =
        switches() == switched && lost_us < 5 + 0.02 * own_us && (side.crew == nullptr || side.crew->together());
    return out;
  }

  static double quantile(std::vector<double> values, double share) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  }
  [[nodiscard]] double usual(Block Pair::*side) const {
    std::vector<double> values;
    for (const Pair& p : pairs_) values.push_back((p.*side).cycles_per_instruction);
    return quantile(std::move(values), 0.5);
  }
  template <typename Value>
  [[nodiscard]] Figure of(Value&& value) const {
    // Around the usual cycles per instruction; of the probe above its fastest. A core's clock moves by 6 % here, and
    // who shares the core takes 30 % and more of the probe.
    constexpr double kBand = 0.05, kProbeBand = 0.15;
    const double rivals = usual(&Pair::rival), our = usual(&Pair::ours);
    const double slowest_us = (1 + kProbeBand) * quantile(probes_us(), 0.1);
    std::vector<double> values;
    for (const Pair& p : pairs_) {
      if (p.rival.whole && p.ours.whole && p.probe_us <= slowest_us &&
          std::abs(p.rival.cycles_per_instruction - rivals) <= kBand * rivals &&
          std::abs(p.ours.cycles_per_instruction - our) <= kBand * our) {
        values.push_back(value(p));
      }
    }
    Figure figure = figure_of(std::move(values));
    figure.tried = pairs_.size();
    return figure;
  }
  [[nodiscard]] std::size_t kept() const { return ratio().kept; }

  Runs runs_;
  int rivals_calls_ = 1;
  int our_calls_ = 1;
  std::vector<Pair> pairs_;
};

// The worst figure of many pictures, for a claim: a line "NAME: MEDIAN (LOW to HIGH), WHERE; KEPT of TRIED pairs".
class Worst {
 public:
  explicit Worst(std::string name) : name_(std::move(name)) {}

  void see(const Figure& figure, const std::string& where) {
    kept_ += figure.kept;
    tried_ += figure.tried;
    if (std::isnan(figure.median)) {
      unmeasured_ += " " + where;
    } else if (std::isnan(worst_.median) || figure.median < worst_.median) {
      worst_ = figure;
      where_ = where;
    }
  }
  [[nodiscard]] const std::string& where() const { return where_; }
  void print() const {
    if (tried_ == 0) return;
    fmt::print("{}: {}, {}; {} of {} pairs\n", name_, worst_.text(), where_, kept_, tried_);
    if (!unmeasured_.empty()) fmt::print("{}: too few quiet pairs:{}\n", name_, unmeasured_);
  }

 private:
  std::string name_;
  Figure worst_;
  std::string where_;
  std::string unmeasured_;
  std::size_t kept_ = 0;
  std::size_t tried_ = 0;
};

}  // namespace holdfast::bench
