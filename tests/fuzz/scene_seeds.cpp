// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzer of scenes starts from: the seeds into a folder that is there, and the words of the format, by
// the reader's own table, as libFuzzer's dictionary:
//   scene_seeds FOLDER DICTIONARY
#include <cstdio>
#include <string>

#include "tests/fuzz/scene_check.hpp"
#include "tests/fuzz/seed_file.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 3) {
    std::fprintf(stderr, "usage: scene_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  int number = 0;
  for (const std::string& text : test::scene_seeds()) {
    if (!test::write_seed(argv[1] + ("/seed_" + std::to_string(++number)) + ".json", text)) return 1;
  }
  std::string dictionary;
  const auto add = [&](std::string_view word) { dictionary += "\"\\\"" + std::string(word) + "\\\"\"\n"; };
  for (const scene::FieldInfo& field : scene::scene_fields()) add(field.path.substr(field.path.rfind('.') + 1));
  for (const auto section : {"level", "gel", "markers", "object", "texture", "effects", "picture", "expect", "goal"})
    add(section);
  for (const scene::Capability& capability : scene::kCapabilities) add(capability.name);
  for (const auto name : scene::kInjectNames) add(name);
  for (const auto name : scene::kContactLevelNames) add(name);
  for (const auto name : scene::kShapeNames) add(name);
  for (const auto name : scene::kTextureNames) add(name);
  for (const auto name : scene::kFaultNames) add(name);
  return test::write_seed(argv[2], dictionary) ? 0 : 1;
}
