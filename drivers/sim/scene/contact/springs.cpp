// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/springs.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "drivers/sim/scene/contact/limits.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Below this the squares of radii in the traction underflow; no marker sees such a contact.
constexpr double kLeastFieldRadius_mm = 1e-60;

double power(double base, int exponent) {
  double result = 1.0;
  for (int i = 0; i < exponent; ++i) result *= base;
  return result;
}

// value^(1/degree), value >= 0. Newton from above: each step is at least as small as the last until rounding.
double root(double value, int degree) {
  if (!(value > 0.0)) return 0.0;
  if (degree == 1) return value;
  if (degree == 2) return std::sqrt(value);
  int exponent = 0;
  std::frexp(value, &exponent);
  const int above = exponent > 0 ? (exponent + degree - 1) / degree : -(-exponent / degree);
  double x = std::ldexp(1.0, above);
  for (int i = 0; i < 64; ++i) {
    const double lower = power(x, degree - 1);
    // Where the power underflows the value does too: x is as good as any.
    if (!(lower > 0.0)) break;
    const double next = x - (x - value / lower) / degree;
    if (!(next < x)) break;
    x = next;
  }
  return x;
}

// kappa_n = (sqrt(pi) / 2) n Gamma(n/2) / Gamma((n+1)/2), which rises by n / (n - 1) every two.
double reduction_factor(int exponent) {
  double kappa = exponent % 2 == 0 ? 2.0 : 0.5 * pi;
  for (int n = exponent % 2 == 0 ? 4 : 3; n <= exponent; n += 2) kappa *= static_cast<double>(n) / (n - 1);
  return kappa;
}

}  // namespace

Indenter sphere_indenter(double radius_mm) {
  return {radius_mm > 0.0 ? 0.5 / radius_mm : 0.0, 2};
}

SpringContact::SpringContact(const SpringSetup& setup)
    : gel_{positive(setup.gel.shear_modulus_mpa), std::clamp(setup.gel.poisson, 0.0, 0.5)},
      exponent_(std::clamp(setup.indenter.exponent, 1, 8)),
      springs_(std::clamp(setup.springs, 1, kMostSprings)),
      extent_mm_(positive(setup.extent_mm)),
      normal_modulus_(effective_modulus_mpa(gel_)),
      shear_modulus_(4.0 * gel_.shear_modulus_mpa / (2.0 - gel_.poisson)),
      static_friction_(std::max(setup.static_friction, 0.0)),
      kinetic_friction_(std::clamp(setup.kinetic_friction, 0.0, static_friction_)) {
  const double coefficient = positive(setup.indenter.coefficient);
  if (extent_mm_ > 0.0 && gel_.shear_modulus_mpa > 0.0) {
    extent_depth_mm_ = positive(reduction_factor(exponent_) * coefficient * power(extent_mm_, exponent_));
  }
  for (int i = 0; i <= springs_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    edge_[k] = static_cast<double>(i) / springs_;
    profile_integral_[k] = power(edge_[k], exponent_ + 1) / (exponent_ + 1);
  }
}

void SpringContact::scale_friction(double factor) {
  friction_scale_ = std::clamp(factor, 0.0, kMost);
}

// P = 2 E* d a n / (n + 1), and d = g(a).
double SpringContact::depth_for_force_mm(double force_n) const {
  if (!(force_n > 0.0) || !(extent_depth_mm_ > 0.0)) return 0.0;
  const double full_n = 2.0 * normal_modulus_ * extent_depth_mm_ * extent_mm_ * exponent_ / (exponent_ + 1);
  return extent_depth_mm_ * power(root(std::min(force_n / full_n, 1.0), exponent_ + 1), exponent_);
}

double SpringContact::limit_n(int i, bool slips) const {
  const double normal = 2.0 * normal_modulus_ * extent_depth_mm_ * extent_mm_ * line_load_[static_cast<std::size_t>(i)];
  // Infinite friction on no load is no hold.
  return normal > 0.0 && friction_scale_ > 0.0
             ? friction_scale_ * (slips ? kinetic_friction_ : static_friction_) * normal
             : 0.0;
}

// The spring comes to rest after an elastic step to `trial_n`, which its limit held back from `start_limit_n` on.
void SpringContact::settle(int i, Vec2 trial_n, double start_limit_n) {
  const auto k = static_cast<std::size_t>(i);
  const double stiffness = 2.0 * shear_modulus_ * extent_mm_ * width_[k];
  const double trial = length(trial_n);
  if (!(trial > limit_n(i, slips_[k]))) {
    if (trial < kOnLimit * limit_n(i, true)) slips_[k] = false;
    force_n_[k] = trial_n;
    return;
  }
  slips_[k] = true;
  const double limit = limit_n(i, true);
  force_n_[k] = (limit / trial) * trial_n;
  const double slip_mm = (trial - limit) / stiffness;
  if (i == 0) state_.slid_mm = state_.slid_mm + (slip_mm / trial) * trial_n;
  // Slip at the limit, and what the spring held above it when it let go.
  const double shed = std::max(std::min(trial, start_limit_n) - limit, 0.0);
  state_.dissipated_mj += limit * slip_mm + 0.5 * shed * (shed / stiffness);
}

void SpringContact::press_to(double depth_mm) {
  const double depth = extent_depth_mm_ > 0.0 ? std::clamp(depth_mm / extent_depth_mm_, 0.0, 1.0) : 0.0;
  if (depth == rim_depth_) return;
  rim_depth_ = depth;
  rim_ = std::min(root(depth, exponent_), 1.0);
  const int before = touching_;
  touching_ = 0;
  for (int i = 0; i < springs_ && edge_[static_cast<std::size_t>(i)] < rim_; ++i) ++touching_;
  for (int i = 0; i < std::max(before, touching_); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double width = width_[k];
    if (i >= touching_) {
      width_[k] = line_load_[k] = 0.0;
    } else {
      const bool whole = rim_ >= edge_[k + 1];
      const double up_to = whole ? edge_[k + 1] : rim_;
      const double profile = whole ? profile_integral_[k + 1] : power(rim_, exponent_ + 1) / (exponent_ + 1);
      width_[k] = up_to - edge_[k];
      line_load_[k] = std::max(depth * width_[k] - (profile - profile_integral_[k]), 0.0);
    }
    const double force = length(force_n_[k]);
    if (width_[k] < width && force > 0.0) {
      // The part that leaves takes its share of force and energy along.
      const double left = width_[k] / width;
      state_.dissipated_mj += 0.5 * (1.0 - left) * force * (force / (2.0 * shear_modulus_ * extent_mm_ * width));
      force_n_[k] = left * force_n_[k];
    }
    if (i < touching_) {
      settle(i, force_n_[k], force);
    } else {
      force_n_[k] = {};
      slips_[k] = false;
    }
  }
  if (touching_ == 0) state_.slid_mm = {};
}

void SpringContact::travel(Vec2 travel_mm) {
  if (travel_mm == Vec2{}) return;
  for (int i = 0; i < touching_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double stiffness = 2.0 * shear_modulus_ * extent_mm_ * width_[k];
    settle(i, force_n_[k] + stiffness * travel_mm, limit_n(i, slips_[k]));
  }
}

const SpringState& SpringContact::move_to(double depth_mm, Vec2 displacement_mm) {
  press_to(depth_mm);
  const Vec2 to{bounded(displacement_mm.x), bounded(displacement_mm.y)};
  travel(to - state_.displacement_mm);
  return summarize(to);
}

// Radius (of the extent) at which the stick area that ends with this spring ends. The room to the limit is linear in
// the pressure: mu q - G* delta under monotone shear, 2 mu q - G* delta after a reversal.
double SpringContact::stick_edge(int last_stuck) const {
  const auto k = static_cast<std::size_t>(last_stuck);
  const double outer = std::min(edge_[k + 1], rim_);
  const double friction = friction_scale_ * static_friction_;
  if (!(friction > 0.0) || std::isinf(friction)) return outer;
  const double unit_n = 2.0 * normal_modulus_ * extent_depth_mm_ * extent_mm_;
  const auto pressure = [&](std::size_t i) { return line_load_[i] / width_[i]; };
  const auto room = [&](std::size_t i) { return pressure(i) - length(force_n_[i]) / (unit_n * width_[i]) / friction; };
  double slope = 1.0;
  if (k > 0 && !slips_[k - 1]) {
    const double rise = room(k - 1) - room(k);
    const double run = pressure(k - 1) - pressure(k);
    // Just turned back: the room is the same all over, and says nothing yet.
    if (rise < (1.0 - 1e-6) * run) return outer;
    slope = std::clamp(run / rise, 0.5, 1.0);
  }
  const double pressure_there = std::clamp(pressure(k) - slope * room(k), 0.0, rim_depth_);
  const double next = last_stuck + 1 < touching_ ? std::min(edge_[k + 2], rim_) : rim_;
  return std::clamp(root(rim_depth_ - pressure_there, exponent_), edge_[k], next);
}

const SpringState& SpringContact::summarize(Vec2 displacement_mm) {
  SpringState& s = state_;
  s.displacement_mm = displacement_mm;
  s.depth_mm = rim_depth_ * extent_depth_mm_;
  s.contact_radius_mm = rim_ * extent_mm_;
  s.force_n = s.gel_mm = {};
  s.normal_force_n = s.stored_mj = 0.0;
  const double unit_n = 2.0 * normal_modulus_ * extent_depth_mm_ * extent_mm_;
  // Neighbours that stick are one ring, so that a contact that sticks all over does so exactly.
  double stuck = 0.0;
  double inner = 0.0;
  int sticking = 0;
  for (int i = 0; i < touching_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double stiffness = 2.0 * shear_modulus_ * extent_mm_ * width_[k];
    s.normal_force_n += unit_n * line_load_[k];
    s.force_n = s.force_n + force_n_[k];
    const double force = length(force_n_[k]);
    s.stored_mj += 0.5 * force * (force / stiffness);
    if (slips_[k]) continue;
    ++sticking;
    if (i == 0 || slips_[k - 1]) inner = edge_[k] / rim_;
    if (i + 1 < touching_ && !slips_[k + 1]) continue;
    const double outer = stick_edge(i) / rim_;
    stuck += (outer - inner) * (outer + inner);
  }
  s.sliding = touching_ > 0 && sticking == 0;
  s.stick_fraction = std::clamp(stuck, 0.0, 1.0);
  s.slip_fraction = touching_ > 0 ? 1.0 - s.stick_fraction : 0.0;
  s.stick_radius_mm = s.contact_radius_mm * std::sqrt(s.stick_fraction);
  if (touching_ > 0) {
    const double stiffness = 2.0 * shear_modulus_ * extent_mm_ * width_[0];
    s.gel_mm = {force_n_[0].x / stiffness, force_n_[0].y / stiffness};
  }
  return s;
}

// Each spring's mean is the value of the line load at its mean x^2, if the load is linear in x^2 there (slip under a
// sphere: exactly). Inside the first knot the load is constant; between the last and the rim it falls to the part
// that the spring would carry there with endless friction: nothing if it slips.
Traction SpringContact::traction() const {
  Traction result;
  const double a = rim_ * extent_mm_;
  if (touching_ == 0 || !(a > kLeastFieldRadius_mm)) return result;
  const auto knot = [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    const double inner = edge_[k];
    const double outer = inner + width_[k];
    return (inner * inner + inner * outer + outer * outer) / 3.0;
  };
  const auto line_load = [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    return (1.0 / (2.0 * extent_mm_ * width_[k])) * force_n_[k];
  };
  const int last = touching_ - 1;
  const double hold = limit_n(last, false);
  const double carried = length(force_n_[static_cast<std::size_t>(last)]);
  const double step_share = slips_[static_cast<std::size_t>(last)] || !(hold > 0.0) ? 0.0 : 1.0 - carried / hold;
  const Vec2 step = std::clamp(step_share, 0.0, 1.0) * line_load(last);
  result.punch_radius_mm = a;
  result.punch_n = 2.0 * a * step;  // the springs under a punch carry the same everywhere
  result.count = touching_ + 1;
  double most = 0.0;
  for (int i = 0; i < touching_; ++i) most = std::max(most, length(line_load(i)));

  Vec2 slope_before;
  double knot_before = 0.0;
  for (int i = 0; i <= touching_; ++i) {
    const bool rim = i == touching_;
    const double here = rim ? rim_ * rim_ : knot(i);
    Vec2 slope;
    double reach = here - knot_before;
    if (!rim) {
      const double next = i == last ? rim_ * rim_ : knot(i + 1);
      const Vec2 fall = line_load(i) - (i == last ? step : line_load(i + 1));
      if (next > here) slope = (1.0 / ((next - here) * extent_mm_ * extent_mm_)) * fall;
      reach = next - knot_before;
    }
    Vec2 change = slope_before - slope;
    // Rounding alone: leaving it out costs the field about 1e-12.
    if (length(change) * reach * extent_mm_ * extent_mm_ <= 1e-13 * most) change = {};
    result.domes[static_cast<std::size_t>(i)] = {std::sqrt(here) * extent_mm_, (2.0 / pi) * change};
    slope_before = slope;
    knot_before = here;
  }
  return result;
}

SpringField::SpringField(Layer layer, std::span<const Vec2> points_mm)
    : layer_(std::move(layer)), points_mm_(points_mm.begin(), points_mm.end()) {
  for (auto* numbers : {&r_mm_, &cos_2_, &sin_2_, &mean_x_, &mean_y_, &fan_x_, &fan_y_})
    numbers->resize(points_mm.size());
  move_center({});
}

void SpringField::move_center(Vec2 center_mm) {
  center_mm_ = center_mm;
  for (std::size_t p = 0; p < points_mm_.size(); ++p) {
    const Vec2 from = points_mm_[p] - center_mm;
    const double r = length(from);
    r_mm_[p] = r;
    const Vec2 unit = r > 0.0 ? Vec2{from.x / r, from.y / r} : Vec2{1.0, 0.0};
    cos_2_[p] = (unit.x - unit.y) * (unit.x + unit.y);
    sin_2_[p] = 2.0 * unit.x * unit.y;
  }
  for (Column& column : dome_) column.radius_mm = -1.0;
  punch_.radius_mm = -1.0;
}

void SpringField::add(Column& column, bool punch, double radius_mm, Vec2 strength) {
  if (strength == Vec2{}) return;
  const std::size_t points = points_mm_.size();
  if (column.radius_mm != radius_mm) {
    column.radius_mm = radius_mm;
    column.mean.resize(points);
    column.fan.resize(points);
    if (punch) {
      layer_.punch(radius_mm, r_mm_, column.mean, column.fan);
    } else {
      layer_.dome(radius_mm, r_mm_, column.mean, column.fan);
    }
  }
  const double* mean = column.mean.data();
  const double* fan = column.fan.data();
  for (std::size_t p = 0; p < points; ++p) {
    mean_x_[p] += mean[p] * strength.x;
    mean_y_[p] += mean[p] * strength.y;
    fan_x_[p] += fan[p] * strength.x;
    fan_y_[p] += fan[p] * strength.y;
  }
}

void SpringField::evaluate(const Traction& traction, std::span<Vec2> motion_mm) {
  for (auto* sums : {&mean_x_, &mean_y_, &fan_x_, &fan_y_}) std::fill(sums->begin(), sums->end(), 0.0);
  for (std::size_t i = 0; i < static_cast<std::size_t>(traction.count); ++i) {
    add(dome_[i], false, traction.domes[i].radius_mm, traction.domes[i].slope_mpa_per_mm);
  }
  add(punch_, true, traction.punch_radius_mm, traction.punch_n);
  // A load along y sees the direction turned back by a right angle: its fan has the other sign.
  for (std::size_t p = 0; p < points_mm_.size(); ++p) {
    motion_mm[p] = {mean_x_[p] + cos_2_[p] * fan_x_[p] + sin_2_[p] * fan_y_[p],
                    mean_y_[p] + sin_2_[p] * fan_x_[p] - cos_2_[p] * fan_y_[p]};
  }
}

}  // namespace holdfast::scene
