// SPDX-License-Identifier: Apache-2.0
#include <fstream>
#include <iterator>
#include <string>

#include "tests/support/folders.hpp"
#include "toolchain/generate/wire_doc.hpp"

#include <CppUTest/TestHarness.h>

namespace {

void check_committed(const std::string& path, const std::string& want) {
  std::ifstream in(holdfast::test::source(path), std::ios::binary);
  const std::string committed{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (committed != want) FAIL(("build the target wire_docs and commit " + path).c_str());
}

}  // namespace

TEST_GROUP(WireDoc){};

TEST(WireDoc, PricesOfAllModesOrNone) {
  STRCMP_EQUAL("", holdfast::wire_doc::mode_prices("knob,value\nmode,fast\n").c_str());
}

TEST(WireDoc, CommittedFilesAreWhatTheTablesSay) {
  check_committed("firmware/link/LINK.md", holdfast::wire_doc::link_markdown());
  check_committed("firmware/app/STATES.md", holdfast::wire_doc::states_markdown());
  check_committed("firmware/ERRORS.md", holdfast::wire_doc::errors_markdown());
  check_committed("firmware/params/PARAMETERS.md", holdfast::wire_doc::parameters_markdown());
  std::ifstream table(holdfast::test::source("toolchain/trade/trade.csv"));
  const std::string measured{std::istreambuf_iterator<char>(table), std::istreambuf_iterator<char>()};
  check_committed("firmware/params/mode_prices.gen.hpp", holdfast::wire_doc::mode_prices(measured));
  check_committed("toolchain/page/tables.js", holdfast::wire_doc::page_tables());
  check_committed("toolchain/python/holdfast/tables.py", holdfast::wire_doc::python_tables());
}
