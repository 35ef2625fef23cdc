// SPDX-License-Identifier: Apache-2.0
// The film on which instructions are counted, as a file of JPEG pictures one behind the other: 3280x2464, 4:2:2,
// quality 85, noise 3, a sphere that is pressed and slips. Programs that count read it, because rendering would take
// most of their run. The first pictures show the empty gel, the middle is cut short, the last are consecutive.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "drivers/sim/scene/jpeg_encode.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/scene_pictures.hpp"

namespace holdfast::test {

using Jpeg = std::vector<std::uint8_t>;

// Frames of the scene: rest, press in steps, and a slip.
inline constexpr int kFilmFrames[] = {0, 1, 2, 3, 10, 16, 22, 28, 34, 40, 46, 47, 48, 49, 50, 51};

[[nodiscard]] inline std::vector<Jpeg> make_film() {
  scene::PictureConfig config = scene::camera_3280x2464();
  config.noise_sigma = 3;
  const std::vector<SceneView> views = views_of(scene::sphere_slip(), config);
  std::vector<Jpeg> film;
  for (const int frame : kFilmFrames) {
    const SceneView& view = views[static_cast<std::size_t>(frame)];
    std::vector<std::uint8_t> rgb;
    scene::render_rgb(config, view.dots, &view.imprint, static_cast<std::uint64_t>(frame) + 1, rgb);
    film.push_back(scene::encode_jpeg(rgb, config.width, config.height, scene::JpegInput::kRgb, 85));
  }
  return film;
}

// Empty: it cannot be read. A picture starts with FF D8 FF, which entropy-coded bytes cannot hold.
[[nodiscard]] inline std::vector<Jpeg> read_film(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const Jpeg all{std::istreambuf_iterator<char>(file), {}};
  std::vector<Jpeg> film;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool begins = i + 2 < all.size() && all[i] == 0xFF && all[i + 1] == 0xD8 && all[i + 2] == 0xFF;
    if (begins) film.emplace_back();
    if (!film.empty()) film.back().push_back(all[i]);
  }
  return film;
}

}  // namespace holdfast::test
