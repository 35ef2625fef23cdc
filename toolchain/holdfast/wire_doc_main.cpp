// SPDX-License-Identifier: Apache-2.0
// wire_doc: prints firmware/app/LINK.md (`doc`), firmware/app/STATES.md (`states`), toolchain/robot/holdfast_link.h
// (`c99`) or toolchain/page/tables.js (`page`) to stdout. The build target `wire_docs` writes all of them.
#include <cstdio>
#include <string>
#include <string_view>

#include "toolchain/holdfast/wire_doc.hpp"

int main(int argc, char** argv) {
  const std::string_view what = argc == 2 ? argv[1] : "";
  if (what != "doc" && what != "states" && what != "c99" && what != "page") {
    std::fprintf(stderr, "usage: wire_doc doc|states|c99|page\n");
    return 2;
  }
  const std::string text = what == "doc"      ? holdfast::wire_doc::link_markdown()
                           : what == "states" ? holdfast::wire_doc::states_markdown()
                           : what == "page"   ? holdfast::wire_doc::page_tables()
                                              : holdfast::wire_doc::link_header();
  return std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0 ? 0 : 1;
}
