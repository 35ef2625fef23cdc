// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when the console or the reader of stored parameters or models does what it must not. Run by
// run.sh, which also tells how to replay what was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/console_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace holdfast::test;
  // The first byte says which: a device's turns take a thousand times as long as reading what it stored.
  const unsigned which = size > 0 ? data[0] : 0;
  const std::string finding = which >= 0xF0   ? check_settings_bytes({data + 1, size - 1})
                              : which >= 0xE0 ? check_models_bytes({data + 1, size - 1}, which % 2 == 0)
                                              : check_console_bytes({data, size});
  if (finding.empty()) return 0;
  std::fprintf(stderr, "console_fuzz: %s\n", finding.c_str());
  std::abort();
}
