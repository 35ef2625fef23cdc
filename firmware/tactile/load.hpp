// SPDX-License-Identifier: Apache-2.0
// The load on the gel from its displacement field: shear Q along the surface, normal P into it, and friction use Q / P.
// For people and logs: nothing of it goes into the decision.
//
// The gel is a layer of thickness h and shear modulus G, bonded to its base and nearly incompressible. Whatever the
// object's shape and wherever it slips, over the whole surface (k = 0 of the compliance that the simulator's layer.cpp
// has in closed form, and its first order in k)
//   Q = G / h * sum of u dA        n.u n.x summed over dA = P h^2 (4 nu - 1) / (4 (1 - nu) G), n across Q
// The second is the gel that flows out from under the pressure; along Q it would take the shear's own arm with it, so
// it is read across. 63 markers see only a part of that surface, friction under the object holds some of the flow back,
// and the moment lives on what is far out. So the sums are weighted: `kWeights` are the coefficients with the least
// mean error over contacts drawn at random, whose fields are the layer's own (toolchain/generate/load_weights.hpp; no
// contact of the simulator, no friction law). One set is for contacts within the lattice; one for those that go on
// beyond opposite edges of it, like a bar across the gel, of which only the middle is seen.
//
//   shear  = w_x . u, w_y . u
//   normal = w_0 . u + c (w_c . u) + s (w_s . u),  (c, s) = (Qx^2 - Qy^2, 2 Qx Qy) / (Q^2 + (P0 / 5)^2), P0 = w_0 . u
// u enters folded: sums and differences of the four markers that are mirror images, of which each figure reads those of
// its own symmetry.
//
// Weights hold for 7x9 markers 2.02 mm apart on 4.25 mm of 35 kPa, Poisson's ratio 0.49. Of another stiffness every
// force is another by one factor, which a known weight measures (`holdfast calibrate --weight`): until then readings
// are called uncalibrated. A layer 6 % thicker reads 6 % too much shear and 12 % too much normal load, and the same
// factors take that out. Range: displacements below a quarter of the thickness; a gel's large strain is not modelled.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "tactile/load_weights.gen.hpp"
#include "tactile/types.hpp"

namespace holdfast::load {

struct Config {
  std::int32_t pitch_um = 2020;  // as displacement::Config; the weights are for one within kPitchOff of kPitch
  // Of what a gel of 35 kPa would carry, in thousandths, 0 to kMostScalePermille; 0: no weight was used. Where one is
  // known, the other is taken as the same, because both stand on the same stiffness; where none is, as 1000.
  std::int32_t shear_scale_permille = 0;
  std::int32_t normal_scale_permille = 0;
};

inline constexpr std::int32_t kMostScalePermille = 20'000;
inline constexpr std::int32_t kPitch_um = 2020;
inline constexpr std::int32_t kPitchOff_um = 40;
inline constexpr std::int32_t kMostMissing = 8;       // markers; each is taken as its neighbours' mean
inline constexpr std::int32_t kStrained_um = 1060;    // a quarter of the thickness
inline constexpr std::int32_t kLeastNormal_mn = 200;  // below it Q / P is noise over noise

// What a reading stands on. The numbers are sent on the wire.
enum class Basis : std::uint8_t {
  kNone = 0,        // no reading: another lattice or pitch, or too many markers are missing
  kNominal = 1,     // uncalibrated
  kOneWeight = 2,   // for shear or normal load; the other one has its scale
  kTwoWeights = 3,  // for each
};
inline constexpr std::array<std::string_view, 4> kBasisNames{"none", "uncalibrated", "one_weight", "two_weights"};

struct Load {
  Basis basis = Basis::kNone;  // kNone: all below is 0
  // The contact lies within the lattice; false also where hardly any shear tells. Otherwise what it carries outside is
  // estimated at best, and the errors are larger.
  bool within = false;
  bool strained = false;  // a marker moved by more than a quarter of the thickness
  Millinewtons shear_x, shear_y;
  Millinewtons normal;    // may be below 0 by noise
  Permille friction_use;  // Q / P; 0 below kLeastNormal_mn
};

// |Q| in mN.
[[nodiscard]] std::int64_t shear_mn(const Load& load);

// Range: forces below 2^28 before the scale, 2^43 behind it; what leaves +-32.767 N is clamped and counted.
[[nodiscard]] Load update(const Config& config, const DisplacementField& field, Saturations& saturations);

// What the weights were made with, too.
namespace detail {

// Displacements of a lattice for which there are weights, um, without gaps.
struct Field {
  std::array<std::int32_t, kMarkers> x{}, y{};
};

// What each figure reads. A middle row or column is its own mirror image, and counts twice or not at all.
struct Folded {
  std::array<std::int32_t, kFolded> shear_x{}, shear_y{}, normal{}, diagonal{};
};
// Range: |u| <= 2^16, sums of four below 2^18 + 1.
[[nodiscard]] Folded fold(const Field& field);

// How far the contact reaches, from the mean motion along the shear of each edge of the lattice over that of all: 0.1
// to 0.45 at opposite edges where it lies within, 0.6 to 0.9 where it goes on beyond both.
struct Reach {
  std::int32_t across_q8 = 0;  // share of the second set of weights, 0 to 256
  bool within = false;
};
// An eighth of the field's energy belongs to the denominator, because a press without shear has no such direction.
// Range: sums below 2^22, energy below 2^39; products of sums below 2^46, times 1024 2^56.
[[nodiscard]] Reach reach_of(const Field& field);

struct Forces {
  std::int64_t shear_x = 0, shear_y = 0, normal = 0;  // mN
};

// The direction of the shear as (cos, sin) of twice its angle, Q12, shorter where there is little of it.
struct Direction {
  std::int32_t c_q12 = 0, s_q12 = 0;
};
// Range: what is beyond +-2^20 mN counts as that; squares below 2^41, Q12 2^53.
[[nodiscard]] Direction direction_of(const Forces& rough);

}  // namespace detail

}  // namespace holdfast::load
