// SPDX-License-Identifier: Apache-2.0
// Forces read from the markers against the simulator's truth: frictional contacts, which the weights were not made
// from. How exact readings are over many grasps and pictures: bench/loads.cpp.
#include <cmath>
#include <cstdint>
#include <random>
#include <string>

#include "drivers/sim/scene/simulation.hpp"
#include "tactile/load.hpp"

#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

struct Case {
  scene::Shape shape;
  double press_n;
  double friction;
  scene::Vec2 at_mm;
  scene::Vec2 drag_mm;  // in half a second, from 0.4 s on
};

// Pressed in 0.2 s, held for as long, dragged.
scene::Scene scene_of(const Case& c) {
  scene::Scene scene;
  scene.name = "loads";
  scene.duration_s = 0.9;
  scene.level.contact = scene::ContactLevel::kGrid;
  scene.object.shape = c.shape;
  scene.object.friction = c.friction;
  scene.object.touch_mm = c.at_mm;
  scene.trajectory = {{.t_s = 0.0, .force_n = 0.0, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 0.2, .force_n = c.press_n, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 0.4, .force_n = c.press_n, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 0.9, .force_n = c.press_n, .x_mm = c.drag_mm.x, .y_mm = c.drag_mm.y}};
  return scene;
}

struct WorstLoad {
  double shear = 0, normal = 0;
  int frames = 0, within = 0;
};

// Of the frames with at least 0.3 N of either; 2 um of noise on each marker.
WorstLoad worst_of(const Case& c) {
  scene::Simulation simulation(scene_of(c));
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 2.0);
  WorstLoad worst;
  for (int frame = 0; frame < scene::frame_count(simulation.scene()); ++frame) {
    const scene::Snapshot& truth = simulation.next();
    DisplacementField field;
    field.grid = {7, 9};
    for (std::size_t i = 0; i < 63; ++i) {
      const auto um = [&](double mm) {
        return Micrometres::from_raw(static_cast<std::int32_t>(std::lround(1e3 * mm + noise(random))));
      };
      field.markers[i] = {um(truth.motion_mm[i].x), um(truth.motion_mm[i].y), true};
    }
    Saturations saturations;
    const load::Load load = load::update({}, field, saturations);
    LONGS_EQUAL(0, saturations.count);
    const double shear_n = std::hypot(truth.contact.shear_n.x, truth.contact.shear_n.y);
    if (shear_n < 0.3 || truth.contact.normal_n < 0.3) continue;
    ++worst.frames;
    worst.within += load.within ? 1 : 0;
    worst.shear = std::max(worst.shear, std::hypot(load.shear_x.raw() * 1e-3 - truth.contact.shear_n.x,
                                                   load.shear_y.raw() * 1e-3 - truth.contact.shear_n.y) /
                                            shear_n);
    worst.normal = std::max(worst.normal, std::abs(load.normal.raw() * 1e-3 / truth.contact.normal_n - 1.0));
  }
  CHECK_TRUE(worst.frames >= 5);
  return worst;
}

}  // namespace

TEST_GROUP(Loads){};

TEST(Loads, OfContactsWithinTheLatticeAreReadToTenPercent) {
  using enum scene::ShapeKind;
  const Case cases[]{
      {{.kind = kSphere, .radius_mm = 8.0}, 2.0, 0.6, {0.4, -0.3}, {1.5, 0.0}},
      {{.kind = kSphere, .radius_mm = 20.0}, 1.0, 0.8, {-1.0, 0.6}, {0.6, 1.2}},
      {{.kind = kEllipsoid, .radius_mm = 16.0, .radius_y_mm = 8.0}, 1.5, 0.5, {1.2, 0.2}, {0.0, -1.5}},
      {{.kind = kDisc, .radius_mm = 4.0}, 2.0, 0.7, {0.5, 0.5}, {-1.2, 0.9}},
      {{.kind = kBox, .half_x_mm = 4.0, .half_y_mm = 3.0}, 1.5, 1.0, {-0.8, -0.4}, {1.5, 0.5}},
  };
  for (const Case& c : cases) {
    const WorstLoad worst = worst_of(c);
    CHECK_TRUE(worst.shear < 0.10);
    CHECK_TRUE(worst.normal < 0.20);
    CHECK_TRUE(worst.within > worst.frames / 2);
  }
}

// A quarter of what a bar lays on the gel lies outside of the lattice.
TEST(Loads, OfABarAreSaidToBeLessExact) {
  using enum scene::ShapeKind;
  const Case cases[]{
      {{.kind = kCylinder, .radius_mm = 8.0}, 2.0, 0.8, {0.0, 0.3}, {1.5, 0.3}},
      {{.kind = kEdge, .radius_mm = 1.5, .yaw_rad = 0.5}, 2.0, 0.8, {0.3, 0.0}, {0.5, 1.2}},
  };
  for (const Case& c : cases) {
    const WorstLoad worst = worst_of(c);
    CHECK_TRUE(worst.shear < 0.35);
    CHECK_TRUE(worst.normal < 0.60);
    LONGS_EQUAL(0, worst.within);
  }
}
