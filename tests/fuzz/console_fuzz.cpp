// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when the console does what it must not. Run by run.sh, which also tells how to replay what
// was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/console_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string finding = holdfast::test::check_console_bytes({data, size});
  if (finding.empty()) return 0;
  std::fprintf(stderr, "console_fuzz: %s\n", finding.c_str());
  std::abort();
}
