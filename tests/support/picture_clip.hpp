// SPDX-License-Identifier: Apache-2.0
// A recording as a folder of PNG pictures, of a scene or of a part of it: what tests of labels and of rest noise need.
#pragma once

#include <filesystem>
#include <string>

#include "drivers/sim/scene/scene.hpp"
#include "tests/support/pictures.hpp"
#include "tests/support/scene_pictures.hpp"

namespace holdfast::test {

// A ball that is pressed by 3 N between `from_s` and `to_s`, 25 frames a second; never: the gel stays empty.
[[nodiscard]] inline scene::Scene press_scene(double duration_s, double from_s = 1e3, double to_s = 2e3) {
  scene::Scene scene;
  scene.name = "press";
  scene.duration_s = duration_s;
  scene.trajectory = {{.t_s = 0.0, .force_n = 0.0},
                      {.t_s = from_s, .force_n = 0.0},
                      {.t_s = from_s + 0.2, .force_n = 3.0},
                      {.t_s = to_s - 0.2, .force_n = 3.0},
                      {.t_s = to_s, .force_n = 0.0}};
  return scene;
}

// Returns how many frames were written.
inline int write_clip(const scene::Scene& scene, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  ScenePictures film = test::film(scene, scene::cropped_320x240());
  for (std::size_t k = 0; k < film.views.size(); ++k) {
    const LumaView& view = film.views[k];
    const cv::Mat picture(view.height, view.width, CV_8UC1, film.pixels[k].data());
    write_picture(folder / (std::to_string(k) + ".png"), picture);
  }
  return static_cast<int>(film.views.size());
}

}  // namespace holdfast::test
