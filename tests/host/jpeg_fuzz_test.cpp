// SPDX-License-Identifier: Apache-2.0
// The fuzzer's judge over its seeds, over seeds with a few bytes changed, and over every input that once was a finding
// (tests/fuzz/regressions/jpeg).
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/fuzz/jpeg_check.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::test;

TEST_GROUP(JpegFuzz) {
  JpegCheck judge;

  void check(const Bytes& bytes, const std::string& which) {
    const std::string finding = judge.check(bytes);
    if (!finding.empty()) FAIL((which + ": " + finding).c_str());
  }
};

TEST(JpegFuzz, HoldsForTheSeeds) {
  for (unsigned seed = 1; seed <= 1000; ++seed) {
    const Bytes bytes = small_stream(seed);
    CHECK(bytes.size() <= kSmallStream);
    check(bytes, "seed " + std::to_string(seed));
  }
  LONGS_EQUAL(1000, judge.accepted());
}

TEST(JpegFuzz, HoldsForChangedSeeds) {
  std::vector<Bytes> seeds;
  for (unsigned seed = 1; seed <= 200; ++seed) seeds.push_back(small_stream(seed));
  Random random(1);
  for (int round = 0; round < 20000; ++round) {
    Bytes bytes = seeds[random() % seeds.size()];
    for (int i = in_range(random, 1, 3); i > 0; --i)
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    check(bytes, "round " + std::to_string(round));
  }
  CHECK(judge.accepted() > 2000);
}

TEST(JpegFuzz, HoldsForWhatOnceWasAFinding) {
  const std::filesystem::path folder = holdfast::test::source("tests/fuzz/regressions/jpeg");
  if (!std::filesystem::exists(folder)) return;
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    const std::string bytes = read_file(file.path());
    check({bytes.begin(), bytes.end()}, file.path().filename().string());
  }
}
