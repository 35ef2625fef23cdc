// SPDX-License-Identifier: Apache-2.0
// How far the object's imprint moves against the gel: the part of slip that the markers cannot see.
//
// The dots ride on the gel; once the contact slides steadily they stand still. Between them the camera sees the relief
// of the object pressed into the gel. In a firm grip that picture moves with the gel; in slip it changes against it.
// What works is residual energy, not estimated motion: how much of the picture on the gel changed, over its gradient
// energy, and always against the noise of the same two pictures.
//
//   patch   = a quarter of a pitch cell beside each dot, fixed to the gel: it moves and stretches with the displacement
//             of the four dots around it. Sampled 16 times a pitch (0.126 mm), whatever the scale of the picture, at
//             the n places that no dot's rim can reach
//   c       = patch - the same patch on the empty gel
//   G       = mean square of the differences of c between neighbours along a, and along b, added: |grad c|^2
//   g       = mean of G now and one lag ago
//   R       = mean square of r about its mean, r = patch now - patch one lag ago
//   q       = 75th percentile of R over the 40 % of the patches with the least g: what changed where nothing is pressed
//             in. Noise of the sensor, of the light and of compression, in these two pictures
//             Where the mean g of these 40 % makes a contact, the object covers the gel, and what changes there is no
//             noise: then q is at most four times what white noise with the G of the empty gel makes of R (G / 2), and
//             so is the noise of V (G / 4)
//   motion  = step sqrt(sum g (R - q) / (sum g^2 + 0.2 N)), over all N patches that both pictures show. A small shift d
//             of a relief c makes r = d grad c, so this is the length of d where c varies along d only, and 0.71 of it
//             where c has no direction. Waves longer than a patch (1 mm) count for less, since their change is constant
//             over it and could be light; it saturates when d comes near half of a wave
//   fading  = sum g (V' - V) / sum g |V' - V|, at least 0; V and V' as below. 1 where all patches fade, 0 where a
//             relief leaves one patch for another. Where a patch fades, R - q loses 3/4 fading (sqrt(V') - sqrt(V))^2,
//             at most what it has: a grip that is eased makes a relief weaker where it is
//   growth  = log2 of sum s^2 + N now over one lag ago; s = mean of c over the patch, less its mean over the patches of
//             q. While a contact is made its shading grows, which changes the picture as a motion does; a slip moves
//             the shading or takes it away. Where the object covers the gel, half of log2 of sum G^2 + 0.2 N instead:
//             there a relief that slides by shades each patch anew, and is as strong as before
//   turnover = 1 - sum w C / sum w sqrt(V V') - 0.5 / mm * way; the share of the relief that another has taken the
//             place of. C = mean of c c' about their means, now and one lag ago; V, V' = mean square of each, less its
//             noise; w = the lesser G of both; way = of the gel meanwhile, mean of its markers. What grows, fades or
//             is lit otherwise where it is keeps C = sqrt(V V'); what has gone by half of its wave has none. Says
//             nothing of how far it went; but where motion saturates, or the relief is so weak that its energy says
//             little, it still says that it went. 0 where the mean of sqrt(V V') is below 0.2 levels^2, or the mean of
//             G^2 exceeds that of the empty gel's noise by less than 0.05 levels^4 in either picture
//   coarse  = motion of the patches' means (coarse.hpp), where the mean of g is below 0.35 levels^2 and motion tells
//             little
// carried = half of the way that the gel went meanwhile, mean of its markers. Light is fixed to the camera, and patches
//             are followed between dots only: what the gel carries along changes a little, more the further it goes.
//             Both motions lose its square: sqrt(motion^2 - carried^2)
// motion is 0 (Log2Q8 of 1 um or less) without a picture that long ago, and unless the mean of G^2 exceeds that of
// the empty gel's noise by 0.1 levels^4 in both pictures.
//
// Where the constants come from: 40 % and the 75th percentile were fixed before any recording was looked at (median and
// mean do worse). 0.2 levels^2 is what a codec's noise shows as relief; the lag of 0.16 s and the floor were chosen on
// 200 recordings of 17 objects (toolchain/learn/fuse.hpp has the thresholds, and what they are worth on objects that
// did not choose them). Half of the way: on the recordings and on simulated grasps of seed 7 (2026-11-26) anything from
// 0.4 to 0.6 of it takes two thirds of the alarms of smooth objects (33 in 60 grasps to 11 or 12), all of bonded ones
// that are shaken, and a tenth of all alarms of recorded trials, for one recorded onset of 82. The way of each patch by
// itself takes too much: where an object slides the gel bends.
//
// Turnover: the noise of V is half of the median of V + V' over the patches of q; 0.2 levels^2 and the allowance for
// the way were chosen on simulated slides and shaking of seed 7 and on the recordings (2026-11-27), 0.05 levels^4 on
// them and on the recordings made JPEG once more (ffmpeg -q:v 5, quality 82 at 320x240): of these it leaves 1 of 12
// alarms on the empty gel and 87 of 159 in whole trials, and changes no recorded onset, no slide and one turn of 240.
// 0.07 leaves 67 of 159, and misses a slide of 120 (2026-11-29).
//
// An object that covers the gel: of 48 slides of ridged faces (pitch 0.8 mm, 30 and 60 um, radius 8, 12 and 16 mm, 5 to
// 50 mm/s) by somebody else all are raised within 4 frames. Before, those of 8 mm were, two of the others never and the
// rest after 4 to 63. Four times was set before anything was looked at. Of 250 held, shaken, pressed and eased grasps
// of such faces 6 alarm, all eased, instead of 9; of the decision on 200 recordings one alarm in a whole trial goes and
// nothing else changes (2026-11-29).
//
// Fading: of 36 bonded spheres with a relief whose grip is eased from 4 or 5 to 1 N in 0.3 or 0.4 s, slip is raised in
// 4 instead of 14. Chosen on these, on simulated grasps of seed 7 and on the recordings: with what follows, alarms in
// whole trials fall from 52 to 50, at load steps from 58 to 49, at touches from 8 to 7; onsets within 5 frames from 78
// to 76 of 82, within 10 they stay at 81. All of it instead of 3/4 leaves 6 touches, but raises slip on an empty gel;
// with all of what grows as well one onset less is detected within 10 frames (2026-11-28).
//
// A relief that repeats itself, as ridges and threads do, looks the same once it has gone by its own pitch: of 1.2 mm
// at 7.5 mm/s, within the lag. What begins to slide passes shorter ways first and is raised. While slip is raised a
// frame is compared with the next later kept picture as well, and the greater of both motions, coarse motions and
// turnovers counts: of 120 ms ago at 25 frames a second, of 67 or 100 at 30. Below 9.4 frames a second there is none.
// What goes by its pitch from one picture to the next looks as if it stood still.
//
// Limits. Slower than about 0.05 mm in the lag is not known from noise. A worn gel looks like a relief that never
// slips. Exposure and white balance of the camera must stand still.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "tactile/types.hpp"
#include "vision/luma.hpp"

namespace holdfast::imprint {

struct Config {
  std::int32_t pitch_um = 2020;  // as displacement::Config
  // A patch is in contact when its mean G exceeds this, and `over_noise` times what the empty gel shows. Levels^2 in
  // Q8. Sharp, on the recordings: at 0.43 a quarter of the frames of an empty gel hold five such patches, at 0.5 one in
  // fifty, and at 0.6 a third of the held ones no longer do.
  std::int32_t contact_floor_q8 = 120;      // 0.47
  std::int32_t contact_over_noise_q4 = 48;  // 3.0
  // A patch whose empty gel shows more gradient energy than this is left out: a dot printed beside another, a scratch,
  // dirt. Levels^2. A clean gel's patches have 1 to 1.5 on the recordings, 1 to 3 in a hundred more than this.
  std::int32_t most_print = 8;
  // A picture counts when its age is within a third of the lag: from 2/3 to 4/3 there is a multiple of every frame
  // period up to 213 ms, and the nearest counts. Models' thresholds hold for the lag that they were made with. Range:
  // 40 to 180 ms, of which a third more is kept.
  Micros lag{160'000};
};

// Fewer patches that both pictures show say nothing: their noise is not known.
inline constexpr int kLeastPatches = 20;

inline constexpr int kStepsPerPitch = 16;         // samples from dot to dot
inline constexpr int kSide = kStepsPerPitch / 2;  // samples along a patch's side
inline constexpr int kPatchesPerDot = 4;          // towards (+x, +y), (-x, +y), (+x, -y), (-x, -y)
inline constexpr int kMaxPrintedDots = 80;        // the largest printed grid sold; of a larger one every second dot
inline constexpr int kMaxPatches = kPatchesPerDot * kMaxPrintedDots;
static_assert(2 * kMaxPrintedDots >= kMaxMarkers);
inline constexpr int kMaskRadius_steps = 7;  // dot, its rim, what interpolation reaches: 0.44 pitch

// Which samples of a patch are used. Place (a, b): (a + 1/2, b + 1/2) steps from the dot, away from it along both axes.
// Range: a and b are not negative.
[[nodiscard]] constexpr bool is_free(int a, int b) {
  const int x = 2 * a + 1, y = 2 * b + 1;
  return a < kSide && b < kSide && x * x + y * y >= 4 * kMaskRadius_steps * kMaskRadius_steps;
}

inline constexpr int kFree = [] {
  int n = 0;
  for (int b = 0; b < kSide; ++b) {
    for (int a = 0; a < kSide; ++a) n += is_free(a, b) ? 1 : 0;
  }
  return n;
}();
// Of neighbours along a that are both free; along b there are as many.
inline constexpr int kPairs = [] {
  int n = 0;
  for (int b = 0; b < kSide; ++b) {
    for (int a = 0; a + 1 < kSide; ++a) n += is_free(a, b) && is_free(a + 1, b) ? 1 : 0;
  }
  return n;
}();
static_assert(kFree == 25 && kPairs == 17);

// The picture on the gel, reduced to 11 to 23 pixels a pitch and smoothed: 16 x luma, 12 bits. Only the part that the
// lattice can reach, of which each frame renews what its patches reach.
inline constexpr std::int32_t kMaxReducedPixels = 64'000;
inline constexpr int kMaxReduction_log2 = 4;
inline constexpr int kLanes = 8;   // of a vector of 16 bits
inline constexpr int kStrip = 56;  // reduced at once

struct Reduced {
  std::int32_t reduction_log2 = 0;  // pixels of the working picture to one of these: 1, 2, 4, 8, 16
  std::int32_t left = 0, top = 0;   // of the working picture, in reduced pixels
  std::int32_t width = 0, height = 0;
  std::array<std::uint16_t, kMaxReducedPixels + kStrip> pixels{};  // and where the last row's strip ends
};

using Samples = std::array<std::int16_t, kFree>;  // 16 x luma, in the order of b, then a

// Eight patches side by side, so that compilers make vectors of what is done to the same sample of each: sample i of
// patch p is [p / kLanes][i * kLanes + p % kLanes].
inline constexpr int kEights = kMaxPatches / kLanes;
static_assert(kMaxPatches % kLanes == 0 && kLanes % kPatchesPerDot == 0);
template <typename Value>
using Lanes = std::array<Value, kLanes>;
template <typename Value>
using Eight = std::array<Value, std::size_t{kFree} * kLanes>;

// Along one axis of the picture, in 1/4096 reduced pixels from the centre of the top left one: their samples (0, 0),
// and the steps from sample to sample away from the dot.
struct Axis {
  Lanes<std::int32_t> first_q12{}, a_q12{}, b_q12{};
};

// The dot of a patch, and its neighbours towards the patch; at the lattice's edge the dot itself.
struct Corner {
  std::uint8_t own = 0, beside = 0, over = 0, across = 0;
};

// Where they lie on the empty gel.
struct Layout {
  Axis x, y;
  Lanes<std::int32_t> usable{};  // -1: all of its dots have a rest position, and the picture shows it
  Lanes<Corner> corner{};
  Lanes<std::int16_t> column{}, row{};  // from the lattice's middle, quarters of a pitch
};

struct PatchSamples {
  std::array<Eight<std::int16_t>, kEights> eights{};
  [[nodiscard]] constexpr Samples operator[](std::size_t patch) const {
    Samples samples{};
    for (std::size_t i = 0; i < kFree; ++i) samples[i] = eights[patch / kLanes][i * kLanes + patch % kLanes];
    return samples;
  }
};

// kPairs * G of a patch.
inline constexpr std::int64_t kMostRelief = std::int64_t{2} * kPairs * 8160 * 8160;

// What later pictures are compared with.
struct Kept {
  Micros at{};
  std::int32_t carried_x_q12 = 0, carried_y_q12 = 0;  // mean displacement of the markers, 1/4096 step
  std::array<bool, kMaxPatches> seen{};
  std::array<std::uint32_t, kMaxPatches> relief{};             // kPairs * G; at most kMostRelief, 2.3e9
  std::array<std::int32_t, kMaxPatches> shading{};             // kFree * mean of c, 1/16 level; below 2^17
  std::array<std::int32_t, kMaxPatches> slope_a{}, slope_b{};  // of c away from the dot, 1/800 level a step; below 2^18
  std::array<std::int32_t, kMaxPatches> variance{};            // of c about its mean, 1/625 level^2; at most 2^25.4
  PatchSamples samples{};
};

// At most so many frames in a row are blind: a stream that never has a picture of the right age has no gap. Behind one
// gap there are 3 at 25 frames a second and 7 at 60; those of gaps that follow each other add up.
inline constexpr int kMostBlind = 32;

inline constexpr Micros kKeepEvery{35'000};
inline constexpr int kKept = 7;        // times 35 ms: reaches back a lag of 180 ms and a third at any frame rate
inline constexpr int kEmptyMean = 64;  // frames that the learned empty gel is a mean of, in the long run
inline constexpr int kNoiseAfter = 8;  // frames on the empty gel before its noise counts as known

// What was learned of the empty gel: all that a restarted process needs to go on (store/checkpoint.hpp).
struct Empty {
  std::array<Eight<std::uint16_t>, kEights> samples_q4{};  // of the patches, in Q4
  std::array<bool, kMaxPatches> learned{};                 // the patch was seen on the empty gel
  std::array<bool, kMaxPatches> marked{};                  // and shows too much there
  int frames = 0;
  std::int64_t noise_relief = 0;  // kPairs * G of a patch of the empty gel
};

struct State {
  bool placed = false;                 // frames stand for the rest position that is in force
  std::int32_t width = 0, height = 0;  // of the picture that they were laid out for
  Reduced picture;
  std::array<Layout, kEights> layout{};
  Empty empty;
  std::array<Kept, kKept> kept{};  // a ring
  int count = 0;
  int newest = 0;
  int blind = kMostBlind;                   // blind frames since the last one that was compared
  Kept last;                                // the frame seen last, whether it is kept or not
  std::array<bool, kMaxPatches> in_view{};  // there: also patches that are marked, or whose empty gel is not known
};

// Forgets everything, the empty gel as well.
void forget(State& state);

// The rest position has changed, the gel has not: the patches are laid out anew with the next frame.
inline void place_again(State& state) {
  state.placed = false;
}

// One frame. `rest`: the learned rest position; `markers`: now; both in pixels of `picture`. Without an empty gel
// (learn_empty) nothing is ever in contact; until kNoiseAfter frames of it were learned, contact takes twice the
// relief. `raised`: slip is, and may be going on. Cost: see ARCHITECTURE.md, "instructions".
[[nodiscard]] ImprintFeatures update(State& state, const Config& config, const LumaView& picture,
                                     const MarkerField& markers, const MarkerField& rest, PixelsQ8 pitch, Micros now,
                                     Saturations& saturations, bool raised = false);

// Nothing touches the gel in the frame that update() saw last: it goes into the mean of the empty gel and its noise.
// Called after the frame has been searched for a contact, so that no touch is learned as the empty gel.
void learn_empty(State& state, const Config& config);

// Inside it: where the same sample of eight patches lies, all of their samples, and the four pixels around one of them,
// the upper two first.
struct Spot {
  Lanes<std::int32_t> x_q12, y_q12;  // reduced pixels
  Lanes<std::int32_t> bytes;         // from the picture's first to the upper left of the four
};
using Spots = std::array<Spot, kFree>;
using Square = std::array<std::uint16_t, 4>;
using Squares = std::array<Square, std::tuple_size_v<Eight<std::int16_t>>>;

// Between pixels in 1/256: coarser steps show at the dots' rims as relief. blend() is vector code, the same integers as
// blend_scalar(). Range: pixels of 12 bits times 2^16 stay below 2^28.
void blend(const Squares& squares, const Spots& spots, Eight<std::int16_t>& out);
void blend_scalar(const Squares& squares, const Spots& spots, Eight<std::int16_t>& out);

}  // namespace holdfast::imprint
