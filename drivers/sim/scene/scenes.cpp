// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/scenes.hpp"

#include <limits>

namespace holdfast::scene {

// A sphere of 15 mm, pressed on from 0.48 to 1.08 s with 3 N and taken away from 2.40 to 2.80 s. With this stiff
// half-space the contact is 4.4 mm in radius and slides when it has gone 0.96 mm.
Scene sphere_slip() {
  Scene scene;
  scene.name = "sphere_slip";
  scene.help = "a sphere is pressed on, pulled at 8 mm/s as when an arm lifts it, slips partly, then slides for good";
  scene.duration_s = 3.28;
  scene.level.inject = Inject::kJpeg;
  scene.gel = {.shear_modulus_mpa = 0.1, .poisson = 0.49, .thickness_mm = std::numeric_limits<double>::infinity()};
  scene.object.name = "sphere";
  scene.effects.press_dilation = 0.06;
  scene.effects.pixel_noise = 3.0;
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

}  // namespace holdfast::scene
