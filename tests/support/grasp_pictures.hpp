// SPDX-License-Identifier: Apache-2.0
// Luma pictures of a scripted grasp, rendered once: input for programs that count what the firmware does with them.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/sim/scene/grasp.hpp"
#include "drivers/sim/scene/render.hpp"
#include "vision/luma.hpp"

namespace holdfast::test {

struct GraspPictures {
  std::vector<std::vector<std::uint8_t>> pixels;
  std::vector<LumaView> views;
};

[[nodiscard]] inline GraspPictures film(const scene::GraspConfig& grasp, const scene::PictureConfig& picture) {
  GraspPictures out;
  const int frames = scene::frame_count(grasp);
  out.pixels.resize(static_cast<std::size_t>(frames));
  for (int i = 0; i < frames; ++i) {
    const scene::GraspTruth truth = scene::at(grasp, i / grasp.fps);
    const auto dots = scene::dot_centers_px(picture, scene::markers_at(grasp, truth, {}));
    const scene::Imprint imprint = scene::imprint_px(picture, grasp, truth);
    auto& pixels = out.pixels[static_cast<std::size_t>(i)];
    scene::render_luma(picture, dots, &imprint, static_cast<std::uint64_t>(i), pixels);
    out.views.push_back({pixels.data(), picture.width, picture.height, picture.width});
  }
  return out;
}

}  // namespace holdfast::test
