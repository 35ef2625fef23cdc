// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzer of serial lines starts from: the seeds into a folder that is there, and beginnings of frames,
// as libFuzzer's dictionary:
//   link_seeds FOLDER DICTIONARY
#include <cstdio>
#include <string>

#include "tests/fuzz/link_check.hpp"
#include "tests/fuzz/seed_file.hpp"

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: link_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  int number = 0;
  for (const holdfast::test::LinkBytes& bytes : holdfast::test::link_seeds()) {
    const std::string text(bytes.begin(), bytes.end());
    if (!holdfast::test::write_seed(argv[1] + ("/seed_" + std::to_string(++number)) + ".link", text)) return 1;
  }
  return holdfast::test::write_seed(
             argv[2], "\"\\x00\\x04\\x01\\x01\"\n\"\\x00\\x05\\x01\\x02\"\n\"\\x00\\x05\\x01\\x03\"\n\"help\\x0a\"\n")
             ? 0
             : 1;
}
