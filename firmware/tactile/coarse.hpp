// SPDX-License-Identifier: Apache-2.0
// Motion of what is too smooth or too fine for imprint.hpp to see inside a patch: the shading of a ball, the rim of a
// face, the whole of a weak relief. Here each patch is one pixel of a coarse picture, and one motion is fitted to all.
//
//   change  = mean of the patch now less that before; its slopes: of the object's shading, mean of both pictures
//   nuisance  first the change loses what a sticking contact explains: a change of light, constant or linear over the
//             gel; the shading itself (pressure: brighter or darker in place); its dilation (a rim that grows); the
//             slopes of the empty gel (the gel carries its patches across light that is fixed to the camera)
//   explained what is left and lies along the slopes: a shift along x or y, a turn about the middle, least squares
//   noise   = what nothing explains, by degree of freedom, and 0.02 levels^2
//   motion  = step sqrt((explained - 33 noise) / (sum |slope|^2 / 2 + 0.01 N)): 33 = 3 motions of 11 times the noise
// so that growth of a contact, which no rigid motion explains, is noise to it. What being carried explains is taken off
// (imprint.hpp).
//
// The factor 11 and the two floors were chosen on simulated slides, closings and bonded shaking of seed 7 and on the
// silence of 200 recordings (2026-11-24): at 8 bonded objects alarm when they are shaken, at 20 a quarter of the
// slides is missed. On recordings with relief it adds alarms to imprint.hpp and no onset, so it is for those without.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>

#include "base/units.hpp"

namespace holdfast::coarse {

// One patch in two pictures. c: the patch less the same patch of the empty gel.
struct Patch {
  std::int32_t change = 0;                // mean of c now less then, 1/400 level
  std::int32_t shading = 0;               // mean of c, now and then added, 1/400 level
  std::int32_t slope_x = 0, slope_y = 0;  // of c along the picture's axes, now and then added, 1/800 level a step
  std::int32_t empty_x = 0, empty_y = 0;  // of the empty gel, 1/800 level a step
  std::int32_t x = 0, y = 0;              // place, quarters of a pitch
};

inline constexpr int kMostPatches = 320;
inline constexpr int kModes = 10;         // 7 that stick, 3 that slip
inline constexpr int kLeastPatches = 20;  // with fewer there is no telling motion from noise

// Half of the way that the gel went between two pictures, squared: what a motion loses of its square.
struct Carried {
  std::int64_t steps2_q20 = 0;
};

// The evidence that it explains, of a motion that is sqrt(evidence / energy * down / up) steps. Range: energy below
// 2^62, carried below 2^32, up and down below 2^10, up at least down. Keeps 30 bits of the energy, so that products
// stay below 2^62; capped at 2^62.
[[nodiscard]] constexpr std::int64_t explained(Carried carried, std::int64_t energy, std::int64_t up,
                                               std::int64_t down) {
  const int shift = std::max(static_cast<int>(std::bit_width(static_cast<std::uint64_t>(energy))) - 30, 0);
  const std::int64_t part = ((energy >> shift) * carried.steps2_q20 >> 20) * up / down;
  return part < (std::int64_t{1} << 62) >> shift ? part << shift : std::int64_t{1} << 62;
}

// log2 of um in Q8; 0: nothing that stands out. `step_um_log2_q8`: distance of two samples, likewise. Range: at most
// kMostPatches; change and shading below 2^18, slopes below 2^19, |x| + |y| below 2^8. Below kLeastPatches: 0.
[[nodiscard]] Log2Q8 motion(std::span<const Patch> patches, Carried carried, std::int32_t step_um_log2_q8,
                            Saturations& saturations);

}  // namespace holdfast::coarse
