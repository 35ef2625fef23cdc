// SPDX-License-Identifier: Apache-2.0
// wire_doc: prints firmware/app/STATUS_FRAME.md to stdout. The build target `wire_docs` writes the file.
#include <cstdio>
#include <string>

#include "toolchain/holdfast/wire_doc.hpp"

int main() {
  const std::string text = holdfast::wire_doc::status_frame_markdown();
  return std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0 ? 0 : 1;
}
