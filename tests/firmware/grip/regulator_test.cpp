// SPDX-License-Identifier: Apache-2.0
#include "grip/regulator.hpp"

#include <chrono>
#include <cstdint>
#include <random>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;
using regulator::Command;
using regulator::Phase;

namespace {

constexpr Micros kFrame = 40ms;

NatsQ16 nats(double value) {
  return NatsQ16::from_raw(static_cast<std::int32_t>(value * 65536.0));
}

}  // namespace

TEST_GROUP(Regulator) {
  // Plain numbers: a step of 10 every frame, no growth, stable after two frames.
  regulator::Config config{.start_force = 50,
                           .force_step = 10,
                           .grow_pct = 0,
                           .max_force = 100,
                           .every = kFrame,
                           .grasp_for = 200ms,
                           .calm_nat_q16 = 6554,
                           .calm_after = 80ms,
                           .hold_after = 200ms,
                           .release_step = 20,
                           .release_every = kFrame};
  regulator::State state;
  Micros now{};
  Command command;

  // One frame more. E as given: it takes 0.1 nat to be no longer constant.
  const Command& frame(bool slips, double entropy, bool trusted = true) {
    now += kFrame;
    regulator::Input input;
    input.trusted = trusted;
    input.request = slips ? GripRequest::kTighten : GripRequest::kHold;
    input.verdict = slips ? Verdict::kSlip : Verdict::kHold;
    input.entropy = nats(entropy);
    command = regulator::update(state, config, input, now);
    return command;
  }
  const Command& tell(bool grip, bool release, bool trusted = true) {
    now += kFrame;
    regulator::Input input;
    input.trusted = trusted;
    input.grip = grip;
    input.release = release;
    command = regulator::update(state, config, input, now);
    return command;
  }
  void grasp() {
    (void)tell(true, false);
    for (int i = 0; i < 10; ++i) (void)frame(false, 1.0);
    CHECK_TRUE(command.phase == Phase::kHolding);
  }
};

TEST(Regulator, TheDefaultsAreValidAndEveryLimitIsChecked) {
  CHECK_TRUE(regulator::validate({}).ok());
  CHECK_TRUE(regulator::validate(config).ok());
  const auto refused = [](auto change) {
    regulator::Config bad;
    change(bad);
    return regulator::validate(bad).reason == Reason::kConfig;
  };
  CHECK_TRUE(refused([](auto& c) { c.start_force = -1; }));
  CHECK_TRUE(refused([](auto& c) { c.max_force = 256; }));
  CHECK_TRUE(refused([](auto& c) { c.start_force = c.max_force + 1; }));
  CHECK_TRUE(refused([](auto& c) { c.max_force = c.start_force - 1; }));
  CHECK_TRUE(refused([](auto& c) { c.force_step = 0; }));
  CHECK_TRUE(refused([](auto& c) { c.release_step = 0; }));
  CHECK_TRUE(refused([](auto& c) { c.grow_pct = 101; }));
  CHECK_TRUE(refused([](auto& c) { c.every = -1us; }));
  CHECK_TRUE(refused([](auto& c) { c.release_every = -1us; }));
  CHECK_TRUE(refused([](auto& c) { c.grasp_for = -1us; }));
  CHECK_TRUE(refused([](auto& c) { c.calm_nat_q16 = -1; }));
  CHECK_TRUE(refused([](auto& c) { c.calm_after = -1us; }));
  CHECK_TRUE(refused([](auto& c) { c.hold_after = -1us; }));
  CHECK_TRUE(refused([](auto& c) { c.start_force = c.max_force = 256; }));
  CHECK_TRUE(refused([](auto& c) { c.force_step = 256; }));
  CHECK_TRUE(refused([](auto& c) { c.release_step = 256; }));
  CHECK_TRUE(refused([](auto& c) { c.grow_pct = -1; }));
  // The ends of the ranges are in them.
  const regulator::Config least{0, 1, 0, 0, 0us, 0us, 0, 0us, 0us, 1, 0us};
  CHECK_TRUE(regulator::validate(least).ok());
  const regulator::Config most{255, 255, 100, 255, 1h, 1h, INT32_MAX, 1h, 1h, 255, 1h};
  CHECK_TRUE(regulator::validate(most).ok());
}

TEST(Regulator, IdleUntilToldToGripAndThenTheStartingForce) {
  for (int i = 0; i < 5; ++i) {
    CHECK_EQUAL(0, frame(true, 0.3 * i).force);
    CHECK_FALSE(command.go);
    CHECK_TRUE(command.phase == Phase::kIdle);
  }
  (void)tell(true, false);
  CHECK_EQUAL(50, command.force);
  CHECK_TRUE(command.go);
  CHECK_TRUE(command.phase == Phase::kGripping);
  CHECK_EQUAL(0, command.steps);
}

TEST(Regulator, ASlipWhileItClosesIsNotHeard) {
  (void)tell(true, false);
  for (int i = 0; i < 4; ++i) CHECK_EQUAL(50, frame(true, 0.3 * i).force);
  CHECK_EQUAL(60, frame(true, 2.0).force);  // 200 ms are over
}

TEST(Regulator, StepsWhileItSlipsAndEChangesThenSettlesAndHolds) {
  grasp();
  CHECK_EQUAL(60, frame(true, 1.3).force);
  CHECK_TRUE(command.phase == Phase::kTightening);
  CHECK_EQUAL(1, command.steps);
  CHECK_EQUAL(70, frame(true, 1.6).force);
  CHECK_EQUAL(80, frame(true, 1.9).force);
  CHECK_EQUAL(90, frame(true, 1.95).force);  // constant for one frame
  CHECK_EQUAL(90, frame(true, 1.9).force);   // for two: the request alone does not raise
  CHECK_TRUE(command.phase == Phase::kSettling);
  CHECK_EQUAL(90, frame(false, 1.9).force);
  CHECK_EQUAL(90, frame(false, 1.9).force);
  CHECK_TRUE(command.phase == Phase::kSettling);
  CHECK_EQUAL(90, frame(false, 1.9).force);
  CHECK_TRUE(command.phase == Phase::kHolding);
  CHECK_EQUAL(4, command.steps);
}

// Pulses are told as a difference: what is set while it grips may move none.
TEST(Regulator, StepsAreCountedAsTheyWereWhenItBegan) {
  grasp();
  (void)frame(true, 1.3);
  CHECK_EQUAL(2, (frame(true, 1.6), command.steps));
  config.start_force = 70;
  config.force_step = 3;
  CHECK_EQUAL(2, frame(false, 1.6).steps);
  CHECK_EQUAL(70, command.force);
}

// The limit is the owner's word on what the object bears.
TEST(Regulator, ALowerLimitIsObeyedAtOnce) {
  grasp();
  (void)frame(true, 1.3);
  CHECK_EQUAL(70, frame(true, 1.6).force);
  config.max_force = 55;
  CHECK_EQUAL(55, frame(false, 1.6, false).force);
}

// A finger that is lost says nothing of the other's E.
TEST(Regulator, AFingerThatIsNotTrustedDoesNotKeepTheOtherFromCalm) {
  const auto give = [&](int finger, bool trusted) {
    now += kFrame / 2;
    command = regulator::update(state, config, {.trusted = trusted, .entropy = nats(1.0), .finger = finger}, now);
  };
  (void)tell(true, false);
  for (int i = 0; i < 20; ++i) {
    give(0, true);
    give(1, false);
  }
  CHECK_TRUE(command.phase == Phase::kHolding);
}

// Each finger has an E of its own; the steps end when both are constant.
TEST(Regulator, OfTwoFingersEachHasItsOwnE) {
  const auto slips = [&](int finger, double entropy) {
    now += kFrame;
    command = regulator::update(state, config,
                                {.trusted = true,
                                 .request = GripRequest::kTighten,
                                 .verdict = Verdict::kSlip,
                                 .entropy = nats(entropy),
                                 .finger = finger},
                                now);
    return command.force;
  };
  grasp();
  CHECK_EQUAL(60, slips(0, 1.3));
  CHECK_EQUAL(70, slips(1, 2.0));
  CHECK_EQUAL(80, slips(0, 1.3));
  CHECK_EQUAL(80, slips(1, 2.0));  // both stand still for 80 ms
  CHECK_EQUAL(80, slips(0, 1.3));
  CHECK_EQUAL(90, slips(1, 2.3));
}

// The request outlasts the slip (decision.hpp), and a single slip is not requested: neither alone raises.
TEST(Regulator, NeitherTheRequestNorTheVerdictAloneRaises) {
  grasp();
  for (int i = 0; i < 20; ++i) {
    now += kFrame;
    regulator::Input input;
    input.trusted = true;
    input.request = i % 2 == 0 ? GripRequest::kTighten : GripRequest::kHold;
    input.verdict = i % 2 == 0 ? Verdict::kHold : Verdict::kSlip;
    input.entropy = nats(0.15 * i);
    CHECK_EQUAL(50, regulator::update(state, config, input, now).force);
  }
}

TEST(Regulator, EThatChangesWithoutASlipRaisesNothing) {
  grasp();
  for (int i = 0; i < 50; ++i) CHECK_EQUAL(50, frame(false, i % 2 == 0 ? 0.5 : 2.5).force);
}

TEST(Regulator, ALargerShareOfALargerForce) {
  config.grow_pct = 10;
  config.max_force = 255;
  grasp();
  CHECK_EQUAL(50 + 10 + 5, frame(true, 1.3).force);
  CHECK_EQUAL(65 + 10 + 6, frame(true, 1.6).force);
}

TEST(Regulator, NeverFasterThanEvery) {
  config.every = 100ms;
  grasp();
  CHECK_EQUAL(60, frame(true, 1.3).force);
  CHECK_EQUAL(60, frame(true, 1.6).force);
  CHECK_EQUAL(60, frame(true, 1.9).force);
  CHECK_EQUAL(70, frame(true, 2.2).force);
}

TEST(Regulator, StopsAtTheLimitAndSaysSoWhileItStillSlips) {
  grasp();
  for (int i = 0; i < 5; ++i) CHECK_FALSE(frame(true, 1.0 + 0.2 * (i + 1)).at_limit && command.force < 100);
  CHECK_EQUAL(100, command.force);
  CHECK_TRUE(frame(true, 0.2).at_limit);
  CHECK_EQUAL(100, command.force);
  CHECK_FALSE(frame(false, 0.2).at_limit);
  CHECK_EQUAL(100, command.force);
}

TEST(Regulator, AFaultHoldsWhatIsCommanded) {
  grasp();
  (void)frame(true, 1.3);
  for (int i = 0; i < 100; ++i) {
    CHECK_EQUAL(60, frame(true, i % 3, false).force);
    CHECK_TRUE(command.go);
  }
  // What E was before the fault counts for nothing after it.
  CHECK_EQUAL(70, frame(true, 1.3).force);
}

TEST(Regulator, ReleasesStepByStepAndOpens) {
  grasp();
  const int expected[] = {30, 10, 0};
  for (const int force : expected) {
    CHECK_EQUAL(force, tell(false, true).force);
    CHECK_TRUE(command.phase == (force > 0 ? Phase::kReleasing : Phase::kIdle));
  }
  CHECK_FALSE(command.go);
  // Goes on by itself after an edge, and RELEASE while idle is nothing.
  CHECK_EQUAL(0, tell(false, true).force);
  grasp();
  CHECK_EQUAL(30, tell(false, true).force);
  CHECK_EQUAL(-2, command.steps);
  CHECK_EQUAL(10, frame(false, 1.0).force);
  CHECK_EQUAL(0, frame(true, 2.0).force);
}

TEST(Regulator, GripStopsAReleaseWhereItIs) {
  grasp();
  CHECK_EQUAL(30, tell(false, true).force);
  CHECK_EQUAL(30, tell(true, false).force);
  CHECK_TRUE(command.phase != Phase::kReleasing);
  CHECK_EQUAL(30, frame(false, 1.0).force);
  CHECK_EQUAL(40, frame(true, 1.3).force);
}

TEST(Regulator, ReleaseWinsOverGripAndWorksWithoutTrust) {
  grasp();
  CHECK_EQUAL(30, tell(true, true, false).force);
  CHECK_EQUAL(10, tell(true, true, false).force);
  CHECK_EQUAL(0, tell(true, true, false).force);
}

TEST(Regulator, AGapOfHoursIsOneStep) {
  grasp();
  now += 10h;
  CHECK_EQUAL(60, frame(true, 1.3).force);
  now += 10h;
  (void)tell(false, true);
  now += 10h;
  CHECK_EQUAL(20, frame(false, 1.0).force);
}

// The times and steps of a board, which no parameter changes: 900 ms to close, 40 ms a step, 280 ms of a constant E end
// the steps, 400 ms make it stable; E is constant within 0.05 nat.
TEST(Regulator, KeepsTheTimesOfABoard) {
  config = {};
  struct Call {
    Micros at;
    regulator::Input input;
    int force;
    Phase phase;
  };
  const auto slips = [](std::int32_t nat_q16) {
    return regulator::Input{true, GripRequest::kTighten, Verdict::kSlip, NatsQ16::from_raw(nat_q16)};
  };
  const auto holds = [](std::int32_t nat_q16) {
    return regulator::Input{true, GripRequest::kHold, Verdict::kHold, NatsQ16::from_raw(nat_q16)};
  };
  regulator::Input grip, release;
  grip.grip = release.release = true;
  for (const Call& c : {Call{0us, grip, 20, Phase::kGripping},
                        {899'999us, slips(0), 20, Phase::kGripping},
                        {900ms, slips(9000), 23, Phase::kTightening},
                        {939'999us, slips(9000), 23, Phase::kTightening},
                        {940ms, slips(9000), 26, Phase::kTightening},
                        {1'179'999us, slips(9000), 29, Phase::kTightening},
                        {1180ms, slips(9000), 29, Phase::kSettling},
                        {1'299'999us, holds(9000 + 3277), 29, Phase::kSettling},
                        {1300ms, holds(9000 - 3277), 29, Phase::kHolding},
                        {1400ms, slips(9000 + 3278), 32, Phase::kTightening},
                        {1700ms, slips(9000 + 3278), 32, Phase::kSettling},
                        {1701ms, slips(9000), 35, Phase::kTightening},
                        {2s, release, 29, Phase::kReleasing},
                        {2'039'999us, {}, 29, Phase::kReleasing},
                        {2040ms, {}, 23, Phase::kReleasing}}) {
    command = regulator::update(state, config, c.input, 10s + c.at);
    CHECK_EQUAL(c.force, command.force);
    CHECK_TRUE(c.phase == command.phase);
  }
}

// Any frames, any settings, any times that do not run backwards.
TEST(Regulator, WhateverComesItKeepsItsPromises) {
  std::mt19937 random(20'251'122);
  const auto below = [&](int count) { return static_cast<int>(random() % static_cast<unsigned>(count)); };
  int raised = 0;
  int released = 0;
  for (int run = 0; run < 3000; ++run) {
    regulator::Config any;
    any.max_force = below(256);
    any.start_force = below(any.max_force + 1);
    any.force_step = 1 + below(255);
    any.grow_pct = below(101);
    any.every = Micros{below(300'000)};
    any.grasp_for = Micros{below(300'000)};
    any.calm_nat_q16 = below(1 << 18);
    any.calm_after = Micros{below(300'000)};
    any.release_step = 1 + below(255);
    any.release_every = Micros{below(300'000)};
    CHECK_TRUE(regulator::validate(any).ok());
    regulator::State walk;
    Micros time{below(1'000'000)};
    Micros raised_at = time - 1h;
    Command before;
    for (int i = 0; i < 200; ++i) {
      time += Micros{below(20) == 0 ? below(2'000'000'000) : below(100'000)};
      regulator::Input input;
      input.trusted = below(4) != 0;
      input.request = below(2) != 0 ? GripRequest::kTighten : GripRequest::kHold;
      input.verdict = below(3) != 0 ? Verdict::kSlip : Verdict::kHold;
      input.entropy = NatsQ16::from_raw(below(NatsQ16::kMax + 1));
      input.grip = below(5) == 0;
      input.release = below(40) == 0;
      const Command after = regulator::update(walk, any, input, time);
      CHECK_TRUE(after.force <= any.max_force);
      CHECK_EQUAL(after.go, after.phase != Phase::kIdle);
      const bool opens = before.phase == Phase::kReleasing || input.release;
      if (after.force < before.force) {
        CHECK_TRUE(opens);
        CHECK_TRUE(after.force == 0 || before.force - after.force == any.release_step);
        ++released;
      }
      const bool starts = before.phase == Phase::kIdle;
      if (starts && after.go) CHECK_TRUE(input.grip);
      if (after.force > before.force && !starts) {
        CHECK_TRUE(input.trusted);
        CHECK_TRUE(input.request == GripRequest::kTighten && input.verdict == Verdict::kSlip);
        CHECK_TRUE(after.force - before.force <= any.force_step + before.force * any.grow_pct / 100);
        CHECK_TRUE(time - raised_at >= any.every);
        raised_at = time;
        ++raised;
      }
      before = after;
    }
  }
  CHECK_TRUE(raised > 1000);
  CHECK_TRUE(released > 1000);
}
