// SPDX-License-Identifier: Apache-2.0
// What leaves the tactile stages: scale-independent integers, the same for every camera size.
#pragma once

#include <array>
#include <cstdint>

#include "base/units.hpp"
#include "vision/markers.hpp"

namespace holdfast {

inline constexpr int kHistogramBins = 15;  // the paper, section III

// Displacement of each marker from its rest position on the empty gel.
struct MarkerDisplacement {
  Micrometres dx;
  Micrometres dy;
  bool valid = false;  // the marker is found now and has a rest position
};

struct DisplacementField {
  GridSize grid;
  std::array<MarkerDisplacement, kMaxMarkers> markers{};
};

// How the displacement field is shaped and how it changes (field_features.hpp). The second half needs an earlier field,
// about 0.1 s old; without one it is 0.
struct FieldFeatures {
  Micrometres shift;       // length of the mean displacement
  Micrometres reach;       // third largest displacement: two strays do not move it
  MicrometresQ4 residual;  // RMS distance from the best rigid motion
  Log2Q8 unevenness;       // residual over shift
  ShareQ10 evenness;       // (sum |D|)^2 / (n sum |D|^2): 1 = all move alike, small = few move
  NatsQ16 octave_entropy;  // entropy over bins of half an octave: sees shape, not size
  MicrometresPerSec residual_rate;
  MicrometresPerSec flow_shift;     // length of the markers' mean velocity
  MicrometresPerSec flow_spread;    // RMS of the markers' velocities about their mean
  MicrometresPerSec flow_residual;  // RMS distance of the velocities from the best rigid motion
  ShareQ10 flow_evenness;           // evenness of the velocities
  ShareQ10 flow_along;              // cosine between velocities and displacements: 1 loads, -1 unloads
  ShareQ10 flow_steady;             // cosine between velocities and those before: 1 goes on as it went
  StrainPpmPerSec dilation_rate;    // the field opens (+) or closes (-)
  StrainPpmPerSec easing;           // largest closing of late, fading: a grip that loosens
};

// How far the object's imprint moved against the gel over 0.16 s, and how the contact grew meanwhile (imprint.hpp); of
// motion, coarse and turnover, while slip is raised, the greater of that and of a shorter time. All 0 without a
// picture that long ago.
struct ImprintFeatures {
  Log2Q8 motion;  // log2 of um; 0 = nothing moved that stands out of the noise of these two pictures, or no relief
  Log2Q8 growth;  // log2 of the shading now over then, by energy: +256 = doubled
  Log2Q8 coarse;  // as motion, of what is smoother or finer than a patch shows (coarse.hpp); 0 where relief is strong
  ShareQ10 turnover;   // share of the relief that another has taken the place of; 0 where there is next to none
  Count patches;       // in which something is pressed into the gel
  bool blind = false;  // after a gap in the stream there is no picture that long ago, as there was before it
};

// The paper's features. Shape of the histogram: count of markers per bin of abs(D) over [0, R).
struct Features {
  MicrometresPerSec vx;
  MicrometresPerSec vy;
  NatsQ16 entropy;
  NatsPerSecQ8 entropy_rate;
  std::int32_t markers = 0;  // how many markers the figures stand on
  bool rates_valid = false;  // false on the first frame and after a gap: vx, vy and entropy_rate are 0
  bool gap = false;          // too long since the frame before
  std::array<std::uint8_t, kHistogramBins> histogram{};
  FieldFeatures field;      // all 0 unless the pipeline was told to compute them
  ImprintFeatures imprint;  // likewise
  Count contact;            // 1: something touches the gel (contact.hpp) and is not let go, or nobody can tell
};

}  // namespace holdfast
