// SPDX-License-Identifier: Apache-2.0
// Writes the fuzzer's first inputs, small_stream(1) to small_stream(COUNT), into a folder that is there:
//   jpeg_seeds FOLDER [COUNT]
// So the tree holds no pictures but those that once were a finding.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include "tests/support/host_jpeg_streams.hpp"

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: jpeg_seeds FOLDER [COUNT]\n");
    return 2;
  }
  const std::string folder = argv[1];
  const unsigned long count = argc > 2 ? std::strtoul(argv[2], nullptr, 10) : 1000;
  for (unsigned seed = 1; seed <= count; ++seed) {
    const holdfast::test::Bytes bytes = holdfast::test::small_stream(seed);
    const std::string path = folder + "/seed_" + std::to_string(seed) + ".jpg";
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!file.flush()) {
      std::fprintf(stderr, "error: cannot write %s (no such folder, or the disk is full). Next: mkdir -p %s\n",
                   path.c_str(), folder.c_str());
      return 1;
    }
  }
  return 0;
}
