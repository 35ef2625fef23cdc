// SPDX-License-Identifier: Apache-2.0
// What the frames of a scene show, in any picture: for programs that render themselves, and luma pictures rendered
// once for programs that count what the firmware does with them. Effects of the scene's markers and picture are left
// out.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "vision/luma.hpp"

namespace holdfast::test {

struct SceneView {
  std::vector<scene::PointPx> dots;
  scene::Imprint imprint;
};

// Index = frame.
[[nodiscard]] inline std::vector<SceneView> views_of(const scene::Scene& scene, const scene::PictureConfig& picture) {
  std::vector<SceneView> out;
  scene::Simulation simulation(scene);
  for (int frame = 0; frame < scene::frame_count(scene); ++frame) {
    const scene::Snapshot& now = simulation.next();
    out.push_back(
        {scene::dot_centers_px(picture, simulation.markers(), now.motion_mm), scene::imprint_px(picture, now.contact)});
  }
  return out;
}

struct ScenePictures {
  std::vector<std::vector<std::uint8_t>> pixels;
  std::vector<LumaView> views;
};

[[nodiscard]] inline ScenePictures film(const scene::Scene& scene, const scene::PictureConfig& picture) {
  ScenePictures out;
  for (const SceneView& view : views_of(scene, picture)) {
    std::vector<std::uint8_t> pixels;
    scene::render_luma(picture, view.dots, &view.imprint, out.pixels.size(), pixels);
    out.views.push_back({pixels.data(), picture.width, picture.height, picture.width});
    out.pixels.push_back(std::move(pixels));
  }
  return out;
}

}  // namespace holdfast::test
