// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzer of the gripper's replies starts from, into a folder that is there, and the beginnings of
// frames as libFuzzer's dictionary:
//   modbus_seeds FOLDER DICTIONARY
#include <cstdio>
#include <string>

#include "tests/fuzz/modbus_check.hpp"
#include "tests/fuzz/seed_file.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 3) {
    std::fprintf(stderr, "usage: modbus_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  int number = 0;
  for (const test::ModbusBytes& bytes : test::modbus_seeds()) {
    const std::string file = argv[1] + ("/seed_" + std::to_string(++number)) + ".script";
    if (!test::write_seed(file, {bytes.begin(), bytes.end()})) return 1;
  }
  const std::string dictionary =
      "\"\\x09\\x03\\x06\"\n\"\\x09\\x04\\x06\"\n\"\\x09\\x17\\x06\"\n\"\\x09\\x84\"\n"
      "\"\\x09\\x10\\x03\\xE8\\x00\\x03\\x01\\x30\"\n";
  return test::write_seed(argv[2], dictionary) ? 0 : 1;
}
