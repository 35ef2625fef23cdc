// SPDX-License-Identifier: Apache-2.0
// What every contact level answers: where the object is goes in, what the contact does and how the gel's surface moves
// comes out. The levels differ in what they model and in what they cost; a scene chooses one (scene.hpp).
//
// Units: mm, N, N mm, rad. Axes of the picture: +x right, +y down, 0 = centre of the grid; a positive twist turns +x
// towards +y. "The gel" is its surface; its base is bonded to the glass and does not move.
#pragma once

#include <span>

#include "drivers/sim/scene/contact/hertz.hpp"

namespace holdfast::scene {

struct ObjectPose {
  double depth_mm = 0.0;  // of the lowest point below the undeformed surface; <= 0 = no contact
  Vec2 at_mm;             // of the object's own origin, over the undeformed gel
  double twist_rad = 0.0;
};

struct ContactState {
  double depth_mm = 0.0;
  double normal_n = 0.0;
  double contact_radius_mm = 0.0;  // of the disc of the contact's area; 0 = no contact
  double stick_radius_mm = 0.0;    // of the disc of the stick area
  double slip_fraction = 0.0;      // share of the contact's area that slips or last slipped; 0 without contact
  bool gross = false;              // every point of the contact is on its friction limit
  Vec2 shear_n;                    // that the object lays on the gel
  double moment_nmm = 0.0;         // likewise, about the centre of the contact
  Vec2 slid_mm;                    // the object against the gel under it, since they touched
  double slid_rad = 0.0;           // likewise, turned
  Vec2 center_mm;                  // of the contact, where the camera sees it
};

// What labels are made of, the only place that knows the thresholds: annulus = some of the contact slips (fraction >
// 0), half = more than half of its area, gross = all of it.
enum class SlipLevel { kNone, kAnnulus, kHalf, kGross };
inline constexpr double kHalfSlip = 0.5;
[[nodiscard]] constexpr SlipLevel slip_level(double slip_fraction, bool gross) {
  if (gross) return SlipLevel::kGross;
  if (slip_fraction > kHalfSlip) return SlipLevel::kHalf;
  return slip_fraction > 0.0 ? SlipLevel::kAnnulus : SlipLevel::kNone;
}

// The printed dots, centred on the axes. Index of a marker = row * cols + col, row 0 at the top.
struct MarkerGrid {
  int rows = 7;
  int cols = 9;
  double pitch_mm = 2.02;  // measured on recordings of the 7x9 gel
};

class Contact {
 public:
  Contact() = default;
  Contact(const Contact&) = delete;
  Contact& operator=(const Contact&) = delete;
  virtual ~Contact() = default;

  // Object to this pose, on the straight way from the last one. The state stays valid until the next call.
  virtual const ContactState& move_to(const ObjectPose& pose) = 0;
  // The same with the depth at which the object presses with `force_n`; no force, no contact.
  virtual const ContactState& press_to(double force_n, Vec2 at_mm, double twist_rad) = 0;
  // Times both frictions from the next move on: water, oil, dust. Level `grid` alone; springs keep theirs.
  virtual void scale_friction(double /*factor*/) {}
  // Motion of the markers that the contact was made with, in their order; motion_mm.size() at least their number.
  virtual void field(std::span<Vec2> motion_mm) = 0;
};

}  // namespace holdfast::scene
