// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when check_link_bytes() has something to say, of the bytes as they are and of the stream
// whose script they are (else hardly an input would hold a sound frame). Run by run.sh, which also tells how to replay
// what was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/link_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace holdfast::test;
  std::string finding = check_link_bytes({data, size});
  if (finding.empty()) finding = check_link_bytes(link_stream({data, size}));
  if (finding.empty()) return 0;
  std::fprintf(stderr, "link_fuzz: %s\n", finding.c_str());
  std::abort();
}
