// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/round.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "drivers/sim/scene/math/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// The cube of a smaller radius underflows; no marker sees such a contact.
constexpr double kLeastRadius_mm = 1e-60;

// Read off level `grid` (a sphere of 15 mm pressed with 3 N on the default gel, mu 0.2, 0.5 and 1); checked at other
// forces and moduli by contact_round_test.
constexpr double kRimShare = 0.66;
constexpr double kHoldingFriction = 0.1;

// How much of the press's outward flow friction holds back where the object sticks: all of it from about mu = 0.3 on.
double held_share(double friction) {
  return -portable::expm1(-friction / kHoldingFriction);
}

// Of Hertz's dome that carries the same force on the same radius.
double dome_slope(const Press& press) {
  const double a = press.contact_radius_mm;
  return 1.5 * press.force_n / (pi * a * a * a);
}

// How much further a disc that moves as one goes on the half-space than on the layer, under the same load.
double stick_ratio(const Layer& layer, double radius_mm) {
  if (std::isinf(layer.gel().thickness_mm) || !(radius_mm > 0.0)) return 1.0;
  const double thin = layer.punch(radius_mm, 0.0).mean;
  const double thick = (2.0 - layer.gel().poisson) / (8.0 * layer.gel().shear_modulus_mpa * radius_mm);
  return thin > 0.0 && thick > 0.0 && std::isfinite(thick / thin) ? thick / thin : 1.0;
}

// The same for a turn, where the disc's middle half moves.
double turn_ratio(const Layer& layer, double radius_mm) {
  const double g = layer.gel().shear_modulus_mpa;
  const double thin = layer.torque(radius_mm, 0.5 * radius_mm);
  const double thick = 3.0 / (16.0 * g * radius_mm * radius_mm * radius_mm) * 0.5 * radius_mm;
  return thin > 0.0 && std::isfinite(thick / thin) && thick > 0.0 ? thick / thin : 1.0;
}

double sphere_radius(const Round& round) {
  return round.coefficient > 0.0 ? 0.5 / round.coefficient : 0.0;
}

}  // namespace

RoundField::RoundField(const RoundSetup& setup, std::span<const Vec2> markers_mm)
    : layer_(setup.gel),
      sphere_radius_mm_(setup.round.exponent == 2 ? sphere_radius(setup.round) : 0.0),
      press_dilation_(setup.press_dilation),
      markers_mm_(markers_mm.begin(), markers_mm.end()) {
  from_mm_.resize(size());
  for (auto* numbers : {&r_mm_, &turn_, &outward_, &passed_}) numbers->resize(size());
  move_center({});
}

void RoundField::move_center(Vec2 center_mm) {
  for (std::size_t i = 0; i < size(); ++i) {
    from_mm_[i] = {markers_mm_[i].x - center_mm.x, markers_mm_[i].y - center_mm.y};
    r_mm_[i] = std::sqrt(from_mm_[i].x * from_mm_[i].x + from_mm_[i].y * from_mm_[i].y);
  }
  outward_radius_mm_ = turn_radius_mm_ = -1.0;
  passed_known_ = false;
  for (Turned& turned : turned_) turned.radius_mm = -1.0;
}

// Under a dry object the gel flows out freely. Friction holds what has come under the object where it was when the rim
// passed over it: at kRimShare of what a rim of that radius would have moved on its own. Beyond the rim what is held
// back inside is missing as (a/r)^3. Where the object slips along, the gel flows on.
void RoundField::add_press(const Press& press, double friction, double stick_mm, std::span<Vec2> motion_mm) {
  const double a = press.contact_radius_mm;
  if (!(a > 0.0)) return;
  if (outward_radius_mm_ != a) {
    outward_radius_mm_ = a;
    rim_outward_ = layer_.press_outward(a, a);
    for (std::size_t i = 0; i < size(); ++i) outward_[i] = layer_.press_outward(a, r_mm_[i]);
  }
  const double stick = stick_mm / a;
  const double held = sphere_radius_mm_ > 0.0 && stick_mm > 0.0 ? held_share(friction) : 0.0;
  if (held > 0.0 && !passed_known_) {
    passed_known_ = true;
    for (std::size_t i = 0; i < size(); ++i) {
      const double r = r_mm_[i];
      const double slope = 2.0 * effective_modulus_mpa(layer_.gel()) / (pi * sphere_radius_mm_);
      passed_[i] = r > 0.0 ? kRimShare * slope * layer_.press_ratio(r).force * layer_.press_outward(r, r) : 0.0;
    }
  }
  const double slope = dome_slope(press);
  const double fots = press_dilation_ * press.depth_mm / a;
  for (std::size_t i = 0; i < size(); ++i) {
    const double r = r_mm_[i];
    if (!(r > 0.0)) continue;
    double outward = slope * outward_[i];
    if (held > 0.0) {
      const double in = a / r;
      if (r < stick_mm) {
        outward -= held * (outward - passed_[i]);
      } else if (r < a) {
        outward -=
            held * (a - (1.0 - stick * stick) * r - stick * stick * stick_mm) / (a - stick_mm) * (outward - passed_[i]);
      } else {
        outward -= held * stick * stick * (1.0 - kRimShare) * slope * rim_outward_ * in * in * in;
      }
    }
    outward /= r;
    if (fots > 0.0) outward += fots * portable::exp(0.5 * (1.0 - r * r / (a * a)));
    motion_mm[i].x += outward * from_mm_[i].x;
    motion_mm[i].y += outward * from_mm_[i].y;
  }
}

void RoundField::add_discs(double radius_mm, const TwistDiscs& discs, std::span<Vec2> motion_mm) {
  turned_.resize(std::max(turned_.size(), static_cast<std::size_t>(discs.count)));
  std::fill(turn_.begin(), turn_.end(), 0.0);
  for (std::size_t k = 0; k < static_cast<std::size_t>(discs.count); ++k) {
    const TwistDiscs::Disc& disc = discs.discs[k];
    if (disc.turn_rad == 0.0) continue;
    Turned& turned = turned_[k];
    if (turned.radius_mm != disc.radius_mm || turned.spread_mm != disc.spread_mm) {
      turned.radius_mm = disc.radius_mm;
      turned.spread_mm = disc.spread_mm;
      turned.share.resize(size());
      for (std::size_t i = 0; i < size(); ++i) {
        turned.share[i] =
            r_mm_[i] > 0.0 ? disc_motion_mm({disc.radius_mm, 1.0, disc.spread_mm}, r_mm_[i]) / r_mm_[i] : 1.0;
      }
    }
    for (std::size_t i = 0; i < size(); ++i) turn_[i] += disc.turn_rad * turned.share[i];
  }
  for (std::size_t i = 0; i < size(); ++i) {
    motion_mm[i].x -= turn_[i] * from_mm_[i].y;
    motion_mm[i].y += turn_[i] * from_mm_[i].x;
  }
  if (std::isfinite(layer_.gel().thickness_mm)) add_layer_turn(radius_mm, discs, motion_mm);
}

// What the layer adds is smooth on the scale of its thickness: per moment it is a straight line in the square of the
// disc's radius, to 1e-3 (contact_round_test). So two radii stand for all discs.
void RoundField::add_layer_turn(double radius_mm, const TwistDiscs& discs, std::span<Vec2> motion_mm) {
  const std::array<double, 2> radii{0.5 * radius_mm, radius_mm};
  if (turn_radius_mm_ != radius_mm) {
    turn_radius_mm_ = radius_mm;
    for (std::size_t k = 0; k < radii.size(); ++k) {
      layer_turn_[k].resize(size());
      const TwistDiscs::Disc unit{radii[k], 1.0, 0.0};
      const double moment = disc_moment_nmm(layer_.gel(), unit);
      for (std::size_t i = 0; i < size(); ++i) {
        // In the middle the turn itself, from a little beside it.
        const double r = std::max(r_mm_[i], 1e-3 * radius_mm);
        layer_turn_[k][i] = (layer_.torque(radii[k], r) - disc_motion_mm(unit, r) / moment) / r;
      }
    }
  }
  const double inner_2 = radii[0] * radii[0];
  const double span_2 = radii[1] * radii[1] - inner_2;
  std::array<double, 2> moment{};
  for (std::size_t k = 0; k < static_cast<std::size_t>(discs.count); ++k) {
    const TwistDiscs::Disc& disc = discs.discs[k];
    const double m = disc_moment_nmm(layer_.gel(), disc);
    const double outer = (disc.radius_mm * disc.radius_mm - inner_2) / span_2;
    moment[0] += m * (1.0 - outer);
    moment[1] += m * outer;
  }
  for (std::size_t i = 0; i < size(); ++i) {
    const double turn = moment[0] * layer_turn_[0][i] + moment[1] * layer_turn_[1][i];
    motion_mm[i].x -= turn * from_mm_[i].y;
    motion_mm[i].y += turn * from_mm_[i].x;
  }
}

namespace {

// How far the object has slid on the layer after a step. `way`: in all, and `way_before`; `slid`: before the step;
// `slip`: of the step, by its own ratio of layer to half-space; `strain_before`, `strain`: the springs' way less their
// slip. Strain that a falling limit lets go of was taken at the ratios of its time: it goes by their mean.
Vec2 slid_on_layer(Vec2 way, Vec2 way_before, Vec2 slid, Vec2 slip, Vec2 strain_before, Vec2 strain) {
  if (slip == Vec2{}) return slid;
  const double before = length(strain_before);
  if (length(strain) >= before) return slid + slip;
  return way - (length(way_before - slid) / before) * strain;
}

}  // namespace

SpringsContact::SpringsContact(const RoundSetup& setup, std::span<const Vec2> markers_mm)
    : setup_(setup),
      field_(setup, markers_mm),
      spring_field_(field_.layer(), markers_mm),
      springs_({.gel = setup.gel,
                .indenter = {setup.round.coefficient, setup.round.exponent},
                .extent_mm = setup.extent_mm,
                .static_friction = setup.bonded ? std::numeric_limits<double>::infinity() : setup.static_friction,
                .kinetic_friction = setup.bonded ? std::numeric_limits<double>::infinity() : setup.kinetic_friction,
                .springs = setup.springs}),
      turns_(
          {.shear_modulus_mpa = setup.gel.shear_modulus_mpa, .extent_mm = setup.extent_mm, .springs = setup.springs}) {
  if (setup.bonded) setup_.static_friction = setup_.kinetic_friction = std::numeric_limits<double>::infinity();
}

const ContactState& SpringsContact::move_to(const ObjectPose& pose) {
  if (setup_.round.exponent == 2) {
    return set(field_.layer().press_by_depth(sphere_radius(setup_.round), pose.depth_mm), pose.at_mm, pose.twist_rad);
  }
  return set({.depth_mm = std::max(pose.depth_mm, 0.0)}, pose.at_mm, pose.twist_rad);
}

const ContactState& SpringsContact::press_to(double force_n, Vec2 at_mm, double twist_rad) {
  if (setup_.round.exponent == 2) {
    return set(field_.layer().press_by_force(sphere_radius(setup_.round), force_n), at_mm, twist_rad);
  }
  return set({.depth_mm = springs_.depth_for_force_mm(force_n)}, at_mm, twist_rad);
}

// How much longer a step counts on the half-space: each part of its load is a punch on the stick disc of its time. The
// disc's area shrinks in step with the motion, from the whole contact when the motion has just turned back.
double SpringsContact::step_ratio(double radius_mm, Vec2 way) {
  const bool turned_back = way.x * way_mm_.x + way.y * way_mm_.y < 0.0;
  if (!(way == Vec2{})) way_mm_ = way;
  if (std::isinf(setup_.gel.thickness_mm)) return 1.0;
  const double stick = turned_back ? 1.0 : springs_.state().stick_fraction;
  double shrinks = 0.0;
  if (!setup_.bonded && press_.force_n > 0.0) {
    shrinks = length(way) * stick_ratio(field_.layer(), radius_mm) /
              gross_displacement_mm({setup_.gel, press_, setup_.static_friction});
  }
  const double middle = std::max(stick - 0.5 * shrinks, 0.0);
  return stick_ratio(field_.layer(), radius_mm * std::sqrt(std::min(middle, 1.0)));
}

// `press`: of a sphere, on the layer; of any other body its depth alone, on the half-space.
const ContactState& SpringsContact::set(const Press& press, Vec2 at_mm, double twist_rad) {
  const bool sphere = setup_.round.exponent == 2;
  const double a_mm = std::min(press.contact_radius_mm, setup_.extent_mm);
  // The springs stand on the radius that the layer gives.
  const double depth_mm = sphere ? a_mm * a_mm * 2.0 * setup_.round.coefficient : press.depth_mm;
  const Vec2 slid_before = springs_.state().slid_mm;
  const double turned_slid_before = turns_.state().slid_rad;
  if (!(depth_mm > 0.0) || (sphere && !(a_mm > kLeastRadius_mm))) {
    springs_.move_to(0.0, half_space_mm_);
    turns_.step({}, 0.0, 0.0, 0.0);
    touching_ = turned_ = false;
    press_ = {};
    state_ = {};
    return state_;
  }
  if (!touching_) {
    touching_ = true;
    touched_mm_ = at_mm_ = center_mm_ = at_mm;
    touched_rad_ = at_rad_ = twist_rad;
    half_space_touched_mm_ = half_space_mm_;
    half_space_rad_ = 0.0;
    field_.move_center(center_mm_);
    spring_field_.move_center(center_mm_);
  }
  const Layer& layer = field_.layer();
  const double force_ratio = sphere ? layer.press_ratio(a_mm).force : 1.0;
  const Vec2 way{at_mm.x - at_mm_.x, at_mm.y - at_mm_.y};
  const double scale = sphere ? step_ratio(a_mm, way) : 1.0;
  const Vec2 step{scale * way.x, scale * way.y};
  const double turn = twist_rad - at_rad_;
  turned_ = turned_ || turn != 0.0;

  FrictionShare share;
  const double turn_scale = turned_ && sphere ? turn_ratio(layer, a_mm) : 1.0;
  if (turned_ && !setup_.bonded) {
    // Loads that this step would reach if nothing slipped, over their limits.
    const double stiffness = 8.0 * setup_.gel.shear_modulus_mpa * a_mm / (2.0 - setup_.gel.poisson);
    const double turn_stiffness = 16.0 / 3.0 * setup_.gel.shear_modulus_mpa * a_mm * a_mm * a_mm;
    const SpringState& before = springs_.state();
    const double limit_n = setup_.static_friction * press.force_n;
    const double shear_n = length({before.force_n.x + stiffness * step.x, before.force_n.y + stiffness * step.y});
    const double moment = std::abs(turns_.state().moment_nmm + turn_stiffness * turn_scale * turn);
    share = share_friction(shear_n / limit_n, moment / (3.0 * pi / 16.0 * limit_n * a_mm));
  }
  springs_.scale_friction(share.for_shear * force_ratio);
  const Vec2 strain_before = half_space_mm_ - half_space_touched_mm_ - slid_before;
  half_space_mm_ = half_space_mm_ + step;
  const SpringState& s = springs_.move_to(depth_mm, half_space_mm_);
  press_ = press;
  if (!sphere) {
    press_.force_n = s.normal_force_n;
    press_.contact_radius_mm = s.contact_radius_mm;
  }
  if (turned_) {
    turns_.step(press_, share.for_twist * setup_.static_friction, share.for_twist * setup_.kinetic_friction,
                turn_scale * turn);
  }
  const TwistSpringState& t = turns_.state();
  if (turned_) {
    const double strain_rad = half_space_rad_ - turned_slid_before;
    half_space_rad_ += turn_scale * turn;
    state_.slid_rad = slid_on_layer({twist_rad - touched_rad_, 0.0}, {at_rad_ - touched_rad_, 0.0},
                                    {state_.slid_rad, 0.0}, {(t.slid_rad - turned_slid_before) / turn_scale, 0.0},
                                    {strain_rad, 0.0}, {half_space_rad_ - t.slid_rad, 0.0})
                          .x;
  }
  state_.slid_mm = slid_on_layer(at_mm - touched_mm_, at_mm_ - touched_mm_, state_.slid_mm,
                                 (1.0 / scale) * (s.slid_mm - slid_before), strain_before,
                                 half_space_mm_ - half_space_touched_mm_ - s.slid_mm);
  at_mm_ = at_mm;
  at_rad_ = twist_rad;
  const Vec2 center{touched_mm_.x + state_.slid_mm.x, touched_mm_.y + state_.slid_mm.y};
  if (!(center == center_mm_)) {
    center_mm_ = center;
    field_.move_center(center);
    spring_field_.move_center(center);
  }
  state_.depth_mm = press.depth_mm;
  state_.normal_n = press_.force_n;
  state_.contact_radius_mm = press_.contact_radius_mm;
  const double slip = turned_ ? std::max(s.slip_fraction, t.slip_fraction) : s.slip_fraction;
  state_.gross = s.sliding || (turned_ && t.turning);
  state_.slip_fraction = state_.gross ? 1.0 : slip;
  state_.stick_radius_mm = press_.contact_radius_mm * std::sqrt(1.0 - state_.slip_fraction);
  state_.shear_n = s.force_n;
  state_.moment_nmm = turned_ ? t.moment_nmm : 0.0;
  state_.center_mm = at_mm;
  return state_;
}

void SpringsContact::field(std::span<Vec2> motion_mm) {
  std::fill_n(motion_mm.begin(), field_.size(), Vec2{});
  if (!touching_) return;
  spring_field_.evaluate(springs_.traction(), motion_mm);
  field_.add_press(press_, setup_.static_friction, state_.stick_radius_mm, motion_mm);
  if (!turned_) return;
  field_.add_discs(press_.contact_radius_mm, turns_.discs(), motion_mm);
}

}  // namespace holdfast::scene
