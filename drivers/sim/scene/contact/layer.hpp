// SPDX-License-Identifier: Apache-2.0
// The gel as an elastic layer of thickness h bonded to rigid glass: how its surface moves under loads on a disc, and a
// sphere pressed on it. On 4.25 mm of gel a contact of 4 mm moves 0.75x as far as on a half-space, and 4 mm beside it
// the markers move 0.39x (along the load) and 0.02x (across): thickness is no detail.
//
// Modelled
//   * isotropic layer, any 0 <= nu <= 1/2, small strain; free surface outside the load
//   * tangential dome sqrt(a^2 - r^2), rigid punch, torsion, pressure dome; their motion along the surface and down
//   * frictionless sphere, exact contact problem of the layer (no half-space profile assumed)
// Not modelled
//   * large strain, creep, coupling of press and shear inside the contact, slip on the glass, the gel's edge
//
// Method. Per wavenumber k the layer's compliance is closed (layer_compliance). In real space each field is the
// half-space's closed form plus a difference, layer minus half-space, whose Hankel kernel falls as exp(-2kh): smooth on
// the scale of 2h, so one table per nu in a/h and r/h serves every thickness. The tables hold the difference per unit
// load on a grid of h/8: local polynomials of degree 5 in a, cubic B-splines in r.
//   build: 7 ms of CPU, 235 kB; copies of a Layer share the tables. An infinite h needs none and is the half-space.
//   one motion 50 ns; 63 distances at once 20 ns each; a press by force 0.5 us (desktop x86-64, November 2026)
//
// Accuracy: 1e-5 of the field's largest value (a fan: of the mean's). Two seams are approximate, and continuous:
//   * r > kFarDistance h: the field falls on as the layer's slowest mode does, exp(-kappa r / h) / sqrt(r), from its
//     value there, which is below 1 % of the centre
//   * a > kMostRadius h: the field of a = kMostRadius h, moved to the new rim and scaled by the ratio of a thin
//     layer's local motion (h/G times the traction; for a press the next term too). Good to 15 % of the centre
// Sphere: 2e-5 up to a = kMostRadius h; beyond, the force goes on as the power of a that it is there.
//
// Sources: Johnson, Contact Mechanics (1985), ch. 3 (half-space fields); the layer is the plane-strain strip's
// elasticity solved with a fixed base, checked by integrating it (layer_test.cpp). The sphere: Popov & Hess's reduction
// (2015) turned into a Fredholm equation of the second kind, as Lebedev & Ufliand (1958) do for the punch.
//
// Units: mm, N, MPa. Range: G, h, a, r and R from 1e-40 to 1e40, and any h up to infinity; r = 0, r = a. a <= 0 is no
// load: 0. h <= 0 does not move: 0 (point() too). No input of that range gives NaN.
#pragma once

#include <memory>
#include <span>

#include "drivers/sim/scene/contact/hertz.hpp"

namespace holdfast::scene {

// Surface motion per surface traction exp(ikx), in mm/MPa.
struct LayerCompliance {
  double along = 0.0;   // shear along k
  double across = 0.0;  // shear across k
  double normal = 0.0;  // pressure, motion down
  // Pressure p cos kx moves the surface along x by -coupling * p sin kx: towards the pressure where coupling is
  // positive (the half-space: (1 - 2 nu) / (2 G k)), away from it where negative (nu = 1/2: the gel flows out). Shear t
  // sin kx along x likewise moves it down by -coupling * t cos kx.
  double coupling = 0.0;
};

// Half-space from kh = 20 on (off by 1e-14 there). k = 0 with an infinite h is infinite.
[[nodiscard]] LayerCompliance layer_compliance(const Gel& gel, double wavenumber_per_mm);

// Motion of the surface at polar (r, phi) under a load along +x: x: mean + fan cos 2 phi, y: fan sin 2 phi.
struct Spread {
  double mean = 0.0;
  double fan = 0.0;
};

// Layer minus half-space, in mm/N, at distance r from a unit point force: smooth, also at r = 0. The half-space's own
// part is mean (2 - nu) / (4 pi G r), fan nu / (4 pi G r), outward -(1 - 2 nu) / (4 pi G r),
// sink (1 - nu) / (2 pi G r).
struct LayerPoint {
  double mean = 0.0;  // tangential force along +x, as in Spread
  double fan = 0.0;
  double outward = 0.0;  // normal force into the gel: motion away from it along the surface
  double sink = 0.0;     // and down. (The tangential force sinks the gel at phi by -outward cos phi: Betti)
};

// What the layer makes of a sphere that touches on radius a, over Hertz at the same a.
struct PressRatio {
  double force = 1.0;          // over (4/3) E* a^3 / R
  double depth = 1.0;          // over a^2 / R
  double peak_pressure = 1.0;  // over 2 E* a / (pi R)
};

class Layer {
 public:
  static constexpr double kMostRadius = 4.0;    // of a disc, in thicknesses
  static constexpr double kFarDistance = 12.0;  // in thicknesses

  explicit Layer(const Gel& gel);

  [[nodiscard]] const Gel& gel() const { return gel_; }

  // Traction sqrt(a^2 - r^2) * 1 MPa/mm along +x.
  [[nodiscard]] Spread dome(double a_mm, double r_mm) const;
  // Traction 1 N / (2 pi a sqrt(a^2 - r^2)) along +x.
  [[nodiscard]] Spread punch(double a_mm, double r_mm) const;
  // The same at many distances (63 of them: a third of the time); the spans are of one size. Differs from one by one by
  // at most 1e-11 of the half-space's motion in the centre.
  void dome(double a_mm, std::span<const double> r_mm, std::span<double> mean, std::span<double> fan) const;
  void punch(double a_mm, std::span<const double> r_mm, std::span<double> mean, std::span<double> fan) const;
  // Motion around the centre under 3 M r / (4 pi a^3 sqrt(a^2 - r^2)), M = 1 N mm: a disc that turns as one on a
  // half-space.
  [[nodiscard]] double torque(double a_mm, double r_mm) const;
  // Pressure sqrt(a^2 - r^2) * 1 MPa/mm: motion away from the centre, and down.
  [[nodiscard]] double press_outward(double a_mm, double r_mm) const;
  [[nodiscard]] double press_sink(double a_mm, double r_mm) const;

  [[nodiscard]] LayerPoint point(double r_mm) const;

  [[nodiscard]] PressRatio press_ratio(double a_mm) const;
  // As hertz.hpp's press_sphere: no force, no depth, no or an endless radius is no contact.
  [[nodiscard]] Press press_by_force(double sphere_radius_mm, double force_n) const;
  [[nodiscard]] Press press_by_depth(double sphere_radius_mm, double depth_mm) const;

 private:
  enum class Load { kDome, kPunch, kTorque, kPress };
  struct Tables;

  // Two numbers of each load: mean and fan; around the centre and 0; outward and down.
  [[nodiscard]] Spread motion(Load load, double a, double r) const;
  [[nodiscard]] Spread half_space(Load load, double a, double r) const;
  [[nodiscard]] Spread tabled_motion(Load load, double a, double r) const;
  [[nodiscard]] Spread thin_motion(Load load, double a, double r) const;
  [[nodiscard]] Spread fall(Load load, double r) const;
  [[nodiscard]] double unit(Load load, double a) const;
  void spread(Load load, double a, std::span<const double> r, std::span<double> mean, std::span<double> fan) const;

  [[nodiscard]] double radius_from(double hertz, double power, double PressRatio::*ratio) const;
  [[nodiscard]] Press pressed(double sphere_radius_mm, double a) const;

  Gel gel_;
  std::shared_ptr<const Tables> tables_;  // of nu; empty for the half-space and for no gel at all
};

}  // namespace holdfast::scene
