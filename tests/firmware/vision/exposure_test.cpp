// SPDX-License-Identifier: Apache-2.0
#include "vision/exposure.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace holdfast;

TEST_GROUP(Exposure) {
  std::vector<std::uint8_t> pixels;

  void teardown() override {
    pixels = {};
  }

  // A picture of one level, `share` percent of its rows of another.
  bool is_bad(std::uint8_t level, std::uint8_t other, int share) {
    constexpr std::int32_t kWidth = 410, kHeight = 308;
    pixels.assign(std::size_t{kWidth} * kHeight, level);
    const std::size_t rows = static_cast<std::size_t>(kHeight * share / 100);
    std::fill_n(pixels.begin(), rows * kWidth, other);
    return exposure::is_bad({pixels.data(), kWidth, kHeight, kWidth});
  }
};

TEST(Exposure, IsBadWhenHalfOfThePictureIsAtAnEnd) {
  CHECK_TRUE(is_bad(0, 0, 0));
  CHECK_TRUE(is_bad(15, 15, 0));
  CHECK_FALSE(is_bad(16, 16, 0));
  CHECK_FALSE(is_bad(239, 239, 0));
  CHECK_TRUE(is_bad(240, 240, 0));
  CHECK_TRUE(is_bad(255, 255, 0));
  CHECK_FALSE(is_bad(120, 0, 47));
  CHECK_TRUE(is_bad(120, 0, 53));
  CHECK_TRUE(is_bad(0, 255, 50));
}
