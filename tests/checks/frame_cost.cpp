// SPDX-License-Identifier: Apache-2.0
// frame_cost paper|field|imprint|slip|hand N: with the paper's features, with those of the field as well, or with
// those, the imprint and the forces; slip: the same, and slip is raised all the time; hand: the last of two fingers,
// from luma to the hand's lines, N frames of each. N frames of a moving gel through the pipeline, from luma to
// decision; for the instruction counter. The pictures are rendered before the first frame and shown in turn, so N
// changes nothing but the number of frames.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <string_view>

#include "app/app.hpp"
#include "app/fingers.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/scene_pictures.hpp"

namespace {

// sphere_slip's press, glued to the gel and shaken at 2.5 Hz until it has left, with 0.8 of what friction could hold:
// it moves in every frame from the hold on. (sphere_shake rests between, which costs 4 % less.)
holdfast::scene::Scene shaken() {
  holdfast::scene::Scene scene = holdfast::scene::sphere_slip();
  scene.object.bonded = true;
  scene.trajectory.resize(2);
  for (int frame = 37; frame <= 70; ++frame) {
    const double t_s = frame / scene.fps;
    const double force = std::min(1.0, (2.8 - t_s) / 0.4);  // of 3 N
    // 0.513 mm carry 1.2 N on this gel at 3 N; the contact's radius goes with the cube root of the force.
    const double way_mm = 0.513 * std::cbrt(force * force) *
                          std::sin(2.0 * std::numbers::pi * 2.5 * (t_s - scene.trajectory[1].t_s - 0.4));
    scene.trajectory.push_back({.t_s = t_s,
                                .force_n = 3.0 * force,
                                .x_mm = way_mm * std::cos(std::numbers::pi / 9.0),
                                .y_mm = way_mm * std::sin(std::numbers::pi / 9.0)});
  }
  return scene;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 3) return 2;
  const std::string_view with = argv[1];
  const long frames = std::atol(argv[2]);
  // The working image of the camera in mode fast: 410 pixels wide.
  const test::ScenePictures film = test::film(shaken(), scene::scaled(scene::camera_3280x2464(), 410));
  test::NoJpeg jpeg;
  const auto state = std::make_unique<fingers::State>();
  pipeline::Config config = pipeline_config(Params{});
  config.with_field = with != "paper";
  config.with_imprint = config.with_load = with == "imprint" || with == "slip" || with == "hand";
  const fingers::Config hand = fingers::config_of(2, config, supervisor_config(Params{}));
  long accepted = 0;
  const auto frame_of = [&](long i, Micros later) {
    const LumaView& view = film.views[static_cast<std::size_t>(i) % film.views.size()];
    hal::Frame frame{};
    frame.bytes = {view.data, static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height)};
    frame.format = hal::PixelFormat::kLuma8;
    frame.width = view.width;
    frame.height = view.height;
    frame.stride = view.stride;
    frame.timestamp = Micros{(i + 1) * 40'000} + later;
    return frame;
  };
  for (long i = 0; i < frames; ++i) {
    const hal::Frame left = frame_of(i, Micros{0});
    if (with == "slip") state->fingers[0].decision = {.last_slip = left.timestamp, .raised = true};
    if (with != "hand") {
      accepted += pipeline::update(state->fingers[0], config, jpeg, left).quality.ok() ? 1 : 0;
      continue;
    }
    pipeline::Result seen;
    (void)fingers::update(*state, hand, 0, jpeg, left, left.timestamp, seen);
    const hal::Frame right = frame_of(i, Micros{17'000});
    accepted += fingers::update(*state, hand, 1, jpeg, right, right.timestamp, seen).hand.accepted ? 1 : 0;
  }
  std::printf("%ld of %ld accepted, %u searches\n", accepted, frames, state->fingers[0].tracker.searches);
  return accepted == frames ? 0 : 1;
}
