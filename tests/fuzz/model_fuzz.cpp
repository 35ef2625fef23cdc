// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when check_model_bytes() has something to say, of the bytes as they are and of the same
// behind a beginning and a check sum that are right (else hardly an input would get past those). Run by run.sh, which
// also tells how to replay what was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/model_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace holdfast::test;
  std::string finding = check_model_bytes({data, size});
  if (finding.empty()) {
    ModelBytes bytes(data, data + size);
    bytes.resize(kModelBytes);
    put_name(bytes, 0, std::string_view("\x89HFT\r\n\x1a\n\x02\0", 10));
    std::fill(bytes.begin() + 5228, bytes.end(), std::uint8_t{0});
    finding = check_model_bytes(repaired(bytes));
  }
  if (finding.empty()) return 0;
  std::fprintf(stderr, "model_fuzz: %s\n", finding.c_str());
  std::abort();
}
