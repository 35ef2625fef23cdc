// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <fstream>
#include <string>

namespace holdfast::test {

// One file of a fuzzer's first inputs, or its dictionary. False: a line on stderr says why not.
[[nodiscard]] inline bool write_seed(const std::string& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary);
  file << bytes;
  if (file.flush()) return true;
  std::fprintf(stderr, "error: cannot write %s (no such folder, or the disk is full). Next: make the folder\n",
               path.c_str());
  return false;
}

}  // namespace holdfast::test
