// SPDX-License-Identifier: Apache-2.0
// The grasps that come with the project, by name: one table for the host tool, the sim board and the tests.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "drivers/sim/scene/grasp.hpp"

namespace holdfast::scene {

// A part held too lightly is pulled at 8 mm/s, as when an arm lifts it: half of the contact slides after 60 ms.
[[nodiscard]] inline GraspConfig sphere_slip() {
  GraspConfig grasp;
  grasp.speed_mm_s = 8.0;
  grasp.slide_s = 0.8;
  return grasp;
}

struct Scene {
  std::string_view name;
  std::string_view help;
  GraspConfig (*grasp)();
  // Slip is to be raised within so many frames of the onset; none: this scene makes no promise.
  std::optional<int> onset_within_frames;
};

inline constexpr std::array<Scene, 3> kScenes{{
    {"sphere_slip", "a sphere is pressed on, pulled, slips partly, then slides for good", sphere_slip, 2},
    {"sphere_hold", "the same forces, and nothing slips: the matched pair", [] { return without_slip(sphere_slip()); },
     std::nullopt},
    {"sphere_shake", "pressed on and shaken at 2.5 Hz, without slip", [] { return shaken(sphere_slip()); },
     std::nullopt},
}};

[[nodiscard]] constexpr const Scene* find_scene(std::string_view name) {
  for (const Scene& scene : kScenes) {
    if (scene.name == name) return &scene;
  }
  return nullptr;
}

}  // namespace holdfast::scene
