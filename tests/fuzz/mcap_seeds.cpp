// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzer of MCAP files starts from: the seeds into a folder that is there, and the words of the format
// as libFuzzer's dictionary:
//   mcap_seeds FOLDER DICTIONARY
#include <cstdio>
#include <string>

#include "tests/fuzz/mcap_check.hpp"
#include "tests/fuzz/seed_file.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 3) {
    std::fprintf(stderr, "usage: mcap_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  int number = 0;
  for (const test::McapBytes& bytes : test::mcap_seeds()) {
    const std::string text(bytes.begin(), bytes.end());
    if (!test::write_seed(argv[1] + ("/seed_" + std::to_string(++number)) + ".mcap", text)) return 1;
  }
  std::string dictionary = "\"\\x89MCAP0\\x0d\\x0a\"\n";
  for (const char* word : {"ros2", "ros2msg", "cdr", "lz4", "zstd", "jpeg"})
    dictionary += "\"" + std::string(word) + "\"\n";
  // The beginnings of records: opcode and the high bytes of a small length.
  for (const char* op : {"01", "02", "03", "04", "05", "06", "07", "08", "09", "0a", "0b", "0c", "0d", "0e", "0f"}) {
    dictionary += "\"\\x" + std::string(op) + "\\x10\\x00\\x00\\x00\\x00\\x00\\x00\\x00\"\n";
  }
  return test::write_seed(argv[2], dictionary) ? 0 : 1;
}
