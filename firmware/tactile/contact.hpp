// SPDX-License-Identifier: Apache-2.0
// Whether anything touches the gel: from the relief in the picture between the dots (imprint.hpp), and from dots that
// left their rest position. Slip is never raised without contact, and losing it is an event of its own.
//
// Two detectors, because each misses a class of objects: a smooth flat object presses no relief, a light one moves no
// dot. Either is enough to begin, neither may see it for the contact to end, and for longer: at the end of a grip the
// gel creeps back. The dots alone cannot tell: on the recordings the third largest displacement of the empty gel is
// below 35 um in 99 of 100 frames, but below 70 in half of the held ones and below 42 in one of twenty that slip. So
// there is a gate only where there is a picture.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>

#include "base/math.hpp"
#include "tactile/types.hpp"

namespace holdfast::contact {

struct Config {
  std::int32_t begin_patches = 5;
  std::int32_t end_patches = 3;  // fewer
  // Only what was so large, or moved the dots by begin_um, can be lost. The relief that a grip leaves in the gel creeps
  // back for seconds and may begin a contact: on 200 recordings 17 of those ended as a loss on a gel that is labelled
  // empty, 13 of them never this large. Of the other 254 losses 26 never were: ends of an earlier grip in the first six
  // frames of a clip, and contacts behind the one that was held or in clips that never show the empty gel (2026-11-29).
  std::int32_t firm_patches = 10;
  std::int32_t begin_um = 80;  // third largest displacement
  std::int32_t end_um = 60;
  Micros begin_after{40'000};   // so long one of the detectors must have seen it,
  Micros end_after{120'000};    // so long neither
  Micros empty_after{500'000};  // and so long before the gel is taken for empty
};

// Released: the contact ended while the gripper said that it was opening, which is what it was meant to do. Faded: it
// never was firm, and says nothing of an object.
enum class Event : std::uint8_t { kNone, kTouched, kLost, kReleased, kFaded };

struct State {
  bool touching = false;
  bool known = false;     // a frame came before
  Micros since{};         // they have agreed with `detected` since then
  bool detected = false;  // by either detector, in the last frame
  bool firm = false;      // this contact was too large for what a grip leaves behind
  bool empty = false;     // nothing has touched the gel for so long that its picture may be learned
};

struct Contact {
  bool judged = false;  // false: no picture between the dots, and nobody can tell
  bool touching = false;
  Event event = Event::kNone;
};

// For people: a contact that grows is one that is being made.
enum class Phase : std::uint8_t { kEmpty = 0, kTouching = 1, kHeld = 2 };
inline constexpr std::array<std::string_view, 3> kPhaseNames{"EMPTY", "TOUCHING", "HELD"};

// Growth in the imprint's lag that is more than noise: an eighth of an octave, as the compiled model has it.
inline constexpr std::int32_t kGrows_q8 = 31;

[[nodiscard]] constexpr Phase phase_of(const Contact& contact, Log2Q8 growth) {
  if (!contact.touching) return Phase::kEmpty;
  return growth.raw() > kGrows_q8 ? Phase::kTouching : Phase::kHeld;
}

inline void forget(State& state) {
  state = {};
}

// Three markers lie further than this from their rest position: two strays do not make a contact. Looks from the middle
// of the lattice on, where objects are. Range: 2 * 65535^2 fits int64.
[[nodiscard]] inline bool displaced(const DisplacementField& field, std::int32_t um) {
  const std::int32_t count = field.grid.count();
  std::int32_t wanted = 3;
  for (std::int32_t k = 0, i = count / 2; k < count && wanted > 0; ++k, i = i + 1 == count ? 0 : i + 1) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    wanted -= d.valid && square(d.dx.raw()) + square(d.dy.raw()) > square(um) ? 1 : 0;
  }
  return wanted == 0;
}

// `patches`: ImprintFeatures::patches; `opening`: the gripper says that it is. What the first frame says counts as
// having lasted: a gripper that holds something when the sensor starts is in contact at once.
[[nodiscard]] inline Contact update(State& state, const Config& config, const DisplacementField& field, Count patches,
                                    bool opening, Micros now) {
  const bool detected = state.touching ? patches.raw() >= config.end_patches || displaced(field, config.end_um)
                                       : patches.raw() >= config.begin_patches || displaced(field, config.begin_um);
  Contact out;
  if (!state.known || detected != state.detected) {
    state.since = state.known ? now : now - config.empty_after;
    state.known = true;
    state.detected = detected;
  }
  state.since = std::min(state.since, now);  // where the clock stepped back
  state.firm = state.firm || patches.raw() >= config.firm_patches || displaced(field, config.begin_um);
  const Micros lasted = now - state.since;
  if (detected && !state.touching && lasted >= config.begin_after) {
    state.touching = true;
    out.event = Event::kTouched;
  } else if (!detected && state.touching && lasted >= config.end_after) {
    state.touching = false;
    state.since = now;
    out.event = opening ? Event::kReleased : state.firm ? Event::kLost : Event::kFaded;
  }
  if (!state.touching && !detected) state.firm = false;
  out.judged = true;
  out.touching = state.touching;
  state.empty = !state.touching && !detected && lasted >= config.empty_after;
  return out;
}

}  // namespace holdfast::contact
