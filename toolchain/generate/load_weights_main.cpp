// SPDX-License-Identifier: Apache-2.0
// load_weights: prints firmware/tactile/load_weights.gen.hpp to stdout. The build target `load_weights_header` writes
// the file.
#include <cstdio>
#include <string>

#include "toolchain/generate/load_weights.hpp"

int main() {
  const std::string text = holdfast::load_weights::header();
  return std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0 ? 0 : 1;
}
