// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzer of compiled models starts from: the seeds, without the zeros at their ends, into a folder that
// is there, and the names that such files hold, as libFuzzer's dictionary:
//   model_seeds FOLDER DICTIONARY
#include <cstdio>
#include <string>

#include "tests/fuzz/model_check.hpp"
#include "tests/fuzz/seed_file.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 3) {
    std::fprintf(stderr, "usage: model_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  int number = 0;
  for (const test::ModelBytes& bytes : test::model_seeds()) {
    std::string cut(bytes.begin(), bytes.begin() + 5228);  // the fuzzer puts the check sum back
    cut.erase(cut.find_last_not_of('\0') + 1);
    if (!test::write_seed(argv[1] + ("/seed_" + std::to_string(++number)) + ".model", cut)) return 1;
  }
  std::string dictionary;
  const auto add = [&](std::string_view word) { dictionary += "\"" + std::string(word) + "\"\n"; };
  for (const FeatureSet& set : kFeatureSets) add(set.name);
  for (const FeatureInfo& feature : kFeatures) add(feature.name);
  return test::write_seed(argv[2], dictionary) ? 0 : 1;
}
