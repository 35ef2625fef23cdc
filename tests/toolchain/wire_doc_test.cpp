// SPDX-License-Identifier: Apache-2.0
#include <fstream>
#include <iterator>
#include <string>

#include "toolchain/holdfast/wire_doc.hpp"

#include <CppUTest/TestHarness.h>

TEST_GROUP(WireDoc){};

TEST(WireDoc, CommittedFileIsWhatTheTablesSay) {
  std::ifstream in(HOLDFAST_SOURCE_DIR "/firmware/app/STATUS_FRAME.md", std::ios::binary);
  const std::string committed{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (committed != holdfast::wire_doc::status_frame_markdown()) {
    FAIL("build the target wire_docs and commit firmware/app/STATUS_FRAME.md");
  }
}
