// SPDX-License-Identifier: Apache-2.0
// The film on which instructions are counted, as a file of JPEG pictures one behind the other: 3280x2464, 4:2:2,
// quality 85, noise 3, a sphere that is pressed and slips. Programs that count read it, because rendering would take
// most of their run. The first pictures show the empty gel, the middle is cut short, the last are consecutive.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/mjpg_file.hpp"
#include "tests/support/scene_pictures.hpp"

namespace holdfast::test {

// Frames of the scene: rest, press in steps, and a slip.
inline constexpr std::array<int, 16> kFilmFrames{0, 1, 2, 3, 10, 16, 22, 28, 34, 40, 46, 47, 48, 49, 50, 51};

struct FilmConfig {
  int width = 3280;  // 4:3
  double noise = 3.0;
  int quality = 85;
};
inline constexpr FilmConfig kFilm{};
// For a file that is committed: 100 kB a picture.
inline constexpr FilmConfig kSmallFilm{.width = 2400, .noise = 1.0, .quality = 60};

[[nodiscard]] inline scene::PictureConfig picture_of(const FilmConfig& film) {
  scene::PictureConfig picture = scene::scaled(scene::camera_3280x2464(), film.width);
  if (film.width != 3280) picture.height = film.width * 3 / 4;
  picture.noise_sigma = film.noise;
  return picture;
}

[[nodiscard]] inline std::vector<Jpeg> make_film(const FilmConfig& film) {
  const scene::PictureConfig picture = picture_of(film);
  const std::vector<SceneView> views = views_of(scene::sphere_slip(), picture);
  std::vector<Jpeg> out;
  for (const int frame : kFilmFrames) {
    const SceneView& view = views[static_cast<std::size_t>(frame)];
    std::vector<std::uint8_t> rgb;
    scene::render_rgb(picture, view.dots, &view.imprint, static_cast<std::uint64_t>(frame) + 1, rgb);
    out.push_back(scene::encode_jpeg(rgb, picture.width, picture.height, scene::JpegInput::kRgb, film.quality));
  }
  return out;
}

[[nodiscard]] inline std::vector<std::vector<std::uint8_t>> make_luma(int width) {
  const scene::PictureConfig picture = picture_of({.width = width});
  const std::vector<SceneView> views = views_of(scene::sphere_slip(), picture);
  std::vector<std::vector<std::uint8_t>> out;
  for (const int frame : kFilmFrames) {
    const SceneView& view = views[static_cast<std::size_t>(frame)];
    scene::render_luma(picture, view.dots, &view.imprint, static_cast<std::uint64_t>(frame) + 1, out.emplace_back());
  }
  return out;
}

}  // namespace holdfast::test
