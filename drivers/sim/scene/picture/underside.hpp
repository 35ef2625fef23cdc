// SPDX-License-Identifier: Apache-2.0
// The side of the object that is pressed into the gel, as the camera sees it: the slopes of the gel's surface over
// shape, texture and relief. It lies where the object is and turns with it, wherever the gel and its dots go: in a firm
// grip the two move together, in slip this moves over the dots.
//
// Modelled
//   * in contact the gel's surface is the object's (Shape::height_mm and texture). The contact is where the object is
//     lower than a level, the one that gives it the area that the contact model says; pressing harder raises both
//   * outside, the surface lets go of the object: slope times ((e - h) / (e - l))^2 at height h above level l, where e
//     makes it come back to rest, e = l + 3 (depth - l). Of a paraboloid in a half-space that ends at twice the radius
//   * relief: ridges, bumps or grain, zero in the mean, in full within the contact (h < 0.7 l), gone at h = 1.3 l
//   * the gel's skin and the lens do not follow what is fine: a relief of pitch p has
//     p^2 / (p^2 + 0.25^2) exp(-2 pi^2 s^2 / p^2) of its height, p and the lens' blur s in mm. The first factor is
//     chosen, not measured (0.8 at 0.5 mm, 0.5 at 0.25 mm); the second is the blur that the rims of dots have
//   * grain: Perlin's gradient noise on two lattices, one turned by the angle of 3-4-5; directions from a hash.
//     Its slopes are the same from all sides to 1 %; 97 % of its power lies within 0.3 .. 1.7 cycles a pitch
//
// Not modelled
//   * a smooth sphere's own bulge: render.cpp draws it, from the contact alone; this adds its relief
//   * a relief that the gel fills more when pressed harder; friction and mechanics of the relief; wear; contacts that
//     lean under shear; the pad's edges
//   * creep and press dilation (Effects) move the dots and not the object: under them a held relief drifts by as much
//
// Rims of flats are at least 0.3 mm here and go on beyond the outline: the gel rounds a sharper one.
// Units: mm, rad. + - * / and sqrt of floats, portable.hpp and integers: the same bits on every machine.
// Cost: see render.hpp. Making one of a shape other than a sphere takes 3 ms.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "drivers/sim/scene/contact/shape.hpp"

namespace holdfast::scene {

class Underside {
 public:
  // `lens_sigma_mm`: blur of the picture, measured on the gel.
  Underside(const Shape& shape, const Relief& relief, std::uint64_t seed, double lens_sigma_mm = 0.0);
  Underside(const Underside&) = delete;
  Underside& operator=(const Underside&) = delete;
  ~Underside();

  // A sphere's: its bulge is the picture's own.
  [[nodiscard]] bool round() const;
  // Nothing to see but that.
  [[nodiscard]] bool plain() const;

  // How it is pressed in.
  struct Pose {
    Vec2 at_mm{};  // of the object's origin
    double turn_rad = 0.0;
    double depth_mm = 0.0;
    double radius_mm = 0.0;  // of the disc of the contact's area; 0 = no contact
  };
  struct Surface {
    double rise_mm = 0.0;  // against the object's lowest point
    Vec2 slope;            // its gradient
  };
  [[nodiscard]] Surface surface(const Pose& pose, Vec2 at_mm) const;

  // Places of a row: column i lies at (x_mm + i step_mm, y_mm).
  struct Row {
    double x_mm = 0.0;
    double y_mm = 0.0;
    double step_mm = 1.0;
  };
  struct Columns {
    int first = 0;
    int last = -1;
  };
  // Adds `weight` times the slopes along a row and says where they are not 0. Range: as many of the one as the other.
  [[nodiscard]] Columns add_row(const Pose& pose, const Row& row, float weight, std::span<float> slope_x,
                                std::span<float> slope_y) const;

  // Height below which the object has this area.
  [[nodiscard]] double level_mm(double area_mm2) const;

 private:
  struct Model;
  std::unique_ptr<const Model> model_;
};

}  // namespace holdfast::scene
