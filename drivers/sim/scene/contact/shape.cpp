// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/shape.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/sim/scene/math/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Steep enough that no indentation reaches beyond a flat's outline.
constexpr double kBeyondRim = 1e6;

// Rounded rim of a flat: a paraboloid over the last `rim` of the way to the outline, a cliff behind it.
double rim(double inside_mm, double rim_mm) {
  if (inside_mm < 0.0) return kBeyondRim;
  if (!(rim_mm > 0.0) || inside_mm >= rim_mm) return 0.0;
  const double in = rim_mm - inside_mm;
  return in * in / (2.0 * rim_mm);
}

// A flat that leans towards +y touches there first.
double lean(double tilt_rad, double y_mm, double half_mm) {
  const double slope = portable::tan(tilt_rad);
  return std::abs(slope) * half_mm - slope * y_mm;
}

// Two flanks that meet in a rounded crest.
double ridge(double across_mm, double radius_mm, double slope) {
  const double away = std::abs(across_mm);
  const double round = slope * radius_mm;  // where the parabola has the flank's slope
  if (away <= round) return radius_mm > 0.0 ? away * away / (2.0 * radius_mm) : 0.0;
  return slope * (away - 0.5 * round);
}

double wave(double along_mm, double pitch_mm) {
  return 0.5 - 0.5 * portable::cos(2.0 * pi * along_mm / pitch_mm);
}

}  // namespace

double height_mm(const Shape& shape, Vec2 at) {
  const double c = portable::cos(shape.yaw_rad);
  const double s = portable::sin(shape.yaw_rad);
  const Vec2 p{c * at.x + s * at.y, c * at.y - s * at.x};
  double height = 0.0;
  switch (shape.kind) {
    case ShapeKind::kSphere:
      height = (p.x * p.x + p.y * p.y) / (2.0 * shape.radius_mm);
      break;
    case ShapeKind::kEllipsoid:
      height = p.x * p.x / (2.0 * shape.radius_mm) + p.y * p.y / (2.0 * shape.radius_y_mm);
      break;
    case ShapeKind::kCylinder:
      height = p.y * p.y / (2.0 * shape.radius_mm);
      break;
    case ShapeKind::kCone:
      height = portable::tan(shape.flank_deg * pi / 180.0) * std::sqrt(p.x * p.x + p.y * p.y);
      break;
    case ShapeKind::kDisc:
      height = rim(shape.radius_mm - std::sqrt(p.x * p.x + p.y * p.y), shape.rim_mm) +
               lean(shape.tilt_rad, p.y, shape.radius_mm);
      break;
    case ShapeKind::kBox:
      height = rim(std::min(shape.half_x_mm - std::abs(p.x), shape.half_y_mm - std::abs(p.y)), shape.rim_mm) +
               lean(shape.tilt_rad, p.y, shape.half_y_mm);
      break;
    case ShapeKind::kEdge:
      height = ridge(p.y, shape.radius_mm, portable::tan(shape.flank_deg * pi / 180.0));
      break;
  }
  switch (shape.texture) {
    case TextureKind::kNone:
      break;
    case TextureKind::kRidges:
      height += shape.texture_height_mm * wave(p.x, shape.texture_pitch_mm);
      break;
    case TextureKind::kBumps:
      height += shape.texture_height_mm * 0.5 * (wave(p.x, shape.texture_pitch_mm) + wave(p.y, shape.texture_pitch_mm));
      break;
  }
  return height;
}

std::optional<Round> as_round(const Shape& shape) {
  if (shape.texture != TextureKind::kNone && shape.texture_height_mm > 0.0) return std::nullopt;
  if (shape.kind == ShapeKind::kSphere) return Round{0.5 / shape.radius_mm, 2};
  if (shape.kind == ShapeKind::kCone) return Round{portable::tan(shape.flank_deg * pi / 180.0), 1};
  return std::nullopt;
}

}  // namespace holdfast::scene
