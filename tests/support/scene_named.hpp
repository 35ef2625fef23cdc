// SPDX-License-Identifier: Apache-2.0
// A scene of the gallery, tests/scenes. Fails the test where the file does not hold one.
#pragma once

#include <CppUTest/TestHarness.h>

#include <filesystem>
#include <string>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "tests/support/folders.hpp"

namespace holdfast::test {

[[nodiscard]] inline scene::Scene scene_of(const std::filesystem::path& path) {
  scene::SceneResult read = scene::read_scene_file(path);
  if (!read.scene) FAIL(read.errors.front().c_str());
  return *read.scene;
}

[[nodiscard]] inline scene::Scene scene_named(const std::string& name) {
  return scene_of(source("tests/scenes/" + name + ".json"));
}

}  // namespace holdfast::test
