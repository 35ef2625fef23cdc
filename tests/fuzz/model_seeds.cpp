// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzer of compiled models starts from: the seeds, without the zeros at their ends, into a folder that
// is there, and the names that such files hold, as libFuzzer's dictionary:
//   model_seeds FOLDER DICTIONARY
#include <cstdio>
#include <fstream>
#include <string>

#include "tests/fuzz/model_check.hpp"

namespace {

bool write(const std::string& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary);
  file << bytes;
  if (file.flush()) return true;
  std::fprintf(stderr, "error: cannot write %s (no such folder, or the disk is full). Next: make the folder\n",
               path.c_str());
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 3) {
    std::fprintf(stderr, "usage: model_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  int number = 0;
  for (const test::ModelBytes& bytes : test::model_seeds()) {
    std::string cut(bytes.begin(), bytes.begin() + 5556);  // the fuzzer puts the check sum back
    cut.erase(cut.find_last_not_of('\0') + 1);
    if (!write(argv[1] + ("/seed_" + std::to_string(++number)) + ".model", cut)) return 1;
  }
  std::string dictionary;
  const auto add = [&](std::string_view word) { dictionary += "\"" + std::string(word) + "\"\n"; };
  for (const FeatureSet& set : kFeatureSets) add(set.name);
  for (const FeatureInfo& feature : kFeatures) add(feature.name);
  return write(argv[2], dictionary) ? 0 : 1;
}
