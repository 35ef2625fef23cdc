// SPDX-License-Identifier: Apache-2.0
// Every transition of the device's state, as a table written from DESIGN.md (Outputs).
#include "app/supervisor.hpp"

#include <array>
#include <chrono>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

enum class Input { kLearning, kGood, kAfterGap, kSlip, kFew, kSlipAndFew, kRejected, kGone };

constexpr GridSize kGrid{7, 9};

supervisor::Inputs inputs_of(supervisor::Source source, Reason reason) {
  supervisor::Inputs inputs;
  inputs.of(source) = reason;
  return inputs;
}

pipeline::Result result_of(Input input) {
  pipeline::Result result;
  result.grid = kGrid;
  result.markers = 63;
  if (input == Input::kLearning) return result;
  result.referenced = true;
  result.features.markers = input == Input::kFew || input == Input::kSlipAndFew ? 54 : 63;
  result.features.gap = input == Input::kAfterGap;
  result.features.rates_valid = !result.features.gap;
  if (input == Input::kSlip || input == Input::kSlipAndFew) {
    result.verdict = Verdict::kSlip;
    result.request = GripRequest::kTighten;
  }
  if (input == Input::kRejected) result.quality = {Reason::kJpegDamaged};
  return result;
}

// What each accepted frame must lead to, whatever the state was before.
struct Accepted {
  Input input;
  DeviceState state;
  Reason reason;
};
constexpr std::array<Accepted, 6> kAccepted{{
    {Input::kLearning, DeviceState::kReference, Reason::kLearning},
    {Input::kGood, DeviceState::kOk, Reason::kNone},
    {Input::kAfterGap, DeviceState::kOk, Reason::kTimeGap},
    {Input::kSlip, DeviceState::kSlip, Reason::kSlipDetected},
    {Input::kFew, DeviceState::kDegraded, Reason::kFewMarkers},
    {Input::kSlipAndFew, DeviceState::kSlip, Reason::kSlipDetected},  // the more urgent of the two
}};

}  // namespace

TEST_GROUP(Supervisor) {
  supervisor::State state;
  supervisor::Config config;
  Micros now{1s};

  supervisor::Outputs feed(Input input, Micros after = 40ms) {
    now += after;
    if (input == Input::kGone) return supervisor::reject(state, config, Reason::kCameraGone, GripRequest::kHold, now);
    return supervisor::update(state, config, result_of(input), now);
  }

  // Brings a fresh supervisor into `from`; nothing for states that cannot be asked for.
  void bring(DeviceState from) {
    state = {};
    switch (from) {
      case DeviceState::kBoot:
        break;
      case DeviceState::kReference:
        (void)feed(Input::kLearning);
        break;
      case DeviceState::kOk:
        (void)feed(Input::kGood);
        break;
      case DeviceState::kSlip:
        (void)feed(Input::kSlip);
        break;
      case DeviceState::kDegraded:
        (void)feed(Input::kFew);
        break;
      case DeviceState::kFault:
        (void)feed(Input::kGone);
        break;
    }
    LONGS_EQUAL(static_cast<int>(from), static_cast<int>(state.device));
  }
};

// A number from somewhere else: a table must have an answer, and none is the only one that claims nothing.
// While there is no rest position the reason says what keeps it from being learned; afterwards neither counts.
TEST(Supervisor, SaysWhatKeepsTheRestPositionFromBeingLearned) {
  pipeline::Result result = result_of(Input::kLearning);
  const auto reason = [&] {
    now += 40ms;
    const supervisor::Outputs out = supervisor::update(state, config, result, now);
    CHECK_EQUAL(out.grip_ok, result.referenced);
    CHECK_TRUE(out.state == (result.referenced ? DeviceState::kOk : DeviceState::kReference));
    return out.reason;
  };
  CHECK_TRUE(reason() == Reason::kLearning);
  result.bent = true;
  CHECK_TRUE(reason() == Reason::kReferenceLoaded);
  result.light_changed = true;
  CHECK_TRUE(reason() == Reason::kLightChanged);
  result.referenced = true;
  result.features.markers = 63;
  CHECK_TRUE(reason() == Reason::kNone);
}

TEST(Supervisor, AReasonThatThereIsNotSaysNone) {
  POINTERS_EQUAL(&info(Reason::kNone), &info(static_cast<Reason>(255)));
  CHECK_TRUE(info(Reason::kGpioFailed).reason == Reason::kGpioFailed);
}

TEST(Supervisor, StartsInBootAndVouchesForNothing) {
  for (const supervisor::Outputs& outputs : {supervisor::Outputs{}, supervisor::outputs_of(state, false, false)}) {
    LONGS_EQUAL(static_cast<int>(DeviceState::kBoot), static_cast<int>(outputs.state));
    LONGS_EQUAL(static_cast<int>(Reason::kNone), static_cast<int>(outputs.reason));
    CHECK_FALSE(outputs.slip);
    CHECK_FALSE(outputs.grip_ok);
    CHECK_FALSE(outputs.accepted);
  }
}

TEST(Supervisor, GoesWhereTheAcceptedFrameSaysFromEveryState) {
  for (const StateInfo& from : kStates) {
    for (const Accepted& want : kAccepted) {
      bring(from.state);
      const supervisor::Outputs got = feed(want.input);
      LONGS_EQUAL(static_cast<int>(want.state), static_cast<int>(got.state));
      LONGS_EQUAL(static_cast<int>(want.reason), static_cast<int>(got.reason));
      CHECK_EQUAL(want.state == DeviceState::kOk, got.grip_ok);
      CHECK_EQUAL(want.state == DeviceState::kSlip, got.slip);
      CHECK_TRUE(got.accepted);
    }
  }
}

TEST(Supervisor, HoldsItsStateOverRejectedFramesFor150Milliseconds) {
  for (const StateInfo& from : kStates) {
    if (from.state == DeviceState::kBoot || from.state == DeviceState::kFault) continue;
    bring(from.state);
    for (int k = 0; k < 3; ++k) {
      const supervisor::Outputs got = feed(Input::kRejected, 50ms);
      LONGS_EQUAL(static_cast<int>(from.state), static_cast<int>(got.state));
      LONGS_EQUAL(static_cast<int>(Reason::kJpegDamaged), static_cast<int>(got.reason));
      CHECK_EQUAL(from.state == DeviceState::kOk, got.grip_ok);
      CHECK_FALSE(got.accepted);
    }
    const supervisor::Outputs late = feed(Input::kRejected, 1us);  // 150.001 ms
    LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(late.state));
    LONGS_EQUAL(static_cast<int>(Reason::kJpegDamaged), static_cast<int>(late.reason));
    CHECK_FALSE(late.grip_ok);
    CHECK_FALSE(late.accepted);
  }
}

TEST(Supervisor, FaultsAtOnceWhenTheCameraIsGoneOrAnother) {
  for (const Reason why : {Reason::kCameraGone, Reason::kCameraWrong}) {
    for (const StateInfo& from : kStates) {
      bring(from.state);
      now += 1us;
      const supervisor::Outputs got = supervisor::reject(state, config, why, GripRequest::kHold, now);
      LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(got.state));
      LONGS_EQUAL(static_cast<int>(why), static_cast<int>(got.reason));
      CHECK_FALSE(got.grip_ok);
      CHECK_FALSE(got.accepted);
    }
  }
}

// Nothing was ever accepted: there is no state to hold on to.
TEST(Supervisor, FaultsWhenTheFirstFrameIsRejected) {
  const supervisor::Outputs got = feed(Input::kRejected, 0us);
  LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(got.state));
  CHECK_FALSE(got.grip_ok);
  CHECK_FALSE(got.accepted);
  LONGS_EQUAL(static_cast<int>(DeviceState::kReference), static_cast<int>(feed(Input::kLearning).state));
}

// A fault does not heal by more rejected frames.
TEST(Supervisor, StaysInFaultUntilAFrameIsAccepted) {
  bring(DeviceState::kOk);
  (void)feed(Input::kRejected, 151ms);
  for (int k = 0; k < 100; ++k) {
    const supervisor::Outputs got = feed(Input::kRejected, 1ms);
    LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(got.state));
    CHECK_FALSE(got.grip_ok);
    CHECK_FALSE(got.accepted);
  }
  for (int k = 1; k <= 3; ++k) {
    const supervisor::Outputs healing = feed(Input::kGood);
    CHECK_TRUE(healing.accepted);
    CHECK_EQUAL(k == 3, healing.grip_ok);
    LONGS_EQUAL(static_cast<int>(healing.grip_ok ? Reason::kNone : Reason::kRecovering),
                static_cast<int>(healing.reason));
  }
}

// Frames that have nothing to be compared with end no fault, however many; without one they change nothing.
TEST(Supervisor, AFrameThatIsBlindEndsNoFault) {
  bring(DeviceState::kOk);
  pipeline::Result blind = result_of(Input::kGood);
  blind.features.imprint.blind = true;
  CHECK_TRUE(supervisor::update(state, config, blind, now += 40ms).grip_ok);
  (void)feed(Input::kRejected, 151ms);
  for (int k = 0; k < 10; ++k) {
    const supervisor::Outputs got = supervisor::update(state, config, blind, now += 40ms);
    CHECK_TRUE(got.accepted);
    LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(got.state));
    LONGS_EQUAL(static_cast<int>(Reason::kRecovering), static_cast<int>(got.reason));
  }
  CHECK_TRUE(feed(Input::kGood).grip_ok);
}

// Good frames count in a row: a camera that comes and goes stays in FAULT.
TEST(Supervisor, DoesNotRecoverWhileGoodAndBadFramesTakeTurns) {
  bring(DeviceState::kOk);
  (void)feed(Input::kRejected, 151ms);
  for (int k = 0; k < 50; ++k) {
    LONGS_EQUAL(static_cast<int>(DeviceState::kFault),
                static_cast<int>(feed(k % 3 == 2 ? Input::kRejected : Input::kGood).state));
  }
}

TEST(Supervisor, WaitsForArmWhenLatched) {
  config.latch = true;
  bring(DeviceState::kOk);  // what was never well needs no ARM
  supervisor::arm(state);   // before the fault: means nothing
  (void)feed(Input::kGone);
  for (int k = 0; k < 20; ++k) {
    const supervisor::Outputs got = feed(Input::kGood);
    LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(got.state));
    LONGS_EQUAL(static_cast<int>(Reason::kNeedsArm), static_cast<int>(got.reason));
  }
  supervisor::arm(state);
  CHECK_TRUE(feed(Input::kGood).grip_ok);
  (void)feed(Input::kGone);
  for (int k = 0; k < 5; ++k) CHECK_FALSE(feed(Input::kGood).grip_ok);
}

// A device beside the camera: FAULT with its reason while it lasts, and at once when it fails between frames.
TEST(Supervisor, FaultsWithTheDevicesBesideTheCamera) {
  bring(DeviceState::kOk);
  supervisor::fail(state, Reason::kGripperSilent);
  LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(state.device));
  LONGS_EQUAL(static_cast<int>(Reason::kGripperSilent), static_cast<int>(state.reason));
  for (int k = 0; k < 5; ++k) {
    now += 40ms;
    const supervisor::Outputs got = supervisor::update(state, config, result_of(Input::kGood), now,
                                                       inputs_of(supervisor::Source::kGripper, Reason::kGripperSilent));
    CHECK_TRUE(got.accepted && !got.grip_ok);
    LONGS_EQUAL(static_cast<int>(Reason::kGripperSilent), static_cast<int>(got.reason));
  }
  CHECK_FALSE(feed(Input::kGood).grip_ok);
  CHECK_FALSE(feed(Input::kGood).grip_ok);
  CHECK_TRUE(feed(Input::kGood).grip_ok);
}

TEST(Supervisor, SaysWhatStrainsIt) {
  using S = supervisor::Source;
  struct Case {
    supervisor::Inputs inputs;
    Input input;
    DeviceState state;
    Reason reason;
  };
  supervisor::Inputs lost = inputs_of(S::kStream, Reason::kDeadline);
  lost.of(S::kGripper) = Reason::kGripperLost;
  for (const Case& c :
       {Case{inputs_of(S::kStream, Reason::kFrameRate), Input::kGood, DeviceState::kDegraded, Reason::kFrameRate},
        {inputs_of(S::kGripperHeat, Reason::kGripperHot), Input::kGood, DeviceState::kDegraded, Reason::kGripperHot},
        {inputs_of(S::kStream, Reason::kDeadline), Input::kSlip, DeviceState::kSlip, Reason::kSlipDetected},
        {{.opening = true}, Input::kGood, DeviceState::kOk, Reason::kOpening},
        {{.force_limit = true}, Input::kSlip, DeviceState::kSlip, Reason::kForceLimit},
        {{.force_limit = true}, Input::kGood, DeviceState::kOk, Reason::kNone},
        {inputs_of(S::kSettings, Reason::kConfig), Input::kGood, DeviceState::kFault, Reason::kConfig},
        {lost, Input::kSlip, DeviceState::kFault, Reason::kGripperLost}}) {
    bring(DeviceState::kOk);
    now += 40ms;
    const supervisor::Outputs got = supervisor::update(state, config, result_of(c.input), now, c.inputs);
    LONGS_EQUAL(static_cast<int>(c.state), static_cast<int>(got.state));
    LONGS_EQUAL(static_cast<int>(c.reason), static_cast<int>(got.reason));
    CHECK_EQUAL(c.input == Input::kSlip, got.slip);
    CHECK_EQUAL(c.state == DeviceState::kOk, got.grip_ok);
  }
}

// What fell is told for 200 ms, or until something touches again; not what the gripper says it lets go of.
TEST(Supervisor, TellsALostContactForAWhile) {
  pipeline::Result lost = result_of(Input::kGood);
  lost.contact = {.judged = true, .event = contact::Event::kLost};
  pipeline::Result gone = lost;
  gone.contact.event = contact::Event::kNone;
  pipeline::Result touched = gone;
  touched.contact.touching = true;
  const auto reason_of = [&](const pipeline::Result& result, const supervisor::Inputs& inputs = {}) {
    now += 40ms;
    const supervisor::Outputs got = supervisor::update(state, config, result, now, inputs);
    CHECK_EQUAL(got.reason == Reason::kContactLost, got.state == DeviceState::kSlip);
    return got.reason;
  };
  bring(DeviceState::kOk);
  CHECK_TRUE(reason_of(lost) == Reason::kContactLost);
  for (int k = 1; k < 5; ++k) CHECK_TRUE(reason_of(gone) == Reason::kContactLost);
  CHECK_TRUE(reason_of(gone) == Reason::kNone);
  CHECK_TRUE(reason_of(lost) == Reason::kContactLost);
  CHECK_TRUE(reason_of(touched) == Reason::kNone);
  CHECK_TRUE(reason_of(lost, {.opening = true}) == Reason::kOpening);
  lost.contact.event = contact::Event::kReleased;
  bring(DeviceState::kOk);
  CHECK_TRUE(reason_of(lost) == Reason::kNone);
}

// A clock that steps back breaks its contract: nothing is confirmed until it has caught up or frames come again.
TEST(Supervisor, TakesAClockThatStepsBackForSilence) {
  bring(DeviceState::kOk);
  now -= 10s;
  LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(feed(Input::kRejected).state));
}

TEST(Supervisor, TellsALostContactNoLongerAfterTheClockStepsBack) {
  pipeline::Result lost = result_of(Input::kGood);
  lost.contact = {.judged = true, .event = contact::Event::kLost};
  bring(DeviceState::kOk);
  (void)supervisor::update(state, config, lost, now);
  now -= 1h;
  for (int k = 0; k < 10; ++k) (void)feed(Input::kGood);
  LONGS_EQUAL(static_cast<int>(DeviceState::kOk), static_cast<int>(state.device));
}

// 3 of the last 10 are dropped frames as they happen; 4 are a cable.
TEST(Supervisor, DegradesWhenMoreThanThreeOfTenAreRejected) {
  bring(DeviceState::kOk);
  for (int bad = 1; bad <= 4; ++bad) {
    (void)feed(Input::kRejected, 30ms);
    LONGS_EQUAL(static_cast<int>(bad <= 3 ? DeviceState::kOk : DeviceState::kDegraded),
                static_cast<int>(feed(Input::kGood, 30ms).state));
  }
  LONGS_EQUAL(static_cast<int>(Reason::kManyRejected), static_cast<int>(state.reason));
  for (int k = 0; k < 10; ++k) (void)feed(Input::kGood);
  LONGS_EQUAL(static_cast<int>(DeviceState::kOk), static_cast<int>(state.device));
}

// Every second frame bad, at 25 fps: never 150 ms without a good one, so no fault, but nothing to confirm; ALIVE
// shows the good ones.
TEST(Supervisor, DegradesWithEverySecondFrameRejected) {
  bring(DeviceState::kOk);
  for (int k = 0; k < 100; ++k) {
    const supervisor::Outputs got = feed(k % 2 == 0 ? Input::kRejected : Input::kGood);
    LONGS_EQUAL(static_cast<int>(k < 7 ? DeviceState::kOk : DeviceState::kDegraded), static_cast<int>(got.state));
    CHECK_EQUAL(k % 2 == 1, got.accepted);
  }
}

// A rejected frame keeps the request of the frame before: a slip goes on being told.
TEST(Supervisor, KeepsTellingASlipOverRejectedFrames) {
  bring(DeviceState::kSlip);
  pipeline::Result bad = result_of(Input::kRejected);
  bad.request = GripRequest::kTighten;
  const supervisor::Outputs got = supervisor::update(state, config, bad, now + 40ms);
  CHECK_TRUE(got.slip);
  CHECK_FALSE(got.grip_ok);
  CHECK_FALSE(got.accepted);
  LONGS_EQUAL(static_cast<int>(DeviceState::kSlip), static_cast<int>(got.state));
}

// 87 % of 63 is 54.8: 55 is enough, 54 is not. 87 % of 80 is 69.6.
TEST(Supervisor, DegradesBelowItsShareOfMarkers) {
  struct Case {
    GridSize grid;
    int markers;
    bool ok;
  };
  for (const Case& c : {Case{kGrid, 63, true},
                        {kGrid, 55, true},
                        {kGrid, 54, false},
                        {kGrid, 0, false},
                        {{8, 10}, 70, true},
                        {{8, 10}, 69, false},
                        {{10, 10}, 87, true},
                        {{10, 10}, 86, false},
                        {{8, 16}, 128, true},
                        {{8, 16}, 111, false}}) {
    pipeline::Result result = result_of(Input::kGood);
    result.grid = c.grid;
    result.features.markers = c.markers;
    state = {};
    LONGS_EQUAL(static_cast<int>(c.ok ? DeviceState::kOk : DeviceState::kDegraded),
                static_cast<int>(supervisor::update(state, config, result, now).state));
  }
}

// All words of four inputs: GRIP_OK is HIGH in OK only, and ALIVE is told to move with accepted frames only.
TEST(Supervisor, KeepsItsPromisesOverEverySequenceOfFour) {
  constexpr std::array<Input, 8> kInputs{Input::kLearning, Input::kGood,       Input::kAfterGap, Input::kSlip,
                                         Input::kFew,      Input::kSlipAndFew, Input::kRejected, Input::kGone};
  for (std::size_t word = 0; word < 8 * 8 * 8 * 8; ++word) {
    state = {};
    std::size_t rest = word;
    bool fine = false;   // the last accepted frame was plainly fine, and the camera is there
    bool fault = false;  // a fault after the first good frame: four inputs hold no recovery from it
    bool any = false;
    Micros accepted_at{};
    for (int k = 0; k < 4; ++k, rest /= 8) {
      const Input input = kInputs[rest % 8];
      const bool accepted = input != Input::kRejected && input != Input::kGone;
      const supervisor::Outputs got = feed(input, 90ms);
      CHECK_EQUAL(accepted, got.accepted);
      CHECK_EQUAL(got.state == DeviceState::kOk, got.grip_ok);
      if (accepted || input == Input::kGone) fine = input == Input::kGood || input == Input::kAfterGap;
      if (accepted && !any) {
        accepted_at = now;
        any = true;
      }
      const bool late = any && now - accepted_at > 150ms;
      if (any && (input == Input::kGone || late)) fault = true;
      if (accepted) accepted_at = now;
      const int good = state.good_frames;
      const bool recovered = !fault || good >= 3;
      CHECK_EQUAL(fine && recovered && now - accepted_at <= 150ms, got.grip_ok);
    }
  }
}

// Every row of the table decides in some input: none is dead, and the last one always applies.
TEST(Supervisor, HasNoRuleThatNeverApplies) {
  CHECK_TRUE(supervisor::kRules.back().seen == &supervisor::Findings::always);
  for (const supervisor::Rule& rule : supervisor::kRules) {
    supervisor::State fresh;
    fresh.device = rule.only_in_fault ? DeviceState::kFault : DeviceState::kSlip;
    supervisor::Findings seen;
    seen.*rule.seen = true;
    supervisor::detail::follow_rules(fresh, seen, Reason::kNoFrame, Reason::kGripperSilent, Reason::kDeadline);
    const Reason want = rule.why == supervisor::Why::kRow         ? rule.reason
                        : rule.why == supervisor::Why::kRejection ? Reason::kNoFrame
                        : rule.why == supervisor::Why::kFault     ? Reason::kGripperSilent
                                                                  : Reason::kDeadline;
    LONGS_EQUAL(static_cast<int>(want), static_cast<int>(fresh.reason));
    LONGS_EQUAL(static_cast<int>(rule.stays ? DeviceState::kSlip : rule.to), static_cast<int>(fresh.device));
  }
}
