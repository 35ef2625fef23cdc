// SPDX-License-Identifier: Apache-2.0
#include "toolchain/generate/load_weights.hpp"

#include <cctype>
#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

namespace {

// What is no digit or sign, and the numbers between.
struct Parts {
  std::string words;
  std::vector<long> numbers;
};

Parts parts_of(const std::string& text) {
  Parts out;
  for (std::size_t i = 0; i < text.size();) {
    const bool sign =
        text[i] == '-' && i + 1 < text.size() && std::isdigit(static_cast<unsigned char>(text[i + 1])) != 0;
    if (!sign && std::isdigit(static_cast<unsigned char>(text[i])) == 0) {
      out.words += text[i++];
      continue;
    }
    char* end = nullptr;
    out.numbers.push_back(std::strtol(text.c_str() + i, &end, 10));
    i = static_cast<std::size_t>(end - text.c_str());
  }
  return out;
}

}  // namespace

TEST_GROUP(LoadWeights){};

// To a unit in the last place: another compiler may round another way.
TEST(LoadWeights, CommittedHeaderIsWhatTheLayerSays) {
  const Parts want = parts_of(holdfast::load_weights::header());
  const Parts committed =
      parts_of(holdfast::test::read_file(holdfast::test::source("firmware/tactile/load_weights.gen.hpp")));
  CHECK_TEXT(want.words == committed.words && want.numbers.size() == committed.numbers.size(),
             "build the target load_weights_header and commit firmware/tactile/load_weights.gen.hpp");
  for (std::size_t i = 0; i < want.numbers.size(); ++i) {
    LONGS_EQUAL_TEXT(0, std::abs(want.numbers[i] - committed.numbers[i]) / 2, "build the target load_weights_header");
  }
}
