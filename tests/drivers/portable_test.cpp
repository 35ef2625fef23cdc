// SPDX-License-Identifier: Apache-2.0
// Oracle: <cmath> in long double, which has 11 bits more on x86-64 and 60 more on aarch64. The hashes say that both
// machines find the same bits. Arguments are made of integers, so that no compiler contracts their making.
#include "drivers/sim/scene/math/portable.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include <CppUTest/TestHarness.h>

namespace portable = holdfast::scene::portable;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kSmallest = std::numeric_limits<double>::denorm_min();
constexpr double kLargest = std::numeric_limits<double>::max();
constexpr double kLargestAngle = 1e8;  // beyond, digits are lost
constexpr std::uint64_t kSteps = 8000;

// Distance in units of the last place of a double next to `want`.
double ulps(double got, long double want) {
  const auto rounded = static_cast<double>(want);
  if (std::isnan(want)) return std::isnan(got) ? 0.0 : kInfinity;
  if (std::isinf(rounded) || rounded == 0.0) return got == rounded ? 0.0 : kInfinity;
  int exponent = 0;
  (void)std::frexp(want, &exponent);
  return static_cast<double>(
      std::abs((static_cast<long double>(got) - want) / std::ldexp(1.0L, std::max(exponent - 53, -1074))));
}

// Even steps in the bits: every exponent between the two, as many values in each. The odd part fills the low bits.
double between(double from, double to, std::uint64_t step) {
  const auto first = std::bit_cast<std::uint64_t>(from);
  const std::uint64_t stride = (std::bit_cast<std::uint64_t>(to) - first) / kSteps;
  return std::bit_cast<double>(first + step * stride +
                               (stride > 4096 && step < kSteps ? step * 2654435761u % 4096 : 0));
}

class Hash {
 public:
  void add(double value) {  // FNV-1a
    const auto bits = std::bit_cast<std::uint64_t>(value);
    for (int shift = 0; shift < 64; shift += 8) value_ = (value_ ^ ((bits >> shift) & 0xff)) * 0x100000001b3u;
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325u;
};

struct Range {
  double from, to;
};

struct Function {
  const char* name;
  double (*ours)(double);
  long double (*oracle)(long double);
  std::uint64_t hash;
  double most_ulps;
  bool negative;                // -x too
  std::array<Range, 4> ranges;  // of |x|; an empty one ends the list
};

using Ranges = std::array<Range, 4>;
constexpr Ranges kAngles{{{kSmallest, 0.78}, {0.01, 3.2}, {3.0, 1e5}, {1e5, kLargestAngle}}};

constexpr Ranges kSines{{{kSmallest, 0.25}, {0.25, 0.5}, {0.5, 1.0}}};
constexpr Ranges kExponents{{{kSmallest, 0.1}, {0.1, 2.0}, {2.0, 705.0}, {705.0, 760.0}}};
constexpr Ranges kPositive{{{kSmallest, kLargest}, {0.1, 0.9}, {0.9, 1.1}, {1.1, 5.0}}};
constexpr Ranges kAny{{{kSmallest, kLargest}, {0.1, 10.0}}};
constexpr Ranges kTails{{{kSmallest, 0.5}, {0.4, 2.0}, {2.0, 10.0}, {10.0, 30.0}}};

// A denormal result is rounded twice, so the bound of exp is half a unit more.
constexpr std::array<Function, 9> kFunctions{{
    {"sin", portable::sin, std::sin, 17270555116075105673u, 0.9, true, kAngles},
    {"cos", portable::cos, std::cos, 13954508865511130581u, 0.9, true, kAngles},
    {"tan", portable::tan, std::tan, 2133872091383952673u, 2.4, true, kAngles},
    {"asin", portable::asin, std::asin, 4504987814613577089u, 1.3, true, kSines},
    {"exp", portable::exp, std::exp, 9993534216096898366u, 1.4, true, kExponents},
    {"expm1", portable::expm1, std::expm1, 745916702125986666u, 1.5, true, kExponents},
    {"log", portable::log, std::log, 3552759065911316223u, 1.0, false, kPositive},
    {"cbrt", portable::cbrt, std::cbrt, 2804870687149069425u, 1.0, true, kAny},
    {"erfc", portable::erfc, std::erfc, 11370555353715225860u, 4.5, true, kTails},
}};

struct Function2 {
  const char* name;
  double (*ours)(double, double);
  long double (*oracle)(long double, long double);
  std::uint64_t hash;
  double most_ulps;
};

constexpr std::array<Function2, 2> kFunctions2{{
    {"atan2", portable::atan2, std::atan2, 15963299140276403545u, 2.0},
    {"hypot", portable::hypot, std::hypot, 14543752511786234613u, 1.3},
}};

constexpr std::array<double, 17> kSpecial{0.0,   -0.0,   kSmallest, -kSmallest, 1e-310,    2.2250738585072014e-308,
                                          1e-20, -1e-20, 0.5,       1.0,        -1.0,      3.0,
                                          -3.0,  1e7,    kLargest,  kInfinity,  -kInfinity};

void check_same(const char* name, double x, double y, double got, long double want, double most_ulps) {
  const double off = ulps(got, want);
  CHECK_TEXT(off <= most_ulps && (std::isnan(want) || std::signbit(got) == std::signbit(want)),
             StringFromFormat("%s(%.17g, %.17g) = %.17g, %.3f ulp off", name, x, y, got, off).asCharString());
}

void check_is_the_nan(double got) {
  CHECK_EQUAL(std::bit_cast<std::uint64_t>(kNan), std::bit_cast<std::uint64_t>(got));
}

}  // namespace

TEST_GROUP(Portable){};

TEST(Portable, FunctionsOfOneArgumentAreAccurateAndTheSameBitsEverywhere) {
  for (const Function& f : kFunctions) {
    Hash hash;
    for (const Range& range : f.ranges) {
      if (range.to == 0.0) break;
      for (std::uint64_t step = 0; step <= kSteps; ++step) {
        for (const double sign : {1.0, -1.0}) {
          if (sign < 0.0 && !f.negative) break;
          const double x = sign * between(range.from, range.to, step);
          const double got = f.ours(x);
          hash.add(got);
          check_same(f.name, x, 0.0, got, f.oracle(x), f.most_ulps);
        }
      }
    }
    CHECK_EQUAL_TEXT(f.hash, hash.value(), f.name);
  }
}

TEST(Portable, FunctionsOfTwoArgumentsAreAccurateAndTheSameBitsEverywhere) {
  for (const Function2& f : kFunctions2) {
    Hash hash;
    const auto both = [&](double x, double y) {
      const double got = f.ours(x, y);
      hash.add(got);
      check_same(f.name, x, y, got, f.oracle(x, y), f.most_ulps);
    };
    for (const double y : {1e-310, 1e-5, 0.3, 1.0, 1.7, 37.0, 1e300}) {
      for (std::uint64_t step = 0; step <= kSteps / 8; ++step) {
        for (const Range& range : {Range{kSmallest, kLargest}, Range{0.05, 20.0}, Range{0.999, 1.001}}) {
          const double x = between(range.from, range.to, 8 * step);
          both(x, y);
          both(x, -y);
          both(-x, y);
          both(-x, -y);
        }
      }
    }
    CHECK_EQUAL_TEXT(f.hash, hash.value(), f.name);
  }
}

TEST(Portable, SpecialValuesAreThoseOfTheStandard) {
  for (const double x : kSpecial) {
    for (const Function& f : kFunctions) {
      const bool angle = f.ranges[3].to == kLargestAngle;
      if (angle && std::abs(x) > kLargestAngle && std::isfinite(x)) continue;
      check_same(f.name, x, 0.0, f.ours(x), f.oracle(x), f.most_ulps);
      if (std::isnan(f.oracle(x))) check_is_the_nan(f.ours(x));
    }
    for (const double y : kSpecial) {
      check_same("atan2", x, y, portable::atan2(x, y), std::atan2<long double>(x, y), 2.0);
      check_same("hypot", x, y, portable::hypot(x, y), std::hypot<long double>(x, y), 1.3);
    }
    check_is_the_nan(portable::atan2(x, kNan));
    check_is_the_nan(portable::atan2(-kNan, x));
    if (std::isfinite(x)) check_is_the_nan(portable::hypot(x, -kNan));
  }
  for (const Function& f : kFunctions) {
    check_is_the_nan(f.ours(kNan));
    check_is_the_nan(f.ours(-kNan));
  }
  DOUBLES_EQUAL(kInfinity, portable::hypot(kInfinity, kNan), 0.0);
}

// Next to the zeros of sine and cosine everything but the last pieces of pi/2 cancels.
TEST(Portable, AnglesBesideWholeQuarterTurnsKeepTheirDigits) {
  for (int quarter = 1; quarter < 60'000'000; quarter += quarter < 3000 ? 1 : 7919) {
    const double x = quarter * 1.5707963267948966;
    check_same("sin", x, 0.0, portable::sin(x), std::sin(static_cast<long double>(x)), 0.9);
    check_same("cos", x, 0.0, portable::cos(x), std::cos(static_cast<long double>(x)), 0.9);
  }
}

TEST(Portable, HugeAnglesStayBounded) {
  for (const double x : {1.01e8, -3e15, 1e22, kLargest}) {
    const double s = portable::sin(x);
    const double c = portable::cos(x);
    DOUBLES_EQUAL(1.0, s * s + c * c, 1e-15);
  }
  // The drift that the header states, just beyond the limit.
  DOUBLES_EQUAL(std::sin(1.01e8), portable::sin(1.01e8), 1e-7);
}
