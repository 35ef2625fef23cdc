// SPDX-License-Identifier: Apache-2.0
// The side of an object that touches the gel, as a height above its lowest point.
//
// Modelled
//   * rigid sphere, ellipsoid, cylinder (axis along the object's x), cone, flat disc, flat box, rounded edge (a ridge
//   along the
//     object's x); rounded rims of the flats
//   * turned about the normal (yaw) and flats off the normal (tilt, about the object's x: first order, as a slope)
//   * texture: ridges along the object's y, or bumps on a square lattice, as a cosine of given height and pitch
//   * relief: too fine to matter to the contact, so only pictures have it (underside.hpp)
//
// Not modelled
//   * overhangs, porous or sticky surfaces; deformation of the object (its compliance acts in series, simulation.hpp)
//
// Units: mm, rad. Second-order (paraboloid) profiles for sphere, ellipsoid and cylinder, as Hertz's theory has them.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "drivers/sim/scene/contact/hertz.hpp"

namespace holdfast::scene {

enum class ShapeKind { kSphere, kEllipsoid, kCylinder, kCone, kDisc, kBox, kEdge };
enum class TextureKind { kNone, kRidges, kBumps };
enum class ReliefKind { kNone, kRidges, kBumps, kGrain };

inline constexpr std::array<std::string_view, 7> kShapeNames{"sphere", "ellipsoid", "cylinder", "cone",
                                                             "disc",   "box",       "edge"};
inline constexpr std::array<std::string_view, 3> kTextureNames{"none", "ridges", "bumps"};
inline constexpr std::array<std::string_view, 4> kReliefNames{"none", "ridges", "bumps", "grain"};

struct Shape {
  ShapeKind kind = ShapeKind::kSphere;
  double radius_mm = 15.0;    // sphere, cylinder, ellipsoid along x, edge (of its crest), disc (of its outline)
  double radius_y_mm = 15.0;  // ellipsoid along y
  double half_x_mm = 5.0;     // box
  double half_y_mm = 5.0;     // box
  double rim_mm = 1.0;        // disc, box: radius of the rounded rim, inside the outline
  double flank_deg = 20.0;    // cone, edge: slope of the flank against the gel
  double yaw_rad = 0.0;
  double tilt_rad = 0.0;  // disc, box: towards the object's +y
  TextureKind texture = TextureKind::kNone;
  double texture_height_mm = 0.0;  // from valley to crest
  double texture_pitch_mm = 1.0;

  friend bool operator==(const Shape&, const Shape&) = default;
};

// Ridges and bumps as the texture's; grain is random and the same in all directions.
struct Relief {
  ReliefKind kind = ReliefKind::kNone;
  double height_um = 0.0;  // from valley to crest; of grain 4 times its rms
  double pitch_mm = 1.0;   // from crest to crest; of grain the period of its rms frequency

  friend bool operator==(const Relief&, const Relief&) = default;
};

// Height of the object above its lowest point, at a place in its own frame (origin at the place of first touch, before
// yaw). >= 0; beyond the rim of a flat it grows without bound.
[[nodiscard]] double height_mm(const Shape& shape, Vec2 at_mm);

// Bodies of revolution without texture or tilt, which the level `springs` can do: f(r) = A r^n.
struct Round {
  double coefficient = 0.0;
  int exponent = 2;
};
[[nodiscard]] std::optional<Round> as_round(const Shape& shape);

}  // namespace holdfast::scene
