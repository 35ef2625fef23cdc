// SPDX-License-Identifier: Apache-2.0
// Any rigid shape pressed, dragged and turned on the gel along any path (contact level B3, the reference for the
// others): uniform tractions on the square cells of a grid that is fixed to the gel, and the exact motion of the
// surface of an elastic layer under each of them.
//
// Modelled
//   * any shape of shape.hpp on a layer of finite thickness bonded to glass, or on a half-space: pressure >= 0, gap >=
//   0
//   * Coulomb friction of every cell in both directions of the plane, with load history: shear, twist and both at
//     once follow from the tractions, without a rule for how they share the friction
//   * static and kinetic friction: a cell holds up to mu_s p; once it slips it carries mu_k p until a step leaves it
//     below that
//   * press moves the surface sideways (outwards under a layer): seen by the markers and held back by friction
//   * the contact travels over the gel as the object slides and turns against it
//
// Not modelled
//   * shear moves the surface up and down (the other half of the coupling: Panagiotopoulos' first step of his
//   iteration)
//   * large strain: tractions and motions stay on the undeformed surface; the pad's edges; adhesion, creep, inertia
//
// Where the object is over the gel: its own place less the gel's motion under the middle of the contact (the rigid
// motion nearest to the gel's within a third of the contact's radius), and its twist less that motion's turn. That is
// what ContactState calls slid. The gel's motion and the contact's place depend on each other; each step repeats both
// until the place stands still to kPlaceAccuracy of a cell.
//
// One call is cut into steps of at most a cell of travel (kMostSteps at most). Each step solves the pressure at the new
// place and then the shear with that pressure's limits: what enters the contact starts unstressed where the object was.
//
// Solvers. Pressure: conjugate gradients on the cells in contact, which are found again after each round (Polonsky &
// Keer, Wear 231, 1999). Shear: the limits are known, so the tractions are the least of a convex function over discs;
// Newton's method over the stick cells and the directions of the slip cells, by the same conjugate gradients, and a
// step that is sure to descend where Newton's does not. Both start at the last step's tractions. Iterations are
// bounded: see GridStats.
//
// Time and error against 0.2 mm cells: a sphere of 15 mm, 3 N on 4.25 mm of 0.035 MPa, dragged from rest to sliding
// (the gel moves by up to 1680 um). Frames are 0.32 mm long; median of thread CPU time on an AMD EPYC with other work,
// with the field of 63 markers. Errors are the worst frame's.
//   cell mm   cells   us     markers um RMS   worst   shear / mu P   slip fraction
//   0.35        736   6300          2.2            7      0.001          0.01
//   0.5         363   1400          5.2           17      0.002          0.01
//   0.7         185    400          5.8           17      0.002          0.02
//   1.0          93    130         12             32      0.002          0.03
// A contact is made in 50 ms at 0.7 mm: the influence of every cell on every marker.
//
// Known by this model: below mu_s a front of slip that carries mu_k behind itself is a crack and runs at once. The
// whole peaks 1 to 3 % above mu_k P, less on finer cells, where springs that stand alone reach 0.79 mu_s P (mu 0.6,
// 0.4). The coupling has one half only, so it does not conserve energy: friction takes 5 % more than the drive of a
// sliding sphere gives on 4.25 mm of gel, and 0.3 % less without coupling.
//
// Formulas: Love, Phil. Trans. A 228 (1929); Johnson, Contact Mechanics (1985), sections 3.2 and 3.6; layer.hpp.
// Range: any finite numbers with G > 0 and 0 <= nu <= 1/2; no input of that range gives NaN.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "drivers/sim/scene/contact/contact.hpp"
#include "drivers/sim/scene/contact/shape.hpp"

namespace holdfast::scene {

struct GridSetup {
  Gel gel;
  Shape shape;
  double static_friction = 0.5;
  double kinetic_friction = 0.5;  // at most the static one
  bool bonded = false;            // nothing that touches ever slips
  bool coupled = true;            // press moves the surface sideways; off for comparison with theories that neglect it
  double cell_mm = 0.7;           // time grows with its fourth power; made larger where kMostCells would not do
  Vec2 pad_mm{25.25, 20.75};      // the gel of a GelSight Mini, centred on the axes; nothing touches outside
  double tolerance = 1e-4;        // of the motion: how far a cell may miss its place
};

struct GridStats {
  std::int64_t steps = 0;
  std::int64_t unsettled = 0;  // steps that ran out of iterations above the tolerance
  // Of the last call.
  int passes = 0;
  int press_products = 0;  // of the influence matrix with a vector: what the time goes into
  int shear_products = 0;
  int contact_cells = 0;
  double press_residual = 0.0;  // of the motion
  double shear_residual = 0.0;
  double dissipated_mj = 0.0;  // since the start; never falls
};

class GridContact final : public Contact {
 public:
  static constexpr int kMostCells = 1 << 16;

  GridContact(const GridSetup& setup, std::span<const Vec2> markers_mm);
  GridContact(const GridContact&) = delete;
  GridContact& operator=(const GridContact&) = delete;
  ~GridContact() override;

  const ContactState& move_to(const ObjectPose& pose) override;
  const ContactState& press_to(double force_n, Vec2 at_mm, double twist_rad) override;
  void scale_friction(double factor) override;
  void field(std::span<Vec2> motion_mm) override;

  [[nodiscard]] const GridStats& stats() const;
  // Tractions of the cell over a point of the gel, MPa.
  struct Traction {
    double pressure_mpa = 0.0;
    Vec2 shear_mpa;
  };
  [[nodiscard]] Traction traction_at(Vec2 gel_mm) const;

 private:
  class Solver;
  std::unique_ptr<Solver> solver_;
};

}  // namespace holdfast::scene
