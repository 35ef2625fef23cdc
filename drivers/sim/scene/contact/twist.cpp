// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/twist.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "drivers/sim/scene/contact/limits.hpp"
#include "drivers/sim/scene/math/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

constexpr double kMostTwist = 6.907755278982137;  // ln(a/c) at c = a / 1000
constexpr double kLimit = 3.0 * pi / 16.0;        // M_max / (mu P a)
// Beyond this r/s the closed form of U loses (r/s)^2 digits; the series is good to 1e-13 there.
constexpr double kFarField = 30.0;
// Two springs of a stick disc that has no history have turned alike, up to roundings of many steps.
constexpr double kSameTurn = 1e-9;

struct Node {
  double at;
  double weight;
};
// Gauss and Legendre's on [0, 1].
constexpr std::array<Node, 6> kSix{{{0.03376524289842398, 0.08566224618958517},
                                    {0.16939530676686774, 0.18038078652406930},
                                    {0.38069040695840154, 0.23395696728634552},
                                    {0.61930959304159845, 0.23395696728634552},
                                    {0.83060469323313225, 0.18038078652406930},
                                    {0.96623475710157601, 0.08566224618958517}}};
// Complete elliptic integrals of the modulus k; s = sqrt(1 - k^2) > 0.
struct Elliptic {
  double e;          // E
  double k_minus_e;  // K - E
};

// Gauss's arithmetic-geometric mean, with K - E = K (c0^2 + 2 c1^2 + 4 c2^2 ...) / 2: nothing cancels for small k.
Elliptic elliptic(double s, double k2) {
  double mean = 1.0;
  double geometric = s;
  double c2 = k2;
  double share = 0.5;
  double sum = 0.5 * k2;
  while (share * c2 > 1e-18 * sum) {
    const double next = 0.5 * (mean + geometric);
    geometric = std::sqrt(mean * geometric);
    mean = next;
    c2 = (c2 / mean) * (c2 / mean) / 16.0;
    share *= 2.0;
    sum += share * c2;
  }
  const double k = 0.5 * pi / mean;
  return {k * (1.0 - sum), k * sum};
}

// G a^2 beta / (mu P) = (3 / 4 pi) (K - E); its slope by t is (3 / 4 pi) E.
constexpr double kAngle = 3.0 / (4.0 * pi);

// U(r, s) / r for e = s / r < 1.
double lag(double e) {
  const double e2 = e * e;
  if (e * kFarField < 1.0) return 2.0 / pi * e * e2 * (2.0 / 3.0 + e2 * (0.2 + e2 * (3.0 / 28.0 + e2 * (5.0 / 72.0))));
  return 2.0 / pi * (portable::asin(e) - e * std::sqrt((1.0 - e) * (1.0 + e)));
}

// Integral of U(r, s) / r over e = s / r, from 0.
double lag_integral(double e) {
  if (e >= 1.0) return e - 8.0 / (3.0 * pi);
  const double w2 = (1.0 - e) * (1.0 + e);
  return 2.0 / pi * (e * portable::asin(e) + std::sqrt(w2) * (1.0 + w2 / 3.0) - 4.0 / 3.0);
}

// What Lubkin's stick disc of radius x holds up to, summed over the rings outside x: the integral of
// s^2 G a^2 beta(s) / (mu P) from x to 1, without the 16. Cubic Hermite between exact values and slopes: off by at most
// 5e-13.
class HoldTable {
 public:
  HoldTable() {
    value_.back() = slope_.back() = 0.0;
    for (std::size_t i = kCells; i-- > 0;) {
      double sum = 0.0;
      for (const Node& node : kSix) sum += node.weight * slope_at((static_cast<double>(i) + node.at) / kCells);
      value_[i] = value_[i + 1] - sum / kCells;
      slope_[i] = slope_at(static_cast<double>(i) / kCells);
    }
  }
  [[nodiscard]] double at(double x) const {
    const double place = std::clamp(x, 0.0, 1.0) * kCells;
    const auto i = std::min(static_cast<std::size_t>(place), kCells - 1);
    const double u = place - static_cast<double>(i);
    const double v = 1.0 - u;
    return v * v * ((1.0 + 2.0 * u) * value_[i] + u / kCells * slope_[i]) +
           u * u * ((1.0 + 2.0 * v) * value_[i + 1] - v / kCells * slope_[i + 1]);
  }

 private:
  static constexpr std::size_t kCells = 2048;
  static double slope_at(double x) {
    return x > 0.0 ? -x * x * kAngle * elliptic(x, (1.0 - x) * (1.0 + x)).k_minus_e : 0.0;
  }
  std::array<double, kCells + 1> value_{};
  std::array<double, kCells + 1> slope_{};
};

const HoldTable& hold_table() {
  static const HoldTable table;  // 1 ms, once
  return table;
}

}  // namespace

double disc_moment_nmm(const Gel& gel, const TwistDiscs::Disc& disc) {
  const double r = disc.radius_mm;
  return 16.0 / 3.0 * gel.shear_modulus_mpa * disc.turn_rad * r * (r * r + disc.spread_mm * disc.spread_mm);
}

double disc_motion_mm(const TwistDiscs::Disc& disc, double r) {
  if (!(disc.radius_mm > 0.0)) return 0.0;
  const double inner = disc.radius_mm - disc.spread_mm;
  const double outer = disc.radius_mm + disc.spread_mm;
  if (r <= inner) return disc.turn_rad * r;
  const double e = disc.radius_mm / r;
  const double d = disc.spread_mm / r;
  // Discs too alike for a difference to have digits.
  if (!(disc.spread_mm > 1e-7 * disc.radius_mm)) return disc.turn_rad * r * lag(std::min(e, 1.0));
  // At a distance the integrals cancel; there U is as good as its first two terms.
  if (r >= 2.0 * outer) {
    const double w2 = (1.0 - e) * (1.0 + e);
    const double bend = 2.0 / pi * (4.0 * e + 2.0 * e * e * e / w2) / std::sqrt(w2);
    return disc.turn_rad * r * (lag(e) + d * d / 6.0 * bend);
  }
  return disc.turn_rad * r * (lag_integral(outer / r) - lag_integral(inner / r)) / (2.0 * d);
}

TwistSprings::TwistSprings(const TwistSpringSetup& setup)
    : shear_modulus_(positive(setup.shear_modulus_mpa)),
      extent_mm_(positive(setup.extent_mm)),
      springs_(static_cast<std::size_t>(std::clamp(setup.springs, 1, kMostTwistSprings))) {
  for (std::size_t k = 0; k <= springs_; ++k) edge_[k] = static_cast<double>(k) / static_cast<double>(springs_);
}

// (16/3) G (outer^3 - inner^3).
double TwistSprings::stiffness(std::size_t k) const {
  const double inner = edge_[k];
  const double outer = outer_[k];
  return 16.0 / 3.0 * shear_modulus_ * extent_mm_ * extent_mm_ * extent_mm_ * (outer - inner) *
         (outer * outer + outer * inner + inner * inner);
}

// Where a spring's average over s^2 ds is the value, if that is straight in s.
double TwistSprings::center(std::size_t k) const {
  const double inner = edge_[k];
  const double outer = outer_[k];
  return 0.75 * (outer + inner) * (outer * outer + inner * inner) / (outer * outer + outer * inner + inner * inner);
}

double TwistSprings::limit_nmm(std::size_t k, bool slips) const {
  // Infinite friction on no load is no hold.
  return hold_nmm_[k] > 0.0 ? (slips ? kinetic_friction_ : static_friction_) * hold_nmm_[k] : 0.0;
}

// The spring comes to rest after an elastic step to `trial_nmm`, which its limit held back from `start_limit_nmm` on.
void TwistSprings::settle(std::size_t k, double trial_nmm, double start_limit_nmm) {
  const double trial = std::abs(trial_nmm);
  if (!(trial > limit_nmm(k, slips_[k]))) {
    if (trial < kOnLimit * limit_nmm(k, true)) slips_[k] = false;
    moment_nmm_[k] = trial_nmm;
    return;
  }
  slips_[k] = true;
  const double limit = limit_nmm(k, true);
  moment_nmm_[k] = std::copysign(limit, trial_nmm);
  const double slip_rad = (trial - limit) / stiffness(k);
  if (k == 0) state_.slid_rad += std::copysign(slip_rad, trial_nmm);
  // Slip at the limit, and what the spring held above it when it let go.
  const double shed = std::max(std::min(trial, start_limit_nmm) - limit, 0.0);
  state_.dissipated_mj += limit * slip_rad + 0.5 * shed * (shed / stiffness(k));
}

void TwistSprings::press_to(const Press& press) {
  const double a =
      extent_mm_ > 0.0 && shear_modulus_ > 0.0 && press.force_n > 0.0 ? positive(press.contact_radius_mm) : 0.0;
  rim_ = a > 0.0 ? std::min(a / extent_mm_, 1.0) : 0.0;
  const double unit_nmm = 16.0 * positive(press.force_n) * a;
  const std::size_t before = touching_;
  touching_ = 0;
  while (touching_ < springs_ && edge_[touching_] < rim_) ++touching_;
  double beyond = hold_table().at(0.0);
  for (std::size_t k = 0; k < std::max(before, touching_); ++k) {
    const double stood = k < before ? stiffness(k) : 0.0;
    const double held = std::abs(moment_nmm_[k]);
    outer_[k] = std::max(std::min(edge_[k + 1], rim_), edge_[k]);
    const double stands = stiffness(k);
    if (stands < stood && held > 0.0) {
      // The part that leaves takes its share of moment and energy along.
      const double left = stands / stood;
      state_.dissipated_mj += 0.5 * (1.0 - left) * held * (held / stood);
      moment_nmm_[k] *= left;
    }
    if (k < touching_) {
      const double rest = hold_table().at(outer_[k] * extent_mm_ / a);
      hold_nmm_[k] = unit_nmm * std::max(beyond - rest, 0.0);
      beyond = rest;
      settle(k, moment_nmm_[k], held);
    } else {
      hold_nmm_[k] = moment_nmm_[k] = 0.0;
      slips_[k] = false;
    }
  }
  if (touching_ == 0) state_.slid_rad = 0.0;
}

void TwistSprings::turn(double turn_rad) {
  if (turn_rad == 0.0) return;
  for (std::size_t k = 0; k < touching_; ++k) {
    settle(k, moment_nmm_[k] + stiffness(k) * turn_rad, limit_nmm(k, slips_[k]));
  }
}

const TwistSpringState& TwistSprings::step(const Press& press, double static_friction, double kinetic_friction,
                                           double turn_rad) {
  static_friction_ = std::max(static_friction, 0.0);
  kinetic_friction_ = std::clamp(kinetic_friction, 0.0, static_friction_);
  press_to(press);
  turn(bounded(turn_rad));
  summarize();
  return state_;
}

// Radius at which the stick area that ends with this spring ends. The room to the limit is linear in the limit's own
// angle: mu y - beta in a first twist, 2 mu y - beta after a reversal.
double TwistSprings::stick_edge(std::size_t k) const {
  const double outer = outer_[k];
  if (!(static_friction_ > 0.0) || std::isinf(static_friction_)) return outer;
  const auto yield = [&](std::size_t i) { return hold_nmm_[i] / stiffness(i); };
  const auto room = [&](std::size_t i) {
    return yield(i) - std::abs(moment_nmm_[i]) / stiffness(i) / static_friction_;
  };
  double slope = 1.0;
  if (k > 0 && !slips_[k - 1]) {
    const double rise = room(k - 1) - room(k);
    const double run = yield(k - 1) - yield(k);
    // Just turned back: the room is the same all over, and says nothing yet.
    if (rise < (1.0 - 1e-6) * run) return outer;
    slope = std::clamp(run / rise, 0.5, 1.0);
  }
  const bool last = k + 1 == touching_;
  const double next = last ? rim_ : center(k + 1);
  const double fall = yield(k) - (last ? 0.0 : yield(k + 1));
  const double share = fall > 0.0 ? std::clamp(slope * room(k) / fall, 0.0, 1.0) : 1.0;
  return std::clamp(center(k) + share * (next - center(k)), edge_[k], last ? rim_ : outer_[k + 1]);
}

void TwistSprings::summarize() {
  TwistSpringState& s = state_;
  s.contact_radius_mm = rim_ * extent_mm_;
  s.moment_nmm = s.stored_mj = s.gel_rad = 0.0;
  // Neighbours that stick are one ring, so that a contact that sticks all over does so exactly.
  double stuck = 0.0;
  double inner = 0.0;
  bool sticking = false;
  for (std::size_t k = 0; k < touching_; ++k) {
    s.moment_nmm += moment_nmm_[k];
    s.stored_mj += 0.5 * moment_nmm_[k] * (moment_nmm_[k] / stiffness(k));
    if (slips_[k]) continue;
    sticking = true;
    if (k == 0 || slips_[k - 1]) inner = edge_[k] / rim_;
    if (k + 1 < touching_ && !slips_[k + 1]) continue;
    const double outer = stick_edge(k) / rim_;
    stuck += (outer - inner) * (outer + inner);
  }
  s.turning = touching_ > 0 && !sticking;
  s.stick_fraction = std::clamp(stuck, 0.0, 1.0);
  s.slip_fraction = touching_ > 0 ? 1.0 - s.stick_fraction : 0.0;
  s.stick_radius_mm = s.contact_radius_mm * std::sqrt(s.stick_fraction);
  if (touching_ > 0) s.gel_rad = moment_nmm_[0] / stiffness(0);
}

// A ring's turn is the sum of the discs larger than it: between two rings it falls by their difference. Where a stick
// disc without history ends between the two, none of that is inside it. Otherwise the turn of the last ring falls,
// between it and the rim, to the part that it would have there with endless friction: nothing if the ring slips.
TwistDiscs TwistSprings::discs() const {
  TwistDiscs result;
  if (touching_ == 0) return result;
  std::size_t count = 0;
  const auto between = [&](double inner, double outer, double turn_rad) {
    result.discs[count++] = {0.5 * (inner + outer) * extent_mm_, turn_rad, 0.5 * (outer - inner) * extent_mm_};
  };
  const auto turned = [&](std::size_t k) { return moment_nmm_[k] / stiffness(k); };
  const std::size_t last = touching_ - 1;
  const auto disc_ends = [&](std::size_t k) {
    return !slips_[k] && (k == last || slips_[k + 1]) &&
           (k == 0 || std::abs(turned(k) - turned(k - 1)) <= kSameTurn * std::abs(turned(k)));
  };
  for (std::size_t k = 0; k < last; ++k) {
    between(disc_ends(k) ? stick_edge(k) : center(k), center(k + 1), turned(k) - turned(k + 1));
  }
  if (disc_ends(last)) {
    between(stick_edge(last), rim_, turned(last));
  } else {
    const double hold = limit_nmm(last, false);
    const double step =
        slips_[last] || !(hold > 0.0) ? 0.0 : std::clamp(1.0 - std::abs(moment_nmm_[last]) / hold, 0.0, 1.0);
    between(center(last), rim_, (1.0 - step) * turned(last));
    between(rim_, rim_, step * turned(last));
  }
  result.count = static_cast<int>(count);
  return result;
}

FrictionShare share_friction(double shear_load, double twist_load) {
  double shear = std::abs(shear_load);
  double twist = std::abs(twist_load);
  if (!(shear > 0.0)) shear = 0.0;
  if (!(twist > 0.0)) twist = 0.0;
  if (shear <= 1.0 && twist <= 1.0 && shear * shear + twist * twist <= 1.0) {
    return {std::sqrt(1.0 - twist * twist), std::sqrt(1.0 - shear * shear)};
  }
  const double most = std::max(shear, twist);
  if (std::isinf(most)) {
    shear = std::isinf(shear) ? 1.0 : 0.0;
    twist = std::isinf(twist) ? 1.0 : 0.0;
  } else {
    shear /= most;
    twist /= most;
  }
  const double length = std::sqrt(shear * shear + twist * twist);
  return {shear / length, twist / length};
}

}  // namespace holdfast::scene
