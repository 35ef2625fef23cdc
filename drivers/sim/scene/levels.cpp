// SPDX-License-Identifier: Apache-2.0
// From a scene to its contact level.
#include <algorithm>
#include <cmath>

#include "drivers/sim/scene/contact/grid.hpp"
#include "drivers/sim/scene/contact/round.hpp"
#include "drivers/sim/scene/simulation.hpp"

namespace holdfast::scene {
namespace {

// Largest contact radius that the script reaches, on a half-space: a layer's is smaller under force, and the same to a
// few percent under depth. What presses from outside a script has this much room as well.
constexpr double kRoom = 1.1;
constexpr double kLeastExtent_mm = 2.0;
constexpr double kExtentWithoutScript_mm = 8.0;

double extent_mm(const Scene& scene, const Round& round) {
  double depth_mm = 0.0;
  double force_n = 0.0;
  for (const Waypoint& point : scene.trajectory) {
    depth_mm = std::max({depth_mm, point.depth_mm.value_or(0.0), point.closing_mm.value_or(0.0)});
    force_n = std::max(force_n, point.force_n.value_or(0.0));
  }
  SpringContact probe({.gel = scene.gel, .indenter = {round.coefficient, round.exponent}, .extent_mm = 1e3});
  depth_mm = std::max(depth_mm, probe.depth_for_force_mm(force_n));
  if (!(depth_mm > 0.0)) return kExtentWithoutScript_mm;
  return std::max(kRoom * probe.move_to(depth_mm, {}).contact_radius_mm, kLeastExtent_mm);
}

}  // namespace

std::unique_ptr<Contact> make_contact(const Scene& scene, std::span<const Vec2> markers_mm) {
  const Object& object = scene.object;
  const double kinetic = object.kinetic_friction.value_or(object.friction);
  const auto round = as_round(object.shape);
  // The loader refuses springs under what is not round; the one level that can do it takes their place.
  if (round && scene.level.contact == ContactLevel::kSprings) {
    return std::make_unique<SpringsContact>(RoundSetup{.gel = scene.gel,
                                                       .round = *round,
                                                       .static_friction = object.friction,
                                                       .kinetic_friction = kinetic,
                                                       .bonded = object.bonded,
                                                       .press_dilation = scene.effects.press_dilation,
                                                       .extent_mm = extent_mm(scene, *round),
                                                       .springs = scene.level.springs},
                                            markers_mm);
  }
  return std::make_unique<GridContact>(GridSetup{.gel = scene.gel,
                                                 .shape = object.shape,
                                                 .static_friction = object.friction,
                                                 .kinetic_friction = kinetic,
                                                 .bonded = object.bonded,
                                                 .cell_mm = scene.level.cell_mm},
                                       markers_mm);
}

}  // namespace holdfast::scene
