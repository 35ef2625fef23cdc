// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when check_mcap_bytes() has something to say, of the bytes as they are and of the same
// without check sums (else hardly an input would get past those). Run by run.sh, which also tells how to replay what
// was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/mcap_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace holdfast::test;
  std::string finding = check_mcap_bytes({data, size});
  if (finding.empty()) finding = check_mcap_bytes(without_sums(McapBytes(data, data + size)));
  if (finding.empty()) return 0;
  std::fprintf(stderr, "mcap_fuzz: %s\n", finding.c_str());
  std::abort();
}
