// SPDX-License-Identifier: Apache-2.0
#include "base/units.hpp"

#include <array>
#include <cstdint>

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

template <typename Quantity>
void check_limits() {
  Saturations saturations;
  LONGS_EQUAL(Quantity::kMin, Quantity::saturate(Quantity::kMin, saturations).raw());
  LONGS_EQUAL(Quantity::kMax, Quantity::saturate(Quantity::kMax, saturations).raw());
  LONGS_EQUAL(0, saturations.count);
  const std::array<std::int64_t, 3> below{Quantity::kMin - std::int64_t{1}, INT32_MIN, INT64_MIN};
  const std::array<std::int64_t, 3> above{Quantity::kMax + std::int64_t{1}, INT32_MAX, INT64_MAX};
  for (const std::int64_t raw : below) LONGS_EQUAL(Quantity::kMin, Quantity::saturate(raw, saturations).raw());
  for (const std::int64_t raw : above) LONGS_EQUAL(Quantity::kMax, Quantity::saturate(raw, saturations).raw());
  LONGS_EQUAL(6, saturations.count);
  LONGS_EQUAL(Quantity::kMin, Quantity::from_raw(Quantity::kMin).raw());
  LONGS_EQUAL(Quantity::kMax, Quantity::from_raw(Quantity::kMax).raw());
  LONGS_EQUAL(0, Quantity{}.raw());
}

}  // namespace

TEST_GROUP(Units){};

TEST(Units, ClampsAtBothEndsAndCountsEachClamp) {
  check_limits<PixelsQ8>();
  check_limits<Micrometres>();
  check_limits<MicrometresPerSec>();
  check_limits<MicrometresQ4>();
  check_limits<StrainPpmPerSec>();
  check_limits<ShareQ10>();
  check_limits<Log2Q8>();
  check_limits<Count>();
  check_limits<NatsQ16>();
  check_limits<NatsPerSecQ8>();
}

TEST(Units, OrdersByValue) {
  CHECK_TRUE(PixelsQ8::from_raw(-1) < PixelsQ8::from_raw(0));
  CHECK_TRUE(PixelsQ8::from_raw(7) == PixelsQ8::from_raw(7));
}

// What DESIGN.md promises must fit its type: the largest picture in px, ln 15 nat, and ln 15 within 1 ms.
TEST(Units, HoldsWhatTheDesignNeeds) {
  CHECK_TRUE(PixelsQ8::kMax >= 2 * 1640 * 256);
  CHECK_TRUE(NatsQ16::kMax >= 177475);           // ln 15 = 2.70805 nat, times 65536
  CHECK_TRUE(NatsPerSecQ8::kMax >= 2709 * 256);  // ln 15 nat in 1 ms
  CHECK_TRUE(NatsPerSecQ8::kMin <= -2709 * 256);
  CHECK_TRUE(Micrometres::kMax >= 18'600);  // the gel is 18.6 mm wide
}
