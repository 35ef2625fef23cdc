// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/grasp.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "drivers/sim/scene/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Times closer than this are the same: k / fps and a sum of phases must agree on which frame starts a phase.
constexpr double kSameTime_s = 1e-9;

bool reached(double t_s, double start_s) {
  return t_s > start_s - kSameTime_s;
}

double since(double t_s, double start_s) {
  const double elapsed_s = t_s - start_s;
  return elapsed_s > kSameTime_s ? elapsed_s : 0.0;
}

bool never_slips(const GraspConfig& config) {
  return config.bonded || config.motion == Motion::kShake;
}

FrictionContact coulomb_contact(const GraspConfig& config, double normal_n) {
  return {config.gel, press_sphere(config.gel, config.sphere_radius_mm, normal_n), config.friction};
}

FrictionContact real_contact(const GraspConfig& config, double normal_n) {
  FrictionContact contact = coulomb_contact(config, normal_n);
  if (never_slips(config)) contact.friction = std::numeric_limits<double>::infinity();
  return contact;
}

// Start of each phase.
struct Timeline {
  double press_s, hold_s, shear_s, slide_s, release_s, empty_s, end_s;
};

Timeline timeline(const GraspConfig& config) {
  Timeline t{};
  t.press_s = config.empty_s;
  t.hold_s = t.press_s + config.press_s;
  t.shear_s = t.hold_s + config.hold_s;
  // The whole of the partial slip; the matched pair and the shake keep the same times.
  t.slide_s = t.shear_s + gross_displacement_mm(coulomb_contact(config, config.press_n)) / config.speed_mm_s;
  t.release_s = t.slide_s + config.slide_s;
  t.empty_s = t.release_s + config.release_s;
  t.end_s = t.empty_s + config.empty_s;
  return t;
}

Phase phase_at(const GraspConfig& config, const Timeline& t, double t_s) {
  if (!reached(t_s, t.press_s) || reached(t_s, t.empty_s)) return Phase::kEmpty;
  if (reached(t_s, t.release_s)) return Phase::kRelease;
  if (!reached(t_s, t.hold_s)) return Phase::kPress;
  if (!reached(t_s, t.shear_s)) return Phase::kHold;
  if (config.motion == Motion::kShake) return Phase::kShake;
  if (!reached(t_s, t.slide_s)) return Phase::kShear;
  return config.bonded ? Phase::kHold : Phase::kSlide;
}

double normal_at(const GraspConfig& config, const Timeline& t, Phase phase, double t_s) {
  switch (phase) {
    case Phase::kEmpty:
      return 0.0;
    case Phase::kPress:
      return config.press_n * since(t_s, t.press_s) / config.press_s;
    case Phase::kRelease:
      return config.press_n * (1.0 - since(t_s, t.release_s) / config.release_s);
    default:
      return config.press_n;
  }
}

Vec2 direction(const GraspConfig& config) {
  const double angle = config.direction_deg * pi / 180.0;
  return {portable::cos(angle), portable::sin(angle)};
}

Vec2 moved(Vec2 from, Vec2 along, double by) {
  return {from.x + along.x * by, from.y + along.y * by};
}

}  // namespace

GraspConfig without_slip(GraspConfig config) {
  config.bonded = true;
  return config;
}

GraspConfig shaken(GraspConfig config) {
  config.motion = Motion::kShake;
  return config;
}

std::string_view name(Phase phase) {
  switch (phase) {
    case Phase::kEmpty:
      return "empty";
    case Phase::kPress:
      return "press";
    case Phase::kHold:
      return "hold";
    case Phase::kShear:
      return "shear";
    case Phase::kSlide:
      return "slide";
    case Phase::kShake:
      return "shake";
    case Phase::kRelease:
      return "release";
  }
  return "";
}

double duration_s(const GraspConfig& config) {
  return timeline(config).end_s;
}

int frame_count(const GraspConfig& config) {
  return static_cast<int>(std::floor((duration_s(config) + kSameTime_s) * config.fps)) + 1;
}

GraspTruth at(const GraspConfig& config, double t_s) {
  const Timeline t = timeline(config);
  GraspTruth truth;
  truth.time_s = t_s;
  truth.phase = phase_at(config, t, t_s);
  truth.contact_center_mm = config.touch_mm;
  truth.normal_n = normal_at(config, t, truth.phase, t_s);

  const FrictionContact contact = real_contact(config, truth.normal_n);
  const double moving_s = since(t_s, t.shear_s);
  Shear shear;
  if (config.motion == Motion::kShake) {
    const double load = config.shake_load * config.friction * truth.normal_n;
    shear = shear_by_force(contact, load * portable::sin(2.0 * pi * config.shake_hz * moving_s));
  } else {
    // The object stops when the release begins and the gel springs back under it.
    const double way_mm = config.speed_mm_s * std::min(moving_s, t.release_s - t.shear_s);
    const Shear loads = shear_by_displacement(coulomb_contact(config, truth.normal_n), way_mm);
    shear = config.bonded ? shear_by_force(contact, loads.force_n) : loads;
    if (shear.sliding) truth.travel_mm = way_mm - shear.displacement_mm;
  }
  truth.shear_n = shear.force_n;
  truth.contact_radius_mm = contact.press.contact_radius_mm;
  truth.stick_radius_mm = shear.stick_radius_mm;
  truth.depth_mm = contact.press.depth_mm;
  truth.slip_fraction = slip_fraction(contact, shear);
  truth.gross = shear.sliding;
  truth.displacement_mm = shear.displacement_mm;
  truth.contact_center_mm = moved(config.touch_mm, direction(config), truth.displacement_mm + truth.travel_mm);
  return truth;
}

SlipLevel slip_level(const GraspTruth& truth) {
  return slip_level(truth.slip_fraction, truth.gross);
}

std::optional<double> onset_s(const GraspConfig& config, SlipLevel level) {
  const Timeline t = timeline(config);
  if (level == SlipLevel::kNone) return 0.0;
  if (never_slips(config) || !(config.press_n > 0.0)) return std::nullopt;
  switch (level) {
    case SlipLevel::kAnnulus:
      return t.shear_s;
    case SlipLevel::kHalf:
      return t.shear_s + kHalfSlip * (t.slide_s - t.shear_s);
    default:
      return t.slide_s;
  }
}

std::vector<MarkerTruth> markers_at(const GraspConfig& config, const GraspTruth& truth, const MarkerGrid& grid) {
  const FrictionContact contact = real_contact(config, truth.normal_n);
  const Shear shear{truth.shear_n, truth.displacement_mm, truth.stick_radius_mm, truth.gross};
  const Vec2 along = direction(config);
  // Where on the undeformed gel the contact lies: travel moves it, the gel's own motion does not.
  const Vec2 center = moved(config.touch_mm, along, truth.travel_mm);
  const double a = contact.press.contact_radius_mm;

  std::vector<MarkerTruth> markers;
  markers.reserve(static_cast<std::size_t>(grid.rows) * static_cast<std::size_t>(grid.cols));
  for (int row = 0; row < grid.rows; ++row) {
    for (int col = 0; col < grid.cols; ++col) {
      MarkerTruth marker;
      marker.rest_mm = {(col - 0.5 * (grid.cols - 1)) * grid.pitch_mm, (row - 0.5 * (grid.rows - 1)) * grid.pitch_mm};
      const Vec2 from{marker.rest_mm.x - center.x, marker.rest_mm.y - center.y};
      // The field knows a load along +x: turn there and back.
      const Vec2 turned{from.x * along.x + from.y * along.y, from.y * along.x - from.x * along.y};
      const Vec2 u = shear_field_mm(contact, shear, turned);
      double outward = 0.0;
      if (a > 0.0) {
        const double r2 = (from.x * from.x + from.y * from.y) / (a * a);
        outward = config.press_dilation * contact.press.depth_mm / a * portable::exp(0.5 * (1.0 - r2));
      }
      marker.displacement_mm = {u.x * along.x - u.y * along.y + outward * from.x,
                                u.x * along.y + u.y * along.x + outward * from.y};
      markers.push_back(marker);
    }
  }
  return markers;
}

}  // namespace holdfast::scene
