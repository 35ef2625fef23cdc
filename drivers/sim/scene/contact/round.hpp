// SPDX-License-Identifier: Apache-2.0
// A round object on the gel behind the one seam (contact.hpp), by springs: contact level `springs`.
//
// Modelled
//   * everything that springs.hpp and twist.hpp model
//   * press and marker motion of a gel of finite thickness (layer.hpp); outward motion under the press, held back by
//     friction under the object (after level `grid`, not from first principles)
//   * how much stiffer a layer is against shear and twist: the object's motion counts for the half-space's formulas as
//     the motion that takes the same load there, so that the middle of the contact moves with the object
//   * shear and twist together: their loads stay on or inside (Q / mu P)^2 + (M / M_max)^2 = 1 (share_friction())
//   * the object that slides takes the contact along over the gel
//
// Not modelled
//   * what the layer does to the shape of the stick area and of the pressure: both stay those of the half-space
//   * objects that are not round: level `grid`
//
// Units: contact.hpp. Range: as the files it joins; a contact smaller than 1e-60 mm is none. No NaN.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "drivers/sim/scene/contact/contact.hpp"
#include "drivers/sim/scene/contact/hertz.hpp"
#include "drivers/sim/scene/contact/layer.hpp"
#include "drivers/sim/scene/contact/shape.hpp"
#include "drivers/sim/scene/contact/springs.hpp"
#include "drivers/sim/scene/contact/twist.hpp"

namespace holdfast::scene {

struct RoundSetup {
  Gel gel;
  Round round;
  double static_friction = 0.5;
  double kinetic_friction = 0.5;
  bool bonded = false;
  double press_dilation = 0.0;  // FOTS's, added to the gel's own: dilation * depth * (r/a) exp((1 - r^2/a^2) / 2)
  double extent_mm = 8.0;       // largest contact radius; a harder press counts as this one
  int springs = 64;
};

// Motion of the gel around a contact: press and twist of the markers, over whatever layer the gel is.
class RoundField {
 public:
  RoundField(const RoundSetup& setup, std::span<const Vec2> markers_mm);

  // Where the contact lies on the undeformed gel.
  void move_center(Vec2 center_mm);
  [[nodiscard]] std::size_t size() const { return markers_mm_.size(); }

  // Each adds to motion_mm.
  // Friction holds back the outward flow where the object sticks.
  void add_press(const Press& press, double friction, double stick_mm, std::span<Vec2> motion_mm);
  // `radius_mm`: of the contact.
  void add_discs(double radius_mm, const TwistDiscs& discs, std::span<Vec2> motion_mm);

  [[nodiscard]] const Layer& layer() const { return layer_; }

 private:
  // What one disc does to each marker, as a turn per turn of the disc.
  struct Turned {
    double radius_mm = -1.0;
    double spread_mm = 0.0;
    std::vector<double> share;
  };
  void add_layer_turn(double radius_mm, const TwistDiscs& discs, std::span<Vec2> motion_mm);

  Layer layer_;
  double sphere_radius_mm_;  // 0: no sphere
  double press_dilation_;
  std::vector<Vec2> markers_mm_;
  std::vector<Vec2> from_mm_;  // the centre
  std::vector<double> r_mm_;
  std::vector<double> turn_;  // of all discs together
  double outward_radius_mm_ = -1.0;
  double rim_outward_ = 0.0;
  bool passed_known_ = false;
  std::vector<double> passed_;   // motion of each marker when the rim passed over it
  std::vector<double> outward_;  // per unit of dome, at outward_radius_mm_
  double turn_radius_mm_ = -1.0;
  std::array<std::vector<double>, 2> layer_turn_;  // turn per moment that the layer adds, at two radii of the contact
  std::vector<Turned> turned_;
};

class SpringsContact final : public Contact {
 public:
  SpringsContact(const RoundSetup& setup, std::span<const Vec2> markers_mm);

  const ContactState& move_to(const ObjectPose& pose) override;
  const ContactState& press_to(double force_n, Vec2 at_mm, double twist_rad) override;
  void field(std::span<Vec2> motion_mm) override;

 private:
  const ContactState& set(const Press& press, Vec2 at_mm, double twist_rad);
  [[nodiscard]] double step_ratio(double radius_mm, Vec2 way);

  RoundSetup setup_;
  RoundField field_;
  SpringField spring_field_;
  SpringContact springs_;
  TwistSprings turns_;
  bool touching_ = false;
  bool turned_ = false;  // ever since it touched
  Vec2 touched_mm_;
  Vec2 at_mm_;
  Vec2 way_mm_;  // of the last step that moved
  double touched_rad_ = 0.0, at_rad_ = 0.0;
  Vec2 half_space_mm_;  // the object's way, as the half-space's springs count it
  Vec2 half_space_touched_mm_;
  double half_space_rad_ = 0.0;  // its turn since it touched, likewise
  Vec2 center_mm_;               // of the contact on the undeformed gel, for the fields
  Press press_;
  ContactState state_;
};

}  // namespace holdfast::scene
