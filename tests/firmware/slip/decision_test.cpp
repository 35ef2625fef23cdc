// SPDX-License-Identifier: Apache-2.0
#include "slip/decision.hpp"

#include <chrono>
#include <cstdint>
#include <string_view>
#include <vector>

#include <CppUTest/TestHarness.h>

using holdfast::GripRequest;
using holdfast::Micros;
using holdfast::Verdict;
namespace decision = holdfast::decision;
using namespace std::chrono_literals;

namespace {

constexpr Micros kPeriod = 40ms;  // 25 fps

// The request after each letter of `verdicts` ('s' slip, 'g' hold, but a slip that was raised goes on, '.' hold), one
// frame period apart: '#' raised, '.' not.
std::string_view walk(std::string_view verdicts, const decision::Config& config, std::vector<char>& out) {
  decision::State state;
  Micros now{};
  out.clear();
  for (const char c : verdicts) {
    now += kPeriod;
    const Verdict verdict = c == 's' ? Verdict::kSlip : Verdict::kHold;
    out.push_back(decision::update(state, config, verdict, now, c == 'g') == GripRequest::kTighten ? '#' : '.');
  }
  return {out.data(), out.size()};
}

// The rule from scratch, looking back over the whole history: raised at frame n when some run of
// `raise_frames` slips ended at frame k <= n, and since k no frame has held `hold` or longer after the latest
// slip before it.
bool raised_by_rule(const std::vector<Verdict>& verdicts, const std::vector<bool>& goes_on,
                    const std::vector<Micros>& times, std::size_t n, const decision::Config& config) {
  bool raised = false;
  std::size_t latest_slip = 0;
  for (std::size_t i = 0; i <= n; ++i) {
    if (verdicts[i] == Verdict::kSlip || (raised && goes_on[i])) latest_slip = i;
    const auto needed = static_cast<std::size_t>(config.raise_frames);
    bool run = i + 1 >= needed;
    for (std::size_t back = 0; run && back < needed; ++back) run = verdicts[i - back] == Verdict::kSlip;
    if (run) raised = true;
    if (verdicts[i] == Verdict::kHold && times[i] - times[latest_slip] >= config.hold) raised = false;
  }
  return raised;
}

}  // namespace

TEST_GROUP(Decision) {
  std::vector<char> out;
  decision::State state;
};

TEST(Decision, EverySampleOfAPattern) {
  struct Case {
    decision::Config config;
    std::string_view verdicts;
    std::string_view want;
  };
  const Case cases[] = {
      //                  a flicker, two in a row, held for 5 frames = 200 ms after the last slip
      {{2, 200ms}, "..s..ss.........", "......#####....."},
      // a single slip while raised starts the hold again
      {{2, 200ms}, "ss...s.......", ".#########..."},
      // two flickers with a hold between them are no run
      {{2, 200ms}, "s.s.s.s.", "........"},
      {{1, 200ms}, "s......", "#####.."},
      {{3, 40ms}, "ssss.s.ss.sss.", "..##........#."},
      {{2, 0ms}, "ss.ss.", ".#..#."},
      // what goes on keeps a slip raised, and neither raises one nor counts for a run
      {{2, 80ms}, "ssgg.g...g.", ".######...."},
      {{2, 80ms}, "ggsgsgss...", ".......##.."},
      {{10, 200ms}, "sssssssss.ssssssssss", "...................#"},
  };
  for (const Case& c : cases) {
    const std::string_view got = walk(c.verdicts, c.config, out);
    CHECK_TEXT(got == c.want, std::string(c.verdicts).append(" gives ").append(got).c_str());
  }
}

TEST(Decision, EqualToTheRuleOverRandomHistories) {
  std::uint32_t random = 7;
  const auto next = [&](std::uint32_t below) {
    random = random * 1664525U + 1013904223U;
    return (random >> 16) % below;
  };
  for (int history = 0; history < 200; ++history) {
    const decision::Config config{static_cast<int>(1 + next(4)), Micros{next(6) * 50'000}};
    std::vector<Verdict> verdicts;
    std::vector<bool> goes_on;
    std::vector<Micros> times;
    decision::State s;
    Micros now{};
    for (std::size_t i = 0; i < 60; ++i) {
      // 15 to 27 fps, sometimes a gap of hours
      now += Micros{37'000 + next(30'000)} + (next(20) == 0 ? Micros{5h} : Micros{0});
      times.push_back(now);
      verdicts.push_back(next(5) < 2 ? Verdict::kSlip : Verdict::kHold);
      goes_on.push_back(next(5) < 2);
      const GripRequest request = decision::update(s, config, verdicts.back(), now, goes_on.back());
      CHECK_EQUAL(raised_by_rule(verdicts, goes_on, times, i, config), request == GripRequest::kTighten);
    }
  }
}

TEST(Decision, DropsExactlyAtTheEndOfTheHold) {
  const decision::Config config{1, 200ms};
  CHECK_TRUE(GripRequest::kTighten == decision::update(state, config, Verdict::kSlip, 1s));
  CHECK_TRUE(GripRequest::kTighten == decision::update(state, config, Verdict::kHold, 1s + 199'999us));
  CHECK_TRUE(GripRequest::kHold == decision::update(state, config, Verdict::kHold, 1s + 200ms));
}

TEST(Decision, HoldsNoLongerAfterTheClockStepsBack) {
  const decision::Config config{1, 200ms};
  (void)decision::update(state, config, Verdict::kSlip, 2h);
  CHECK_TRUE(GripRequest::kTighten == decision::update(state, config, Verdict::kHold, 1h));
  CHECK_TRUE(GripRequest::kTighten == decision::update(state, config, Verdict::kHold, 1h + 199ms));
  CHECK_TRUE(GripRequest::kHold == decision::update(state, config, Verdict::kHold, 1h + 200ms));
}

TEST(Decision, AnEndlessSlipStaysRaisedAndCountsNoFurther) {
  const decision::Config config{};
  Micros now{};
  for (int i = 0; i < 100'000; ++i) {
    now += kPeriod;
    const GripRequest request = decision::update(state, config, Verdict::kSlip, now);
    CHECK_EQUAL(i >= 1, request == GripRequest::kTighten);
  }
  LONGS_EQUAL(config.raise_frames, state.run);
}
