// SPDX-License-Identifier: Apache-2.0
#include "app/health.hpp"

#include <chrono>
#include <cstdint>

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

TEST_GROUP(Health) {
  health::State state;
  health::Config config;
  std::uint32_t sequence = 0;
  Micros stamp{};

  // One accepted frame a period on; `lost` frames were sent in between and did not come.
  Reason strain(Micros period, std::uint32_t lost = 0, Micros age = 50ms) {
    sequence += 1 + lost;
    stamp += period * (1 + lost);
    health::came(state);
    return health::strain(state, config, stamp, sequence, age);
  }
};

TEST(Health, JudgesTheRateOverSixteenFrames) {
  struct Case {
    Micros period;
    Reason reason;
  };
  for (const Case& c : {Case{66'667us, Reason::kNone},  // 15 fps
                        {53'333us, Reason::kNone},      // 18.75
                        {40'000us, Reason::kNone},
                        {37'037us, Reason::kNone},  // 27
                        {83'000us, Reason::kNone},
                        {83'001us, Reason::kFrameRate},
                        {110'000us, Reason::kFrameRate},
                        {31'000us, Reason::kNone},
                        {30'999us, Reason::kFrameRate},
                        {16'667us, Reason::kFrameRate}}) {
    state = {};
    for (int k = 1; k <= 40; ++k) {
      CHECK_TRUE(strain(c.period) == (k < 16 ? Reason::kNone : c.reason));
    }
  }
}

// At 15 fps one lost frame in eight is none too few; of half of them less than 12 a second are left. Frames that were
// refused came all the same, and have a reason of their own.
TEST(Health, CountsTheFramesThatCame) {
  for (std::uint32_t k = 0; k < 100; ++k) CHECK_TRUE(strain(66'667us, k % 8 == 0 ? 1 : 0) == Reason::kNone);
  state = {};
  for (std::uint32_t k = 0; k < 100; ++k) {
    CHECK_TRUE(strain(66'667us, k % 2) == (k < 15 ? Reason::kNone : Reason::kFrameRate));
  }
  state = {};
  for (std::uint32_t k = 0; k < 100; ++k) {
    if (k % 2 != 0) health::came(state);
    CHECK_TRUE(strain(66'667us, k % 2) == Reason::kNone);
  }
}

// A stream that is too fast is so by its numbers: half of it lost leaves a rate that looks right.
TEST(Health, CountsPeriodsByNumber) {
  for (std::uint32_t k = 0; k < 100; ++k) {
    CHECK_TRUE(strain(20ms, k % 2) == (k < 15 ? Reason::kNone : Reason::kFrameRate));
  }
}

TEST(Health, JudgesDeadlinesOverTenSeconds) {
  for (int k = 0; k < 300; ++k) CHECK_TRUE(strain(40ms, 0, 95ms) == Reason::kNone);
  CHECK_TRUE(strain(40ms, 0, 95'001us) == Reason::kNone);
  CHECK_TRUE(strain(40ms, 0, 10s) == Reason::kNone);
  CHECK_TRUE(strain(40ms, 0, 100ms) == Reason::kDeadline);  // the third of 256
  for (int k = 0; k < 256 - 3; ++k) CHECK_TRUE(strain(40ms) == Reason::kDeadline);
  CHECK_TRUE(strain(40ms) == Reason::kNone);
  LONGS_EQUAL(3, state.late_frames);
  // Wherever the three are among the 256, at distances that any word of the memory has.
  for (int first = 1; first <= 256; ++first) {
    state = {};
    for (int k = 1; k <= first + 128; ++k) {
      const bool late = k >= first && (k - first) % 64 == 0;
      CHECK_TRUE(strain(40ms, 0, late ? 96ms : 50ms) == (k == first + 128 ? Reason::kDeadline : Reason::kNone));
    }
  }
}

// A stream that begins anew is not late for what came before.
TEST(Health, ForgetsLateFramesWithTheirStream) {
  for (int k = 0; k < 20; ++k) (void)strain(40ms);
  for (int k = 0; k < 3; ++k) (void)strain(40ms, 0, 96ms);
  CHECK_TRUE(strain(40ms) == Reason::kDeadline);
  health::restart(state);
  for (int k = 0; k < 20; ++k) CHECK_TRUE(strain(40ms) == Reason::kNone);
  LONGS_EQUAL(3, state.late_frames);  // since start
}
