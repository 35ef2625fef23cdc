// SPDX-License-Identifier: Apache-2.0
// How far the object's imprint moves against the gel: the part of slip that the markers cannot see.
//
// The dots ride on the gel; once the contact slides steadily they stand still. Between them the camera sees the relief
// of the object pressed into the gel. In a firm grip that picture moves with the gel; in slip it changes against it.
// What works is residual energy, not estimated motion: how much of the picture on the gel changed, over its gradient
// energy. A prototype found 16 of 17 recorded onsets by it at 1.3 false alarms a minute, 9 by least squares.
//
//   patch   = a quarter of a pitch cell beside each dot, fixed to the gel: it moves with the displacement of the dots
//             around it. Sampled 16 times a pitch (0.126 mm), whatever the scale of the picture, at the n places that
//             no dot's rim can reach
//   c       = patch - the same patch on the empty gel
//   G       = mean square of the differences of c between neighbours along a, and along b, added: |grad c|^2.
//             In contact: mean G of now and then above the learned noise
//   R       = mean square of r about its mean, r = patch now - patch one lag ago
//   e       = how far the motion of the patch's four dots since then differs from the patch's own (RMS): where the gel
//             bends, as it does beside a contact, what lies between the dots is not known better than that
//   motion  = sqrt(sum R / sum G) of the patches in contact, in samples, if it exceeds sqrt(sum e^2 G / sum G). A small
//             shift d of a relief c makes r = d grad c, so this is the length of d where c varies along d only, and
//             0.71 of it where c has no direction. Waves longer than a patch (1 mm) count for less, since their change
//             is constant over it and could be light; it saturates when d comes near half of a wave
// Without contact, without relief or without a picture that long ago, motion is 0 (Log2Q8 of 1 um or less).
//
// What e is for: in simulated pictures of strong shear, whose gel bends by up to a millimetre, slip above 110 um was
// told falsely 119 times an hour without it (600 grasps, seed 201) and about 30 times with it (150 of them, so a few
// alarms), for two slides in fifty. On the recordings, which bend less, it changes nothing. To take e^2 off instead of
// comparing left 10 an hour, and no slide of 20 mm/s: the dots of a contact that wanders over the gel disagree for
// long. What is left are mostly contacts whose rim slips: 13 an hour where less than a twentieth of the area ever does,
// 100 to 200 where a tenth to 40 % do.
//
// Limits. A pressure that changes makes R too. Light is fixed to the camera, patches are not: strong shear of a smooth
// object lifts the floor. Slower than about 0.2 mm in the lag is not told from noise. A worn gel looks like a relief
// that never slips. Exposure and white balance of the camera must stand still.
#pragma once

#include <array>
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
  std::int32_t contact_over_noise_q4 = 40;  // 2.5
  std::int32_t least_patches = 5;           // fewer: no texture
  // A patch whose empty gel shows more gradient energy than this is left out: a dot printed beside another, a scratch,
  // dirt. Levels^2. A clean gel's patches have 1 to 1.5 on the recordings, 1 to 3 in a hundred more than this.
  std::int32_t most_print = 8;
};

// Lags of the three motions. A picture counts for a lag when its age is within a third of it: from 2/3 to 4/3 there is
// a multiple of every frame period up to the shortest lag's 160 ms. (Within a quarter there was none from 11.1 to 13.3
// fps, which health.hpp lets pass: no recorded onset was noticed at 12.5 fps, of 12 at 25.)
inline constexpr std::array<Micros, 3> kLags{Micros{120'000}, Micros{240'000}, Micros{480'000}};

inline constexpr int kStepsPerPitch = 16;         // samples from dot to dot
inline constexpr int kSide = kStepsPerPitch / 2;  // samples along a patch's side
inline constexpr int kPatchesPerDot = 4;          // towards (+x, +y), (-x, +y), (+x, -y), (-x, -y)
inline constexpr int kMaxDots = 80;               // the largest printed grid sold; of a larger one every second dot
inline constexpr int kMaxPatches = kPatchesPerDot * kMaxDots;
static_assert(2 * kMaxDots >= kMaxMarkers);
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
// lattice can reach.
inline constexpr std::int32_t kMaxReducedPixels = 64'000;
inline constexpr int kMaxReduction_log2 = 4;

struct Reduced {
  std::int32_t reduction_log2 = 0;  // pixels of the working picture to one of these: 1, 2, 4, 8, 16
  std::int32_t left = 0, top = 0;   // of the working picture, in reduced pixels
  std::int32_t width = 0, height = 0;
  std::array<std::uint16_t, kMaxReducedPixels> pixels{};
};

// Where a patch lies on the empty gel, in 1/4096 reduced pixels from the centre of the top left one: its sample (0, 0),
// and the step from sample to sample away from the dot.
struct Frame {
  std::int32_t x_q12 = 0, y_q12 = 0;
  std::int32_t ax_q12 = 0, ay_q12 = 0;
  std::int32_t bx_q12 = 0, by_q12 = 0;
  bool usable = false;  // all of its dots have a rest position, and the picture shows it
};

using Samples = std::array<std::int16_t, kFree>;  // 16 x luma, in the order of b, then a

// What later pictures are compared with.
struct Kept {
  Micros at{};
  MarkerField markers;
  std::array<bool, kMaxPatches> seen{};
  std::array<std::uint32_t, kMaxPatches> relief{};  // kPairs * G; <= 2 * 17 * 8160^2 = 2.3e9
  std::array<Samples, kMaxPatches> samples{};
};

inline constexpr Micros kKeepEvery{35'000};
inline constexpr int kKept = 14;       // times 35 ms: reaches back the longest lag at any frame rate
inline constexpr int kEmptyMean = 64;  // frames that the learned empty gel is a mean of, in the long run
inline constexpr int kNoiseAfter = 8;  // frames on the empty gel before its noise is believed

// What was learned of the empty gel: all that a restarted process needs to go on (app/keepsake.hpp).
struct Empty {
  std::array<std::array<std::uint16_t, kFree>, kMaxPatches> samples_q4{};  // of the patches, in Q4
  std::array<bool, kMaxPatches> learned{};                                 // the patch was seen on the empty gel
  std::array<bool, kMaxPatches> marked{};                                  // and shows too much there
  int frames = 0;
  std::int64_t noise_relief = 0;                          // kPairs * G of a patch of the empty gel
  std::array<std::int64_t, kLags.size()> noise_motion{};  // kFree^2 * R of a patch of the empty gel
  std::array<int, kLags.size()> noise_frames{};
};

struct State {
  bool placed = false;                 // frames stand for the rest position that is in force
  std::int32_t width = 0, height = 0;  // of the picture that they were laid out for
  Reduced picture;
  std::array<Frame, kMaxPatches> frames{};
  Empty empty;
  std::array<Kept, kKept> kept{};  // a ring
  int count = 0;
  int newest = 0;
  Kept last;  // the frame seen last, whether it is kept or not
};

// Forgets everything, the empty gel as well.
void forget(State& state);

// The rest position has changed, the gel has not: the patches are laid out anew with the next frame.
inline void place_again(State& state) {
  state.placed = false;
}

// The motions as without relief: what was seen is no motion against the gel.
inline void disbelieve(ImprintFeatures& features) {
  features.motion_short = features.motion = features.motion_long = {};
}

// One frame. `rest`: the learned rest position; `markers`: now; both in pixels of `picture`. `empty`: nothing touches
// the gel, so that this frame goes into the mean of the empty gel and into its noise. Without such a frame nothing is
// ever in contact; until there were kNoiseAfter it takes twice the relief.
// Cost: 0.56 M aarch64 instructions with 63 markers, of which 0.18 M reduce a picture of 410x308.
[[nodiscard]] ImprintFeatures update(State& state, const Config& config, const LumaView& picture,
                                     const MarkerField& markers, const MarkerField& rest, PixelsQ8 pitch, bool empty,
                                     Micros now, Saturations& saturations);

}  // namespace holdfast::imprint
