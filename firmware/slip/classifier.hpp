// SPDX-License-Identifier: Apache-2.0
// One frame's features to one verdict, by the compiled tree or by a loaded one of any feature set.
//
// There is no "unknown": on the first frame and after a gap (rates_valid = false) the tree sees rates of 0
// and judges by the features that stand on this frame only. A gripper that slides
// already when the sensor starts is thus reported with the first frame. Whether a frame may be confirmed at
// all is the supervisor's question. Range: any features. The tree compares and does no arithmetic: nothing
// can overflow.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "base/math.hpp"
#include "base/units.hpp"
#include "slip/model.hpp"
#include "slip/slip_tree.gen.hpp"
#include "slip/tree_io.hpp"
#include "tactile/contact.hpp"
#include "tactile/imprint.hpp"

namespace holdfast::classifier {

inline constexpr const FeatureSet& kCompiledSet = *find_feature_set(slip_tree::kFeatureSet);
inline constexpr auto kMembers = kCompiledSet.members;
using Inputs = std::array<std::int32_t, static_cast<std::size_t>(kCompiledSet.size())>;

[[nodiscard]] constexpr std::int32_t input(const FeatureInfo& feature, const Features& features) {
  return features.rates_valid || !feature.needs_earlier_frame ? feature.read(features) : 0;
}

// Spelled as a pack, not as a loop: only then does gcc 12 see through the table's readers and leave the
// compares alone (at most 12 aarch64 instructions for a tree of depth 3; the loop costs four indirect calls).
[[nodiscard]] constexpr Inputs inputs(const Features& features) {
  return [&]<std::size_t... Index>(std::index_sequence<Index...>) {
    return Inputs{input(kFeatures[kMembers[Index]], features)...};
  }
  (std::make_index_sequence<kMembers.size()>{});
}

// A loaded tree's set is known only now, so here it is the loop: one indirect call per feature. Not inlined, so that
// the compiled tree's few compares need no stack for it.
[[nodiscard, gnu::noinline]] constexpr Verdict classify_loaded(const model::Tree& tree, const Features& features) {
  std::array<std::int32_t, kFeatureCount> x{};
  for (int i = 0; i < tree.set->size(); ++i) x[idx(i)] = input((*tree.set)[i], features);
  return model::evaluate(tree, x);
}

struct Config {
  const model::Tree* loaded = nullptr;  // decides in place of the compiled tree; outlives the pipeline. nullptr: none
};

// Of the model in charge.
[[nodiscard]] constexpr const FeatureSet& set_of(const Config& config) {
  return config.loaded != nullptr ? *config.loaded->set : kCompiledSet;
}

// Whether the model in charge reads something that this stage makes.
[[nodiscard]] constexpr bool needs(const Config& config, Stage stage) {
  return reads(set_of(config), stage);
}

[[nodiscard]] constexpr Verdict classify(const Config& config, const Features& features) {
  return config.loaded != nullptr ? classify_loaded(*config.loaded, features) : slip_tree::evaluate(inputs(features));
}

// A contact that grows is one that is being made, until slip is raised: then the gripper presses harder. Range: a
// third.
[[nodiscard]] constexpr Features while_raised(Features features) {
  features.imprint.growth = Log2Q8::from_raw(features.imprint.growth.raw() / 3);
  return features;
}

// As if everything had moved 2^(by_q8 / 256) times as far; turnover goes by its square, as long as it is small. What
// stands still does so. Range: by_q8 within +-1024.
[[nodiscard]] constexpr Features scaled(Features features, std::int32_t by_q8) {
  for (Log2Q8* const motion : {&features.imprint.motion, &features.imprint.coarse}) {
    if (motion->raw() <= 0) continue;
    *motion = Log2Q8::from_raw(std::clamp(motion->raw() + by_q8, 0, Log2Q8::kMax));
  }
  if (ShareQ10& turnover = features.imprint.turnover; turnover.raw() > 0) {
    const std::int64_t scaled = turnover.raw() * exp2_milli(2 * by_q8) / 1000;
    turnover = ShareQ10::from_raw(static_cast<std::int32_t>(std::min<std::int64_t>(scaled, ShareQ10::kMax)));
  }
  return features;
}

// Not inlined: the compiled tree is there once.
[[nodiscard, gnu::noinline]] constexpr Verdict ask(const Config& config, const Features& features, std::int32_t by_q8) {
  return classify(config, scaled(features, by_q8));
}

// A slip that was raised goes on until the motion is below half of what raises one: the motion of one slide comes and
// goes, and is one request. On 200 recordings that takes 17 of 64 alarms of whole trials and no detection (2026-11-26).
// Nor has it ended where a gap in the stream leaves nothing to compare with: of 240 ms and more, GRIP_OK was HIGH for
// 0.2 to 1.3 s while the object slid on (2026-11-29). `features`: of while_raised().
[[nodiscard]] constexpr bool goes_on(const Config& config, const Features& features) {
  constexpr std::int32_t kHalf_q8 = 256;
  if (features.imprint.blind) return true;
  return ask(config, features, kHalf_q8) != Verdict::kHold;
}

// Pressing harder moves the relief by itself, and the lag still shows a slip that has ended: the grip takes another
// step only for twice the motion. Of 24 simulated pulls of a book 22 end with at most 1.3 times the least force that
// holds, and one is lost; without it 18 do, and none is (seeds 1 to 24, 2026-11-24). `features`: of while_raised().
[[nodiscard]] constexpr Verdict for_a_step(const Config& config, Features features) {
  constexpr std::int32_t kTwice_q8 = 256;
  features.imprint.motion = Log2Q8::from_raw(std::max(features.imprint.motion.raw() - kTwice_q8, 0));
  features.imprint.turnover = ShareQ10::from_raw(features.imprint.turnover.raw() / 4);
  return classify(config, features);
}

inline constexpr std::int32_t kLess_q8 = 160;  // 2^(160 / 256) = 1.54 times

// Long ago, and a difference of times that fits.
inline constexpr Micros kNever{std::numeric_limits<std::int64_t>::min() / 4};

// What judge() knows of the frames before, while the contact lasts.
struct State {
  // Since when every frame would be slip if it had moved 1.54 times as far, and the last such frame.
  Micros since{};
  Micros last = kNever;
  Micros opened = kNever;    // the last frame in which the markers opened or closed
  Micros spread = kNever;    // the last one in which they spread
  Micros growing = kNever;   // the last one in which the shading grew, or the first of all
  bool settled = false;      // it has stopped growing once
  Micros judged = kNever;    // the last frame
  std::int32_t pressed = 0;  // and its motion, log2 um in Q8, if that is of a press
};

// Frames further apart are not in a row: a dropped one at 15 a second leaves 133 ms.
[[nodiscard]] constexpr bool in_a_row(Micros before, Micros now) {
  constexpr Micros kGap{150'000};
  return now >= before && now - before <= kGap;
}

// The markers flow apart more than they flow as one, and along their displacements: what a body does that is pressed
// into the gel. `dilation` alone would move the markers of the 7 x 9 lattice by 0.006 um/s for each ppm/s (RMS): it
// makes at least a third of the flow. A drag beside the lattice's middle opens the markers as well, but first of all
// moves them as one.
// `way` -1: the same the other way round, see closes().
[[nodiscard]] constexpr bool opens(const FieldFeatures& field, int way = 1) {
  constexpr std::int64_t kPpmPerMicrometre = 60;
  constexpr std::int32_t kAlong_q10 = 900;  // a cosine of 0.88
  return way * std::int64_t{field.dilation_rate.raw()} > kPpmPerMicrometre * field.flow_residual.raw() &&
         field.flow_shift.raw() < field.flow_residual.raw() && way * field.flow_along.raw() > kAlong_q10;
}

// They flow together, and back along their displacements: what a body does whose grip is eased. One that begins to slip
// under a load meanwhile lets them back as one as well.
[[nodiscard]] constexpr bool closes(const FieldFeatures& field) {
  return opens(field, -1) && 2 * field.flow_shift.raw() < field.flow_residual.raw();
}

// As opens(), of a body of any shape that is pressed in anywhere: they flow apart. What slides drags them along
// instead.
[[nodiscard]] constexpr bool spreads(const FieldFeatures& field) {
  constexpr std::int64_t kPpmPerMicrometre = 50;
  return field.dilation_rate.raw() > kPpmPerMicrometre * field.flow_residual.raw();
}

// The features of a frame whose shading grows though nothing presses: as if it did not grow. A sharp edge that slides
// onto a patch makes it grow as well. That counts only where it cannot be a contact that is being made: the contact has
// settled once, the markers have not spread within the imprint's lag, and it would be slip by twice the motion and,
// alone, by twice the turnover. Of 90 simulated slides of flat boxes under five reliefs (the spheres of `trials slide`
// of seed 1 replaced) 5 are held back for three frames and more instead of 10; one slide of 7 mm at 100 mm/s was never
// raised. The price: of 400 closings of seeds 7 and 11 one more alarms, of 300 of seed 12, on which nothing was chosen,
// one; of 200 recordings 52 alarms in whole trials instead of 51, and none more in silence or at a touch. Chosen on
// these (2026-11-28); by either alone 5 more alarms, one of them at a touch. Range: any features; the model is asked
// twice at most; where `now` steps back growth is of a press until the clock is past the last spread again.
[[nodiscard]] constexpr Features less_growth_of_a_slide(State& state, const Config& config, const Features& features,
                                                        Micros now, bool raised) {
  constexpr Micros kSettles{80'000};
  constexpr std::int32_t kTwice_q8 = 256;
  if (spreads(features.field)) state.spread = now;
  if (state.growing == kNever || features.imprint.growth.raw() > contact::kGrows_q8) state.growing = now;
  state.settled = state.settled || now - state.growing > kSettles;
  const bool presses = now - state.spread <= imprint::Config{}.lag;
  if (raised || presses || !state.settled || features.imprint.growth.raw() <= 0) return features;
  Features steady = features;
  steady.imprint.growth = {};
  Features by_motion = steady, by_turnover = steady;
  by_motion.imprint.motion = Log2Q8::from_raw(std::max(features.imprint.motion.raw() - kTwice_q8, 0));
  by_motion.imprint.turnover = {};
  by_turnover.imprint.motion = {};
  by_turnover.imprint.turnover = ShareQ10::from_raw(features.imprint.turnover.raw() / 2);
  const bool slides =
      classify(config, by_motion) == Verdict::kSlipNow && classify(config, by_turnover) == Verdict::kSlipNow;
  return slides ? steady : features;
}

// Whether what moved in this frame is of a press: a contact that is made, pressed on or eased moves its relief and its
// markers, and nothing slips. The markers open, or close; or they did within the imprint's lag and stand still now; or
// there would be slip but for the growth of the shading; or that was so in the frame before, and the motion has fallen
// by a sixth since, while the markers move slowly. Chosen on 600 simulated closings of seeds 7 and 8 and on pulls of
// seeds 1 to 60: 3 closings alarm instead of 24, and none of 480 slides before its time instead of 10. Slides, turns
// and onsets of 200 recordings are detected as before, one of 360 slips behind a closing not at all (2026-11-27); what
// it costs in a pull: toolchain/learn/README.md. That they close came later, with the same constants: of 150 eased
// grips of somebody else's bonded bodies 8 alarm instead of 97, of the 60 of `trials easing` 33 instead of 34; 135
// slips under a grip that is eased meanwhile, and all onsets and alarms of 200 recordings, come in the same frame as
// before (2026-11-29). Neighbours of each constant are within one closing of that: 50 to 65, cosines of 0.78 to 0.93,
// 30 to 60 um/s, 200 to 400 um/s, a flow as one of 1 to 1.2 of what departs from it. Once slip is raised, it is the
// gripper that presses: that says nothing. Range: any features; the model is asked once at most.
[[nodiscard]] constexpr bool is_of_a_press(State& state, const Config& config, const Features& features,
                                           Verdict verdict, Micros now) {
  constexpr std::int32_t kSixth_q8 = 64;  // 1 - 2^(-64 / 256) = 0.16
  constexpr std::int32_t kStill_um_s = 60;
  constexpr std::int32_t kSlow_um_s = 300;
  const std::int32_t motion = std::max(features.imprint.motion.raw(), features.imprint.coarse.raw());
  const bool opening = opens(features.field) || closes(features.field);
  if (opening) state.opened = now;
  const bool rests = now >= state.opened && now - state.opened <= imprint::Config{}.lag &&
                     features.field.flow_residual.raw() <= kStill_um_s;
  Features steady = features;
  steady.imprint.growth = Log2Q8::from_raw(std::min(features.imprint.growth.raw(), 0));
  const bool grows = steady.imprint.growth != features.imprint.growth && verdict != Verdict::kSlipNow &&
                     classify(config, steady) == Verdict::kSlipNow;
  const bool falls = in_a_row(state.judged, now) && motion <= state.pressed - kSixth_q8 &&
                     features.field.flow_residual.raw() <= kSlow_um_s;
  const bool pressed = opening || rests || grows || falls;
  state.pressed = pressed ? motion : 0;
  state.judged = now;
  return pressed;
}

// The verdict on a frame of a contact: the model's, but for a press; and slip, too, where nearly so much motion goes on
// in every frame for the imprint's lag. What moves slowly goes on, noise does not. Of 60 simulated turns of seed 7, on
// which it was chosen, that detects 52 instead of 47 in time; closings alarm as often, and of 200 recordings one more
// second slip is detected and one more alarm lies between two labels (2026-11-26). 140 ms are five frames at 25 a
// second, also when their times jitter. `raised`: slip was, before this frame. Range: where `now` steps back, it begins
// anew.
[[nodiscard]] constexpr Verdict judge(State& state, const Config& config, const Features& seen, Micros now,
                                      bool raised = false) {
  constexpr Micros kLong{140'000};
  if (!needs(config, Stage::kImprint)) return classify(config, seen);
  const Features features = less_growth_of_a_slide(state, config, seen, now, raised);
  const Verdict verdict = classify(config, features);
  if (raised) state.pressed = 0;
  const bool pressed = !raised && is_of_a_press(state, config, features, verdict, now);
  if (pressed || (verdict != Verdict::kSlipNow && ask(config, features, kLess_q8) != Verdict::kSlipNow)) {
    state.last = kNever;
    return pressed ? Verdict::kHold : verdict;
  }
  if (!in_a_row(state.last, now)) state.since = now;
  state.last = now;
  return now - state.since >= kLong ? Verdict::kSlipNow : verdict;
}

}  // namespace holdfast::classifier
