// SPDX-License-Identifier: Apache-2.0
// Every fault that this world knows, one at a time, with object held and empty gel; some pairs; a soak. In virtual
// time, in a child process, judged by this one (toolchain/faults). All pairs: `holdfast faults --pairs`.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "toolchain/faults/scenarios.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::faults;
using namespace std::chrono_literals;

namespace {

constexpr Micros kFrame{40'000};

void check(const Run& run) {
  const std::string what = run.name + ": ends in " + std::string(info(run.judgement.last_state).name) + ", " +
                           std::string(info(run.judgement.last_reason).name);
  CHECK_FALSE_TEXT(run.crashed, what.c_str());
  LONGS_EQUAL_TEXT(0, run.judgement.unsafe_fine.count(), what.c_str());
  CHECK_TRUE_TEXT(run.passed(), what.c_str());
}

// Long enough "fine" before the fault that its absence means something.
void check_was_fine(const Run& run) {
  CHECK_TRUE_TEXT(run.judgement.fine > 1500ms, run.name.c_str());
}

// With one frame in twenty lost on the way: no FAULT.
void check_healthy(Setup setup, Micros period) {
  setup.period = period;
  setup.drop_every = 20;
  const Run run = play("healthy", setup, true);
  check(run);
  LONGS_EQUAL(0, run.judgement.faults);
  CHECK_TRUE(run.judgement.fine > setup.end - 3s);
}

std::uint64_t from_environment(const char* name, std::uint64_t otherwise) {
  const char* const text = std::getenv(name);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

}  // namespace

TEST_GROUP(Faults){};

// The observer's own rule: 150 ms after the truth, not a microsecond more.
TEST(Faults, TheJudgeCountsEveryMicrosecondBeyondTheRule) {
  const auto play_lines = [](Micros last_edge, bool lowered, Micros lowered_at) {
    Judge judge;
    judge.take({1'000'000, sim::TapeKind::kUnsafe, 0, 1});
    judge.take({2'000'000, sim::TapeKind::kUnsafe, 0, 0});
    const auto line = [&](Micros at, hal::Line which, bool high) {
      judge.take({at.count(), sim::TapeKind::kLine, static_cast<std::uint8_t>(which),
                  static_cast<std::uint8_t>(high ? 1 : 0)});
    };
    line(900ms, hal::Line::kGripOk, true);
    line(last_edge, hal::Line::kAlive, true);
    if (lowered) line(lowered_at, hal::Line::kGripOk, false);
    judge.take({3'000'000, sim::TapeKind::kEnd, 0, 0});
    return judge.finish();
  };
  LONGS_EQUAL(0, play_lines(1000ms, false, {}).unsafe_fine.count());
  LONGS_EQUAL(1, play_lines(1'000'001us, false, {}).unsafe_fine.count());
  LONGS_EQUAL(150'000, play_lines(1500ms, false, {}).unsafe_fine.count());
  LONGS_EQUAL(10'000, play_lines(1500ms, true, 1510ms).unsafe_fine.count());
  LONGS_EQUAL(0, play_lines(1100ms, true, 1150ms).unsafe_fine.count());
  LONGS_EQUAL(150'000, play_lines(1100ms, true, 1150ms).to_safe.count());
  CHECK_FALSE(play_lines(1100ms, true, 1150ms).to_recover.has_value());
}

TEST(Faults, AreSafeInTimeAndEndWell) {
  for (int k = 0; k < kTroubles; ++k) {
    const auto trouble = static_cast<Trouble>(k);
    for (const bool held : {true, false}) {
      const Run run = play(trouble, held);
      check(run);
      check_was_fine(run);
    }
  }
}

// A replug within 2 s, a killed process within 3 s, with the object still held and with an empty gel.
TEST(Faults, RecoverInTime) {
  struct Case {
    Trouble trouble;
    Micros within;
  };
  for (const Case& c : {Case{Trouble::kCameraGone, 2s}, {Trouble::kCameraRefused, 2s}, {Trouble::kKilled, 3s}}) {
    for (const bool held : {true, false}) {
      const Run run = play(c.trouble, held);
      check(run);
      CHECK_TRUE_TEXT(run.judgement.to_recover && *run.judgement.to_recover <= c.within, run.name.c_str());
      if (c.trouble == Trouble::kKilled) LONGS_EQUAL(1, run.outcome.resumed);
    }
  }
}

// Every ninth pair of the faults from the field; the others are the command's.
TEST(Faults, TwoAtOnceAreSafe) {
  int pair = 0;
  for (const Row& a : rows()) {
    for (const Row& b : rows()) {
      if (b.number < a.number || !a.trouble || !b.trouble || ++pair % 9 != 0) continue;
      check(play(*a.trouble, *b.trouble, pair % 2 == 0));
    }
  }
}

// 15 to 27 frames a second, and one in twenty lost on the way: no FAULT in ten minutes.
TEST(Faults, AHealthySensorRaisesNone) {
  Setup setup;
  setup.end = 150s;
  for (const Micros period : {66'667us, 53'333us, 40'000us, 37'037us}) check_healthy(setup, period);
}

// Two fingers: each fault of a camera on either, and every other fault once.
TEST(Faults, OfAHandAreSafeInTimeAndEndWell) {
  for (int k = 0; k < kTroubles; ++k) {
    const auto trouble = static_cast<Trouble>(k);
    for (int finger = 0; finger < (is_camera(trouble) ? 2 : 1); ++finger) {
      const Run run = play_hand(trouble, finger, (k + finger) % 2 == 0);
      check(run);
      check_was_fine(run);
    }
  }
}

// Every ninth pair of a fault of the left finger's camera with one of the right one's, both beginning with either; the
// others are the command's.
TEST(Faults, OnBothFingersAtOnceAreSafe) {
  int pair = 0;
  for (const Row& a : rows()) {
    for (const Row& b : rows()) {
      if (!a.trouble || !b.trouble || !is_camera(*a.trouble) || !is_camera(*b.trouble) || ++pair % 9 != 0) continue;
      check(play_hand(*a.trouble, *b.trouble, pair % 2 == 0));
    }
  }
}

TEST(Faults, TwoHealthySensorsRaiseNone) {
  Setup setup;
  setup.hand = true;
  setup.end = 60s;
  for (const Micros period : {66'667us, 40'000us, 37'037us}) check_healthy(setup, period);
}

// What is stored and what the board says: the trouble happens, is met, and is told.
TEST(Faults, OfCardAndBoardAreMetAndTold) {
  struct Case {
    Trouble trouble;
    std::uint32_t saves, saves_failed, loaded;
    Reason told;  // kNone: nothing is
  };
  for (const Case& c : {Case{Trouble::kDiskFull, 1, 1, 0, Reason::kNone},
                        {Trouble::kCardTorn, 1, 1, 0, Reason::kConfig},
                        {Trouble::kModelDamaged, 0, 0, 1, Reason::kConfig},
                        {Trouble::kRecordsDamaged, 1, 0, 1, Reason::kConfig},
                        {Trouble::kSupplyLow, 0, 0, 0, Reason::kBoardUndervoltage},
                        {Trouble::kChipsRenumbered, 0, 0, 0, Reason::kNone},
                        {Trouble::kUsbDead, 0, 0, 0, Reason::kCameraGone}}) {
    const Run run = play(c.trouble, true);
    check(run);
    const char* const name = run.name.c_str();
    LONGS_EQUAL_TEXT(c.saves, run.outcome.saves, name);
    LONGS_EQUAL_TEXT(c.saves_failed, run.outcome.saves_failed, name);
    LONGS_EQUAL_TEXT(c.loaded, run.outcome.loaded, name);
    for (const Reason reason : {Reason::kConfig, Reason::kBoardUndervoltage, Reason::kCameraGone}) {
      CHECK_EQUAL_TEXT(reason == c.told, run.judgement.reasons.contains(reason), name);
    }
  }
}

TEST_GROUP(FaultsSoak){};

// HOLDFAST_SOAK_FRAMES=2160000 for the soak of a release.
TEST(FaultsSoak, IsSafeThroughRandomFaults) {
  const std::uint64_t frames = from_environment("HOLDFAST_SOAK_FRAMES", 100'000);
  const Setup setup = soak_setup(frames, 20261122);
  CHECK_TRUE(setup.windows.size() > frames / 600);
  const Run run = play("soak", setup);
  std::printf(" %llu frames, %zu faults: \"fine\" against the rule for %.3f ms; %d FAULT states, %d without a cause;",
              static_cast<unsigned long long>(frames), setup.windows.size(),
              static_cast<double>(run.judgement.unsafe_fine.count()) / 1e3, run.judgement.faults, false_faults(run));
  check(run);
  CHECK_TRUE(run.judgement.fine > kFrame * static_cast<std::int64_t>(frames) * 6 / 10);
  CHECK_TRUE(false_faults(run) <= 1);
  CHECK_TRUE(run.outcome.growth_kb <= 4096);
  LONGS_EQUAL(0, run.outcome.open_files);
}

// No fault, but something the robot has to know: the object is gone, and nobody had said OPENING.
TEST(Faults, AnObjectThatFallsIsTold) {
  Setup setup;
  setup.gripper = false;
  setup.falls_at = 5s;
  const Run fell = play("falls", setup, true);
  check(fell);
  CHECK_TRUE(fell.judgement.reasons.contains(Reason::kContactLost));
  setup.falls_at = {};
  const Run held = play("stays", setup, true);
  check(held);
  CHECK_FALSE(held.judgement.reasons.contains(Reason::kContactLost));
  CHECK_TRUE(held.judgement.fine - fell.judgement.fine >= 150ms);
}

// Each cell and row is tried, or says why not.
TEST(Faults, EveryCellAndRowIsTriedOrSaysWhyNot) {
  for (const Cell& cell : cells()) CHECK_TRUE(cell.trouble.has_value() == cell.why_not.empty());
  for (const Row& row : rows()) CHECK_TRUE(row.trouble.has_value() == row.why_not.empty());
  for (int k = 0; k < kTroubles; ++k) LONGS_EQUAL(k, static_cast<int>(info(static_cast<Trouble>(k)).trouble));
  for (std::size_t k = 0; k < cells().size(); ++k) {
    LONGS_EQUAL(k / 7, static_cast<std::size_t>(cells()[k].component));
    LONGS_EQUAL(k % 7, static_cast<std::size_t>(cells()[k].type));
  }
}
