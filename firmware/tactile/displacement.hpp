// SPDX-License-Identifier: Apache-2.0
// Displacement of each marker from its rest position, in micrometres on the gel: independent of the camera's scale.
//
// Scale = printed pitch over registered pitch; the sensor has no other ruler. Rounded to the nearest micrometre:
// 1 um is 0.016 px at 320x240, a quarter of the rest noise.
// A lost marker has no displacement; it never counts as zero.
#pragma once

#include <cstdint>

#include "base/math.hpp"
#include "tactile/types.hpp"

namespace holdfast::displacement {

struct Config {
  std::int32_t pitch_um = 2020;  // printed spacing; 1000..5000. Measured on 7x9 gels: 2.02 mm
};

// Range: offsets up to 2^21 in Q8 px, pitch_um up to 5000: products below 2^34; pitch at least 1 (reference.hpp knows
// no rest position without one). What leaves +-65.5 mm is clamped and counted.
inline void update(const Config& config, const MarkerField& now, const MarkerField& rest, PixelsQ8 pitch,
                   Saturations& saturations, DisplacementField& out) {
  out.grid = now.grid;
  for (std::int32_t i = 0; i < now.grid.count(); ++i) {
    const Marker& marker = now.markers[idx(i)];
    const Marker& home = rest.markers[idx(i)];
    MarkerDisplacement& d = out.markers[idx(i)];
    d = {};
    if (!marker.valid || !home.valid) continue;
    const auto micrometres = [&](std::int32_t offset_px_q8) {
      return Micrometres::saturate(div_round(std::int64_t{offset_px_q8} * config.pitch_um, pitch.raw()), saturations);
    };
    d = {micrometres(marker.x.raw() - home.x.raw()), micrometres(marker.y.raw() - home.y.raw()), true};
  }
}

}  // namespace holdfast::displacement
