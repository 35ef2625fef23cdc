// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact_kinematic.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/sim/scene/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

constexpr double kMost = 1e40;

double bounded(double value) {
  return std::clamp(value, -kMost, kMost);
}

double positive(double value) {
  return value > 0.0 ? std::clamp(value, 1.0 / kMost, kMost) : 0.0;
}

double square(Vec2 v) {
  return v.x * v.x + v.y * v.y;
}

// No radius: nothing follows.
double falloff(double radius_mm) {
  return radius_mm > 0.0 ? 1.0 / positive(radius_mm) / positive(radius_mm) : kMost;
}

// Share of the way that stays within the limit.
double within(double way, double most) {
  return way > most ? most / way : 1.0;
}

}  // namespace

KinematicContact::KinematicContact(const KinematicSetup& setup, std::span<const Vec2> markers_mm)
    : setup_(setup),
      round_(as_round(setup.shape)),
      shear_(falloff(setup.shear_radius_mm)),
      twist_(falloff(setup.twist_radius_mm)),
      markers_mm_(markers_mm.begin(), markers_mm.end()) {
  setup_.gel.shear_modulus_mpa = positive(setup.gel.shear_modulus_mpa);
  setup_.most_shear_mm = std::max(setup.most_shear_mm, 0.0);
  setup_.most_twist_deg = std::max(setup.most_twist_deg, 0.0);
  find_law();
  near_.reserve(markers_mm_.size() * markers_mm_.size());
  for (const Vec2 from : markers_mm_) {
    for (const Vec2 to : markers_mm_)
      near_.push_back(portable::exp(-falloff(setup.dilate_radius_mm) * square(to - from)) * (to - from));
  }
}

void KinematicContact::find_law() {
  const Shape& shape = setup_.shape;
  const double slope = portable::tan(shape.flank_deg * pi / 180.0);
  switch (shape.kind) {
    case ShapeKind::kSphere:
    case ShapeKind::kCylinder:
      size_ = shape.radius_mm;
      break;
    case ShapeKind::kEllipsoid:
      size_ = std::sqrt(std::max(shape.radius_mm, 0.0)) * std::sqrt(std::max(shape.radius_y_mm, 0.0));
      break;
    case ShapeKind::kEdge:
      law_ = shape.radius_mm > 0.0 ? Law::kSphere : Law::kCone;
      size_ = shape.radius_mm > 0.0 ? shape.radius_mm : slope;
      break;
    case ShapeKind::kCone:
      law_ = Law::kCone;
      size_ = slope;
      break;
    case ShapeKind::kDisc:
      law_ = Law::kPunch;
      size_ = shape.radius_mm;
      break;
    case ShapeKind::kBox:
      law_ = Law::kPunch;
      size_ = std::sqrt(4.0 / pi * std::max(shape.half_x_mm, 0.0) * std::max(shape.half_y_mm, 0.0));
      break;
  }
  size_ = positive(size_);
}

double KinematicContact::force_n(double depth) const {
  const double modulus = effective_modulus_mpa(setup_.gel);
  switch (law_) {
    case Law::kSphere:
      return 4.0 / 3.0 * modulus * std::sqrt(size_) * std::sqrt(depth) * depth;
    case Law::kCone:
      return 2.0 / pi * modulus * depth * depth / size_;
    case Law::kPunch:
      break;
  }
  return 2.0 * modulus * size_ * depth;
}

double KinematicContact::depth_mm(double force) const {
  const double share = force / effective_modulus_mpa(setup_.gel);
  switch (law_) {
    case Law::kSphere: {
      const double root = portable::cbrt(0.75 * share / std::sqrt(size_));
      return root * root;
    }
    case Law::kCone:
      return std::sqrt(0.5 * pi * share * size_);
    case Law::kPunch:
      break;
  }
  return 0.5 * share / size_;
}

double KinematicContact::radius_mm(double depth) const {
  switch (law_) {
    case Law::kSphere:
      return std::sqrt(2.0 * size_ * depth);
    case Law::kCone:
      return depth / size_;
    case Law::kPunch:
      break;
  }
  return size_;
}

const ContactState& KinematicContact::press_to(double force, Vec2 at_mm, double twist_rad) {
  const bool presses = force > 0.0 && setup_.gel.shear_modulus_mpa > 0.0 && size_ > 0.0;
  return move_to({presses ? depth_mm(std::min(force, kMost)) : 0.0, at_mm, twist_rad});
}

const ContactState& KinematicContact::move_to(const ObjectPose& pose) {
  const bool touched = state_.contact_radius_mm > 0.0;
  const Vec2 at{bounded(pose.at_mm.x), bounded(pose.at_mm.y)};
  const double turn = bounded(pose.twist_rad);
  const double depth = positive(pose.depth_mm);
  // At rest a contact on its limit stays there; rounding must not decide.
  const bool travels = !touched || at != state_.center_mm;
  const bool turns = !touched || turn != object_rad_;
  state_ = {};
  state_.depth_mm = depth;
  state_.center_mm = at;
  object_rad_ = turn;
  if (!(depth > 0.0) || !(size_ > 0.0)) {
    sheared_mm_ = {};
    turned_rad_ = 0.0;
    return state_;
  }
  if (!touched) {
    touched_mm_ = anchor_mm_ = at;
    touched_rad_ = anchor_rad_ = turn;
    sheared_mm_ = {};
    turned_rad_ = 0.0;
    shear_slips_ = twist_slips_ = false;
  }
  if (travels) {
    const Vec2 way = at - anchor_mm_;
    const double length = portable::hypot(way.x, way.y);
    shear_slips_ = length > setup_.most_shear_mm;
    sheared_mm_ = within(length, setup_.most_shear_mm) * way;
    if (shear_slips_) anchor_mm_ = at - sheared_mm_;
  }
  const double most_rad = setup_.most_twist_deg * (pi / 180.0);
  if (turns) {
    const double angle = turn - anchor_rad_;
    twist_slips_ = std::abs(angle) > most_rad;
    turned_rad_ = within(std::abs(angle), most_rad) * angle;
    if (twist_slips_) anchor_rad_ = turn - turned_rad_;
  }
  state_.contact_radius_mm = radius_mm(depth);
  state_.normal_n = setup_.gel.shear_modulus_mpa > 0.0 ? force_n(depth) : 0.0;
  state_.gross = shear_slips_ || twist_slips_;
  state_.stick_radius_mm = state_.gross ? 0.0 : state_.contact_radius_mm;
  state_.slip_fraction = state_.gross ? 1.0 : 0.0;
  state_.slid_mm = anchor_mm_ - touched_mm_;
  state_.slid_rad = anchor_rad_ - touched_rad_;
  return state_;
}

// How far the object would be below the undeformed surface there.
double KinematicContact::depth_under(Vec2 at) const {
  const Vec2 from = at - state_.center_mm;
  if (round_) {
    const double square_mm = square(from);
    return state_.depth_mm - round_->coefficient * (round_->exponent == 2 ? square_mm : std::sqrt(square_mm));
  }
  const double c = portable::cos(object_rad_);
  const double s = portable::sin(object_rad_);
  return state_.depth_mm - height_mm(setup_.shape, {c * from.x + s * from.y, c * from.y - s * from.x});
}

void KinematicContact::field(std::span<Vec2> motion_mm) {
  const std::size_t count = markers_mm_.size();
  std::fill_n(motion_mm.begin(), count, Vec2{});
  if (!(state_.contact_radius_mm > 0.0)) return;
  for (std::size_t c = 0; c < count; ++c) {
    const double under = setup_.dilate_per_mm * depth_under(markers_mm_[c]);
    if (!(under > 0.0)) continue;
    const Vec2* near = &near_[c * count];
    for (std::size_t m = 0; m < count; ++m) motion_mm[m] = motion_mm[m] + under * near[m];
  }
  const bool shears = sheared_mm_ != Vec2{};
  const bool turns = turned_rad_ != 0.0;
  // R - I = {{-2 sin^2(theta/2), -sin theta}, {sin theta, -2 sin^2(theta/2)}}.
  const double half = portable::sin(0.5 * turned_rad_);
  const double less = 2.0 * half * half;
  const double sine = portable::sin(turned_rad_);
  for (std::size_t m = 0; m < count; ++m) {
    Vec2& motion = motion_mm[m];
    if (shears) {
      motion = motion + portable::exp(-shear_ * square(markers_mm_[m] + motion - anchor_mm_)) * sheared_mm_;
    }
    if (turns) {
      const Vec2 from = markers_mm_[m] + motion - state_.center_mm;
      const double g = portable::exp(-twist_ * square(from));
      motion = motion + g * Vec2{-less * from.x - sine * from.y, sine * from.x - less * from.y};
    }
  }
}

}  // namespace holdfast::scene
