// SPDX-License-Identifier: Apache-2.0
// scene_doc: prints tests/scenes/README.md to stdout. The build target `scene_docs` writes the file.
#include <cstdio>
#include <string>

#include "toolchain/generate/scene_doc.hpp"

int main() {
  const std::string text = holdfast::scene_doc::scene_markdown();
  return std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0 ? 0 : 1;
}
