// SPDX-License-Identifier: Apache-2.0
#include "toolchain/generate/scene_doc.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

TEST_GROUP(SceneDoc){};

TEST(SceneDoc, CommittedFileIsWhatTheTableSays) {
  if (test::read_file(holdfast::test::source("tests/scenes/README.md")) != scene_doc::scene_markdown()) {
    FAIL("build the target scene_docs and commit tests/scenes/README.md");
  }
}

TEST(SceneDoc, ItsExampleIsAScene) {
  const std::string text = scene_doc::scene_markdown();
  const auto begin = text.find("```json\n") + 8;
  const auto result = scene::read_scene(text.substr(begin, text.find("```\n", begin) - begin), "example");
  CHECK(result.errors.empty());
  CHECK(result.warnings.empty());
  CHECK(result.scene.has_value());
}
