// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when JpegCheck (jpeg_check.hpp) has something to say. Run by run.sh, which also tells how
// to replay what was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/jpeg_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static holdfast::test::JpegCheck judge;
  const std::string finding = judge.check({data, size});
  if (finding.empty()) return 0;
  std::fprintf(stderr, "jpeg_fuzz: %s\n", finding.c_str());
  std::abort();
}
