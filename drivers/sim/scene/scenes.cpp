// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/scenes.hpp"

#include <limits>

namespace holdfast::scene {
namespace {

// A sphere of 15 mm, pressed on from 0.48 to 1.08 s with 3 N and taken away from 2.40 to 2.80 s. With this stiff
// half-space the contact is 4.4 mm in radius and slides when it has gone 0.96 mm.
Scene sphere(const char* name, const char* help) {
  Scene scene;
  scene.name = name;
  scene.help = help;
  scene.duration_s = 3.28;
  scene.level.inject = Inject::kJpeg;
  scene.gel = {.shear_modulus_mpa = 0.1, .poisson = 0.49, .thickness_mm = std::numeric_limits<double>::infinity()};
  scene.object.name = "sphere";
  scene.effects.press_dilation = 0.06;
  scene.effects.pixel_noise = 3.0;
  return scene;
}

Scene glued_sphere(const char* name, const char* help) {
  Scene scene = sphere(name, help);
  scene.level.contact = ContactLevel::kSprings;
  scene.object.bonded = true;
  scene.expect.no_onset = true;
  scene.expect.final_state = "OK";
  return scene;
}

}  // namespace

Scene sphere_slip() {
  Scene scene =
      sphere("sphere_slip",
             "a sphere is pressed on, pulled at 8 mm/s as when an arm lifts it, slips partly, then slides for good");
  scene.trajectory = {{.t_s = 0.48, .force_n = 0.0},
                      {.t_s = 1.08, .force_n = 3.0},
                      {.t_s = 1.48, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 2.40, .force_n = 3.0, .x_mm = 6.9161, .y_mm = 2.5173},
                      {.t_s = 2.80, .force_n = 0.0}};
  scene.expect.onset_s = {1.52, 1.56};
  scene.expect.max_delay_ms = 80.0;
  scene.expect.false_alarms = 0;
  scene.expect.final_state = "OK";
  return scene;
}

Scene sphere_hold() {
  Scene scene =
      glued_sphere("sphere_hold", "the forces of sphere_slip on a sphere that is glued to the gel: its matched pair");
  scene.trajectory = {{.t_s = 0.48, .force_n = 0.0},
                      {.t_s = 1.08, .force_n = 3.0},
                      {.t_s = 1.48, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 1.52, .x_mm = 0.2741, .y_mm = 0.0998},
                      {.t_s = 1.56, .x_mm = 0.4859, .y_mm = 0.1769},
                      {.t_s = 1.60, .x_mm = 0.6025, .y_mm = 0.2193},
                      {.t_s = 2.40, .force_n = 3.0, .x_mm = 0.6026, .y_mm = 0.2193},
                      {.t_s = 2.50, .x_mm = 0.4974, .y_mm = 0.1811},
                      {.t_s = 2.60, .x_mm = 0.3796, .y_mm = 0.1382},
                      {.t_s = 2.70, .x_mm = 0.2391, .y_mm = 0.087},
                      {.t_s = 2.80, .force_n = 0.0, .x_mm = 0.0, .y_mm = 0.0}};
  scene.expect.false_alarms = 0;
  return scene;
}

Scene sphere_shake() {
  Scene scene = glued_sphere("sphere_shake",
                             "glued to the gel and shaken at 2.5 Hz with 0.8 of the force at which sphere_slip slides");
  scene.profile = Profile::kMinimumJerk;
  scene.trajectory = {{.t_s = 0.48, .force_n = 0.0},
                      {.t_s = 1.08, .force_n = 3.0},
                      {.t_s = 1.48, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 1.58, .x_mm = 0.4821, .y_mm = 0.1755},
                      {.t_s = 1.78, .x_mm = -0.4821, .y_mm = -0.1755},
                      {.t_s = 1.98, .x_mm = 0.4821, .y_mm = 0.1755},
                      {.t_s = 2.18, .x_mm = -0.4821, .y_mm = -0.1755},
                      {.t_s = 2.28, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 2.40, .force_n = 3.0},
                      {.t_s = 2.80, .force_n = 0.0}};
  scene.expect.false_alarms = 0;
  return scene;
}

}  // namespace holdfast::scene
