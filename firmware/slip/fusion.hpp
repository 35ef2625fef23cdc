// SPDX-License-Identifier: Apache-2.0
// One verdict from the fingers of a hand, which hold the same object from two sides, each with its own camera.
//
// What a finger says is graded by asking the model again with less motion of the imprint (and of its coarse part):
// strong, if it slips even so. Slow motion that lasts (classifier::judge) is slip of its finger. No figure of the model
// is repeated here, so that any model can be in charge. Rules, of fingers in contact whose evidence is young enough:
//   one      what it says, as without the other
//   two      slip, at once, where both slip, or one is strong;
//            or where one slips whose picture shows a relief and the other's shows none: that one cannot see it;
//            slip that needs a second frame (markers) needs the other finger as well
// A slip goes on while it does for all that are heard (classifier::goes_on).
// So one finger's light or a knock at its cable is outvoted by one that can see and sees nothing.
//
// The cameras are not synchronous. A verdict is given with each frame of any finger and the latest of the others, by
// the frames' own times; nothing waits. Range: frames of one finger come in order; those of two fingers in any order.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>

#include "base/math.hpp"
#include "base/units.hpp"
#include "slip/classifier.hpp"
#include "slip/decision.hpp"

namespace holdfast::fusion {

enum class Strength : std::uint8_t { kNone, kSlip, kStrong };
inline constexpr std::array<std::string_view, 3> kStrengthNames{"none", "slip", "strong"};

struct Config {
  int fingers = 1;
  // Octaves of motion in Q8 by which a strong finger is above the model's threshold. Chosen by `holdfast evaluate
  // --recorded ... --pairs` (decisions/0006-two-fingers.md).
  std::int32_t alone_q8 = 160;
  std::int32_t sight_patches = 5;  // from here on a picture shows a relief: contact::Config::begin_patches
  // Older evidence is not heard. A period at 15 frames a second and a fifth.
  Micros oldest{80'000};
  classifier::Config classifier;
  decision::Config decision;
};

// The latest of one finger.
struct Seen {
  bool known = false;  // an accepted frame, and a rest position
  Micros timestamp{};
  bool touching = false;  // and not let go
  bool sees = false;      // its picture shows a relief
  Strength strength = Strength::kNone;
  bool waits = false;    // slips by evidence that needs a second frame
  bool goes_on = false;  // the hand's slip, by this finger
  bool steps = false;    // the hand's slip asks for another step of the grip, by this finger
};

struct State {
  std::array<Seen, kMaxFingers> seen{};
  std::array<classifier::State, kMaxFingers> judging{};
  decision::State decision;
  Micros now = classifier::kNever;  // the latest time that any finger told
};

// Range: any features. The model is asked five times at most. `judging`: of this finger; `raised`: a slip of the hand.
[[nodiscard]] constexpr Seen look(const Config& config, classifier::State& judging, Features features, Micros timestamp,
                                  bool raised = false) {
  if (raised) features = classifier::while_raised(features);
  Seen seen{.known = true, .timestamp = timestamp, .touching = features.contact.raw() != 0};
  seen.sees = features.imprint.patches.raw() >= config.sight_patches;
  if (!seen.touching) {
    judging = {};
    return seen;
  }
  const Verdict plain = classifier::judge(judging, config.classifier, features, timestamp, raised);
  if (plain == Verdict::kSlipNow) {
    const bool strong = classifier::ask(config.classifier, features, -config.alone_q8) == Verdict::kSlipNow;
    seen.strength = strong ? Strength::kStrong : Strength::kSlip;
  }
  seen.waits = plain == Verdict::kSlip;
  seen.goes_on = raised && classifier::goes_on(config.classifier, features);
  seen.steps =
      raised && plain != Verdict::kHold && classifier::for_a_step(config.classifier, features) != Verdict::kHold;
  return seen;
}

// Of one finger in contact that nobody contradicts.
[[nodiscard]] constexpr Verdict verdict_of(const Seen& alone) {
  if (alone.strength >= Strength::kSlip) return Verdict::kSlipNow;
  return alone.waits ? Verdict::kSlip : Verdict::kHold;
}

[[nodiscard]] constexpr Verdict verdict_of(const Seen& a, const Seen& b) {
  const auto raises = [](const Seen& one, const Seen& other) {
    return one.strength == Strength::kStrong || (one.strength == Strength::kSlip && one.sees && !other.sees);
  };
  const bool agree = a.strength != Strength::kNone && b.strength != Strength::kNone;
  if (agree || raises(a, b) || raises(b, a)) return Verdict::kSlipNow;
  const auto speaks = [](const Seen& one) { return one.waits || one.strength != Strength::kNone; };
  return (a.waits && speaks(b)) || (b.waits && speaks(a)) ? Verdict::kSlip : Verdict::kHold;
}

[[nodiscard]] constexpr bool is_heard(const Config& config, const Seen& seen, Micros now) {
  return seen.known && seen.touching && now - seen.timestamp <= config.oldest;
}

struct Result {
  Verdict verdict = Verdict::kHold;
  Verdict step = Verdict::kHold;  // the same, but while slip is raised only where a finger asks for another step
  GripRequest request = GripRequest::kHold;
  int heard = 0;  // fingers in contact with young evidence
};

// The clock stepped back: what was seen before is of no time that can be compared.
inline void restart(State& state) {
  state.seen = {};
  state.now = State{}.now;
}

// A frame of this finger was accepted. `known`: there is a rest position, and `features` refer to it.
// Range: 0 <= finger < config.fingers <= kMaxFingers.
[[nodiscard]] constexpr Result update(State& state, const Config& config, int finger, bool known,
                                      const Features& features, Micros timestamp) {
  classifier::State& judging = state.judging[idx(finger)];
  if (!known) judging = {};
  state.seen[idx(finger)] = known ? look(config, judging, features, timestamp, state.decision.raised) : Seen{};
  state.now = std::max(state.now, timestamp);
  std::array<const Seen*, kMaxFingers> heard{};
  Result out;
  const bool raised = state.decision.raised;
  bool goes_on = true, steps = false;
  for (int i = 0; i < config.fingers; ++i) {
    if (!is_heard(config, state.seen[idx(i)], state.now)) continue;
    heard[idx(out.heard++)] = &state.seen[idx(i)];
    goes_on = goes_on && state.seen[idx(i)].goes_on;
    steps = steps || state.seen[idx(i)].steps;
  }
  if (out.heard == 1) out.verdict = verdict_of(*heard[0]);
  if (out.heard == 2) out.verdict = verdict_of(*heard[0], *heard[1]);
  // Two fingers decide twice a period: so many frames in a row take as long as of one.
  decision::Config decision = config.decision;
  if (out.heard == 2) decision.raise_frames = 2 * decision.raise_frames - 1;
  out.request = decision::update(state.decision, decision, out.verdict, state.now, out.heard > 0 && goes_on);
  out.step = raised && !steps ? Verdict::kHold : out.verdict;
  return out;
}

}  // namespace holdfast::fusion
