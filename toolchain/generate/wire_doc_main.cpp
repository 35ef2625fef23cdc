// SPDX-License-Identifier: Apache-2.0
// wire_doc: prints firmware/link/LINK.md (`doc`), firmware/app/STATES.md (`states`), firmware/ERRORS.md (`errors`),
// firmware/params/PARAMETERS.md (`params`), toolchain/page/tables.js (`page`), toolchain/python/holdfast/tables.py
// (`python`) or, from the table named behind it, firmware/params/mode_prices.gen.hpp (`modes`) to stdout. The build
// target `wire_docs` writes all of them.
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>

#include "toolchain/generate/wire_doc.hpp"

int main(int argc, char** argv) {
  const std::string_view what = argc >= 2 ? argv[1] : "";
  std::string text;
  if (argc == 3 && what == "modes") {
    std::ostringstream table;
    table << std::ifstream(argv[2]).rdbuf();
    text = holdfast::wire_doc::mode_prices(table.str());
  } else if (argc == 2) {
    text = what == "doc"      ? holdfast::wire_doc::link_markdown()
           : what == "states" ? holdfast::wire_doc::states_markdown()
           : what == "errors" ? holdfast::wire_doc::errors_markdown()
           : what == "params" ? holdfast::wire_doc::parameters_markdown()
           : what == "page"   ? holdfast::wire_doc::page_tables()
           : what == "python" ? holdfast::wire_doc::python_tables()
                              : "";
  }
  if (text.empty()) {
    std::fprintf(stderr, "usage: wire_doc doc|states|errors|params|page|python, or wire_doc modes TRADE.csv\n");
    return 2;
  }
  return std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0 ? 0 : 1;
}
