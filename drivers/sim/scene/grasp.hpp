// SPDX-License-Identifier: Apache-2.0
// A scripted grasp as a function of time: a sphere comes down on the gel, is dragged until it slides, and
// leaves. Everything a test may want to know about any instant follows from (config, time) alone.
//
// Modelled
//   * normal force in ramps; the drag moves the object at constant speed, so the slip fraction grows linearly
//     with time (1 - (c/a)^2 = delta / delta_gross) and gross slip begins at a known time
//   * in gross sliding the contact travels over the gel with the object
//   * press dilation, FOTS's form: radial, outward, dilation * depth * (r/a) exp((1 - r^2/a^2) / 2),
//     largest at the rim. Half-space theory has none for an incompressible gel; the real one comes from
//     the gel's thickness
//
// Not modelled
//   * everything listed in contact_closed.hpp; static against kinetic friction; stick-slip; twist; creep
//   * the rest of a load after it was taken away: during release each instant is computed from its own loads
//
// Figures: G and mu lie in the range reported for this gel (G 30-115 kPa, mu 0.2-1.2), radius as in the
// mechanics studies. With 3 N they give a = 4.4 mm and 0.96 mm (15 px of 320) in the centre of sliding, more
// than a firm shake of a real object moves (0.2-6 px mean) and less than the largest seen on a real sensor
// (42 px). The dilation of 0.06 (1.2 px at the rim) is chosen, not measured.
//
// Units: mm, N, MPa, seconds. Axes of the picture: +x right, +y down, 0 = centre of the grid.
// Range: fps, speed and force > 0, durations >= 0.
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/contact.hpp"

namespace holdfast::scene {

enum class Motion {
  kDrag,   // moves on at constant speed: partial slip, then gross slip
  kShake,  // back and forth around the place of first touch; always bonded
};

struct GraspConfig {
  double fps = 25.0;
  Gel gel;
  double sphere_radius_mm = 15.0;
  double friction = 0.5;  // sets the shear load, and the slip unless bonded
  bool bonded = false;    // same loads, but the surface never lets go
  double press_n = 3.0;
  double press_dilation = 0.06;
  Vec2 touch_mm{0.4, -0.3};  // off the grid's symmetry on purpose
  Motion motion = Motion::kDrag;
  double direction_deg = 20.0;  // of the drag or shake, from +x towards +y
  double speed_mm_s = 1.0;
  double shake_hz = 2.5;
  double shake_load = 0.8;  // amplitude as a share of mu P
  double empty_s = 0.48;    // before and after
  double press_s = 0.60;
  double hold_s = 0.40;
  double slide_s = 1.20;
  double release_s = 0.40;
};

// The matched pair of a grasp: the same forces at the same times, and no point of the contact slips. Any
// finite friction slips in a thin ring at the rim, so this is the limit of infinite friction.
[[nodiscard]] GraspConfig without_slip(GraspConfig config);
// The same press, shaken instead of dragged, without slip.
[[nodiscard]] GraspConfig shaken(GraspConfig config);

enum class Phase { kEmpty, kPress, kHold, kShear, kSlide, kShake, kRelease };
[[nodiscard]] std::string_view name(Phase phase);

struct GraspTruth {
  double time_s = 0.0;
  Phase phase = Phase::kEmpty;
  double normal_n = 0.0;
  double shear_n = 0.0;  // along direction_deg; signed
  double contact_radius_mm = 0.0;
  double stick_radius_mm = 0.0;
  double depth_mm = 0.0;
  double slip_fraction = 0.0;    // 1 - (c/a)^2 of the contact's area; 1 in gross sliding, 0 without contact
  bool gross = false;            // every point of the contact slides
  double displacement_mm = 0.0;  // the object against the gel's far base, without its travel
  double travel_mm = 0.0;        // the object against the gel it lies on: what "slip" means to a gripper
  Vec2 contact_center_mm;        // of the imprint, as the camera sees it
};

[[nodiscard]] double duration_s(const GraspConfig& config);
[[nodiscard]] int frame_count(const GraspConfig& config);
// Any time; before 0 and after the end the gel is empty.
[[nodiscard]] GraspTruth at(const GraspConfig& config, double t_s);

[[nodiscard]] SlipLevel slip_level(const GraspTruth& truth);
// The instant from which slip_level is at least `level`; none when the grasp never gets there.
[[nodiscard]] std::optional<double> onset_s(const GraspConfig& config, SlipLevel level);

struct MarkerTruth {
  Vec2 rest_mm;
  Vec2 displacement_mm;
};

// Shape: rows x cols, index = row * cols + col, row 0 at the top.
[[nodiscard]] std::vector<MarkerTruth> markers_at(const GraspConfig& config, const GraspTruth& truth,
                                                  const MarkerGrid& grid);

}  // namespace holdfast::scene
