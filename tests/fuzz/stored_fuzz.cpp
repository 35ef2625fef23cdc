// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry: aborts when the reader of stored parameters, or of stored models, does what it must not; the first
// byte says which. Run by run.sh, which also tells how to replay what was found.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/console_check.hpp"

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace holdfast::test;
  if (size == 0) return 0;
  const std::string finding = data[0] >= 0xF0 ? check_settings_bytes({data + 1, size - 1})
                                              : check_models_bytes({data + 1, size - 1}, data[0] % 2 == 0);
  if (finding.empty()) return 0;
  std::fprintf(stderr, "stored_fuzz: %s\n", finding.c_str());
  std::abort();
}
