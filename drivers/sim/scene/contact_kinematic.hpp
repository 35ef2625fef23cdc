// SPDX-License-Identifier: Apache-2.0
// The markers follow the object by three Gaussians: what FOTS does (contact level B0), for comparison with the levels
// that have mechanics. About 3 us for 63 markers: 1 the press, 1 each of the other Gaussians.
//
// Modelled
//   * press: markers under the object push their neighbours outward, by how deep each of them sits
//   * shear and twist: markers follow the object, less with the distance from where it touched
//   * gross slip, as FOTS has it: the gel follows no further than s_max and theta_max. What goes beyond counts as slid
//     and takes the centre along, so that a reversal works (FOTS itself forgets, and clips the twist alone)
//
// Not modelled
//   * friction, forces along the surface, partial slip, the normal force's part in slip, the gel's thickness and
//   modulus:
//     all motion is the same whatever the press. shear_n and moment_nmm stay 0; slip is none or gross
//   * load history other than the slid way; creep, inertia, large strain
//
// Formulas (Rancho-zhao/FOTS, utils/marker_motion.py; in mm at its 19.58 px/mm, without its cut to whole pixels). One
// after the other, each at the place where the one before left the marker M:
//   press  sum over markers c under the object of h_c (M - c) exp(-|M - c|^2 / 1.444^2), h_c = depth there, 1/mm
//   shear  s exp(-|M - G|^2 / 3.524^2), G = place of first touch, s = object's way, |s| <= 0.511 mm (10 px, TacEx's;
//          FOTS's paper names a limit and its code has none)
//   twist  (R(theta) - I) (M - O) exp(-|M - O|^2 / 2.620^2), O = the object, |theta| <= 50 degrees; R - I by
//          -2 sin^2(theta / 2), which is 0 at 0
// Contact radius and force, of which the markers know nothing: sqrt(2 R d) and Hertz on a half-space, R = the shape's
// radius (ellipsoid: root of both; cylinder and edge: a sphere of that radius); cone: d / slope, (2/pi) E* d^2 / slope;
// flats: the disc of their outline, 2 a E* d.
//
// Units: mm, N, rad. Range: any finite numbers; places, depths, forces, radii and moduli beyond 1e40 count as that
// bound. No input of that range gives NaN. Only + - * / sqrt and portable.hpp (and shape.hpp): the same bits on every
// IEEE machine.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "drivers/sim/scene/contact.hpp"
#include "drivers/sim/scene/shape.hpp"

namespace holdfast::scene {

struct KinematicSetup {
  Gel gel;
  Shape shape;
  double dilate_per_mm = 1.0;
  double dilate_radius_mm = 1.444549;  // where a Gaussian has fallen to 1/e: 0.00125, 0.00021, 0.00038 px^-2
  double shear_radius_mm = 3.524339;
  double twist_radius_mm = 2.619965;
  double most_shear_mm = 0.510725;
  double most_twist_deg = 50.0;
};

class KinematicContact final : public Contact {
 public:
  KinematicContact(const KinematicSetup& setup, std::span<const Vec2> markers_mm);

  const ContactState& move_to(const ObjectPose& pose) override;
  const ContactState& press_to(double force_n, Vec2 at_mm, double twist_rad) override;
  void field(std::span<Vec2> motion_mm) override;

 private:
  // P = force d^exponent, a = radius d^(exponent - 1): Hertz, cone, punch at 3/2, 2, 1.
  enum class Law { kSphere, kCone, kPunch };
  void find_law();
  [[nodiscard]] double force_n(double depth_mm) const;
  [[nodiscard]] double depth_mm(double force_n) const;
  [[nodiscard]] double radius_mm(double depth_mm) const;
  [[nodiscard]] double depth_under(Vec2 at_mm) const;

  KinematicSetup setup_;
  std::optional<Round> round_;
  Law law_ = Law::kSphere;
  double size_ = 0.0;   // radius of the sphere or punch, slope of the cone
  double shear_ = 0.0;  // 1 / radius^2 of each Gaussian
  double twist_ = 0.0;
  std::vector<Vec2> markers_mm_;
  std::vector<Vec2> near_;  // press: what each marker does to each other one per depth, row by row

  Vec2 touched_mm_;  // where it touched first
  double touched_rad_ = 0.0;
  Vec2 anchor_mm_;  // the same, taken along by slip: G
  double anchor_rad_ = 0.0;
  Vec2 sheared_mm_;          // s
  double turned_rad_ = 0.0;  // theta
  double object_rad_ = 0.0;
  bool shear_slips_ = false;
  bool twist_slips_ = false;
  ContactState state_;
};

}  // namespace holdfast::scene
