// SPDX-License-Identifier: Apache-2.0
// Wraps: a build of the preset asan must end here, and sanitize_ignore.txt must not cover it.
#include <cstdint>

int main(int argc, char** /*argv*/) {
  std::uint32_t sum = UINT32_MAX;
  sum += static_cast<std::uint32_t>(argc);
  return sum == 0 ? 0 : 1;
}
