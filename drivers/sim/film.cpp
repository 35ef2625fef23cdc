// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/film.hpp"

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/noise.hpp"
#include "drivers/sim/scene/scene.hpp"
#include "drivers/sim/scene/simulation.hpp"

namespace holdfast::sim {
namespace {

constexpr double kTouch_s = 1.2;    // the object comes
constexpr double kSettled_s = 1.8;  // and rests

scene::Scene press(hal::PixelFormat format) {
  scene::Scene scene;
  scene.name = "press";
  scene.duration_s = 3.2;
  scene.level.inject = format == hal::PixelFormat::kMjpeg ? scene::Inject::kJpeg : scene::Inject::kGrey;
  scene.level.contact = scene::ContactLevel::kSprings;
  scene.object.bonded = true;
  scene.effects.pixel_noise = 2.5;
  scene.object.relief = {scene::ReliefKind::kBumps, 120.0, 1.0};
  scene.trajectory = {{.t_s = 0.0, .force_n = 0.0},
                      {.t_s = kTouch_s, .force_n = 0.0},
                      {.t_s = 1.6, .force_n = 3.0},
                      {.t_s = 3.2, .force_n = 3.0}};
  return scene;
}

}  // namespace

hal::Frame Film::frame(bool is_held, std::size_t index, Picture& room) const {
  const std::vector<Picture>& pictures = is_held ? held : empty;
  const Picture& picture = pictures[index % pictures.size()];
  hal::Frame frame;
  frame.bytes = picture;
  if (index >= pictures.size() && format == hal::PixelFormat::kLuma8) {
    room = picture;
    add_noise(room, index);
    frame.bytes = room;
  }
  frame.format = format;
  frame.width = width;
  frame.height = height;
  frame.stride = format == hal::PixelFormat::kLuma8 ? width : 0;
  return frame;
}

Film shoot(hal::PixelFormat format, std::size_t most) {
  const scene::Scene scene = press(format);
  const std::chrono::seconds whole{10};
  Film film;
  Clock clock;
  SceneCamera camera(scene, clock);
  if (!camera.start()) return film;
  for (int k = 0; k < scene::frame_count(scene); ++k) {
    const double t_s = k / scene.fps;
    const bool is_empty = t_s < kTouch_s;
    std::vector<Film::Picture>& to = is_empty ? film.empty : film.held;
    hal::Frame frame;
    if ((!is_empty && t_s <= kSettled_s) || to.size() >= most) {
      camera.pass();
    } else if (camera.next(frame, whole) == hal::Capture::kFrame) {
      if (k == 0) film.markers.assign(camera.marker_centers().begin(), camera.marker_centers().end());
      to.emplace_back(frame.bytes.begin(), frame.bytes.end());
      film.format = frame.format;
      film.width = frame.width;
      film.height = frame.height;
      camera.release(frame);
    }
  }
  return film;
}

}  // namespace holdfast::sim
