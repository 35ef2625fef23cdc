// SPDX-License-Identifier: Apache-2.0
// The scenes that the project's programs and tests play where no scene file can be read: the same as
// tests/scenes/<name>.json, which says what each shows (camera_scene_test compares them).
#pragma once

#include "drivers/sim/scene/scene.hpp"

namespace holdfast::scene {

[[nodiscard]] Scene sphere_slip();
[[nodiscard]] Scene sphere_hold();
[[nodiscard]] Scene sphere_shake();

}  // namespace holdfast::scene
