// SPDX-License-Identifier: Apache-2.0
// One verdict from the fingers of a hand, which hold the same object from two sides, each with its own camera.
//
// What a finger says is graded by asking the model again with more or less motion of the imprint (and of its coarse
// part): strong, if it slips with less; weak, if it would slip with more. No figure of the model is repeated here, so
// that any model can be in charge. Rules, of fingers in contact whose evidence is young enough:
//   one      what it says, as without the other
//   two      slip, at once, where both are weak at least, or one is strong;
//            or where one slips whose picture shows a relief and the other's shows none: that one cannot see it;
//            slip that needs a second frame (markers) needs the other finger as well
// So one finger's light or a knock at its cable is outvoted by one that can see and sees nothing.
// As compiled, with slip_v5: strong is 160/256 octave above the model's threshold, and no finger is ever weak
// (`together_q8` 0). So two fingers raise together only where each slips by the model's own threshold.
//
// The cameras are not synchronous. A verdict is given with each frame of any finger and the latest of the others, by
// the frames' own times; nothing waits. Range: frames of one finger come in order; those of two fingers in any order.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <string_view>

#include "base/math.hpp"
#include "base/units.hpp"
#include "slip/classifier.hpp"
#include "slip/decision.hpp"

namespace holdfast::fusion {

inline constexpr int kMaxFingers = 2;

enum class Strength : std::uint8_t { kNone, kWeak, kSlip, kStrong };
inline constexpr std::array<std::string_view, 4> kStrengthNames{"none", "weak", "slip", "strong"};

struct Config {
  int fingers = 1;
  // Octaves of motion in Q8 by which a strong finger is above the model's threshold, and by which a weak one is below
  // it; 0: none is weak. Chosen by `holdfast evaluate --recorded ... --pairs` with slip_v5: a weak finger detects no
  // onset earlier there, and alarms.
  std::int32_t alone_q8 = 160;
  std::int32_t together_q8 = 0;
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
  bool waits = false;  // slips by evidence that needs a second frame
};

struct State {
  std::array<Seen, kMaxFingers> seen{};
  decision::State decision;
  Micros now{std::numeric_limits<std::int64_t>::min() / 4};  // the latest time that any finger told
};

// As if everything had moved 2^(by_q8 / 256) times as far. What stands still does so. Range: by_q8 within +-1024.
[[nodiscard]] constexpr Features scaled(Features features, std::int32_t by_q8) {
  for (Log2Q8* const motion : {&features.imprint.motion, &features.imprint.coarse}) {
    if (motion->raw() <= 0) continue;
    *motion = Log2Q8::from_raw(std::clamp(motion->raw() + by_q8, 0, Log2Q8::kMax));
  }
  return features;
}

// Not inlined: the compiled tree is there once.
[[nodiscard, gnu::noinline]] constexpr Verdict ask(const Config& config, const Features& features, std::int32_t by_q8) {
  return classifier::classify(config.classifier, scaled(features, by_q8));
}

// Range: any features. The model is asked twice at most.
[[nodiscard]] constexpr Seen look(const Config& config, const Features& features, Micros timestamp) {
  Seen seen{.known = true, .timestamp = timestamp, .touching = features.contact.raw() != 0};
  seen.sees = features.imprint.patches.raw() >= config.sight_patches;
  if (!seen.touching) return seen;
  const Verdict plain = ask(config, features, 0);
  if (plain == Verdict::kSlipNow) {
    const bool strong = ask(config, features, -config.alone_q8) == Verdict::kSlipNow;
    seen.strength = strong ? Strength::kStrong : Strength::kSlip;
  } else if (config.together_q8 > 0 && ask(config, features, config.together_q8) == Verdict::kSlipNow) {
    seen.strength = Strength::kWeak;
  }
  seen.waits = plain == Verdict::kSlip;
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
  const bool agree = std::min(a.strength, b.strength) >= Strength::kWeak;
  if (agree || raises(a, b) || raises(b, a)) return Verdict::kSlipNow;
  const auto speaks = [](const Seen& one) { return one.waits || one.strength != Strength::kNone; };
  return (a.waits && speaks(b)) || (b.waits && speaks(a)) ? Verdict::kSlip : Verdict::kHold;
}

[[nodiscard]] constexpr bool is_heard(const Config& config, const Seen& seen, Micros now) {
  return seen.known && seen.touching && now - seen.timestamp <= config.oldest;
}

struct Result {
  Verdict verdict = Verdict::kHold;
  GripRequest request = GripRequest::kHold;
  int heard = 0;  // fingers in contact with young evidence
};

// A frame of this finger was accepted. `known`: there is a rest position, and `features` refer to it.
// Range: 0 <= finger < config.fingers <= kMaxFingers.
[[nodiscard]] constexpr Result update(State& state, const Config& config, int finger, bool known,
                                      const Features& features, Micros timestamp) {
  const Features judged = state.decision.raised ? classifier::while_raised(features) : features;
  state.seen[idx(finger)] = known ? look(config, judged, timestamp) : Seen{};
  state.now = std::max(state.now, timestamp);
  std::array<const Seen*, kMaxFingers> heard{};
  Result out;
  for (int i = 0; i < config.fingers; ++i) {
    if (is_heard(config, state.seen[idx(i)], state.now)) heard[idx(out.heard++)] = &state.seen[idx(i)];
  }
  if (out.heard == 1) out.verdict = verdict_of(*heard[0]);
  if (out.heard == 2) out.verdict = verdict_of(*heard[0], *heard[1]);
  // Two fingers decide twice a period: so many frames in a row take as long as of one.
  decision::Config decision = config.decision;
  if (out.heard == 2) decision.raise_frames = 2 * decision.raise_frames - 1;
  out.request = decision::update(state.decision, decision, out.verdict, state.now);
  return out;
}

}  // namespace holdfast::fusion
