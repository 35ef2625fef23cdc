// SPDX-License-Identifier: Apache-2.0
// The scene that the project's programs and tests play where no scene file can be read: the same as
// tests/scenes/sphere_slip.json (camera_scene_test compares them).
#pragma once

#include "drivers/sim/scene/scene.hpp"

namespace holdfast::scene {

[[nodiscard]] Scene sphere_slip();

}  // namespace holdfast::scene
