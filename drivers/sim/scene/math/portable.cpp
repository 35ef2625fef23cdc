// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/math/portable.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

namespace holdfast::scene::portable {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// --- Exact and double-double arithmetic ---

// A value as the sum of two doubles, the second below half a unit of the first.
struct Pair {
  double hi;
  double lo;
};

// Sum without error, |a| >= |b| or a == 0 (Dekker 1971).
Pair fast_sum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

// Sum without error (Knuth).
Pair exact_sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}

// Product without error, |a|, |b| < 2^990: each factor in two halves of 26 bits (Veltkamp, Dekker).
Pair exact_product(double a, double b) {
  constexpr double kSplit = 134217729.0;  // 2^27 + 1
  const double a_high = kSplit * a - (kSplit * a - a);
  const double b_high = kSplit * b - (kSplit * b - b);
  const double a_low = a - a_high;
  const double b_low = b - b_high;
  const double product = a * b;
  return {product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low};
}

// Even and odd powers apart: two chains that a CPU runs side by side.
template <std::size_t kCount>
double polynomial(double x, const std::array<double, kCount>& c) {
  static_assert(kCount >= 2);
  const double square = x * x;
  double first = c[kCount - 1];
  double second = c[kCount - 2];
  for (std::size_t i = kCount - 2; i >= 2; i -= 2) {
    first = first * square + c[i - 1];
    second = second * square + c[i - 2];
    if (i == 3) return second * x + (first * square + c[0]);
  }
  return first * x + second;
}

// 1 / n!, 1 / (n + step)!, ... ; factorials are exact up to 22!.
template <std::size_t kCount>
constexpr std::array<double, kCount> inverse_factorials(int n, int step, double sign = 1.0) {
  std::array<double, kCount> out{};
  double factor = 1.0;
  for (std::size_t i = 0; i < kCount; ++i, n += step, factor *= sign) {
    double factorial = 1.0;
    for (int k = 2; k <= n; ++k) factorial *= k;
    out[i] = factor / factorial;
  }
  return out;
}

// Of erf(x) sqrt(pi) / (2 x) in x^2: (-1)^n / (n! (2 n + 1)).
template <std::size_t kCount>
constexpr std::array<double, kCount> erf_terms() {
  std::array<double, kCount> out{};
  double factorial = 1.0;
  for (std::size_t n = 0; n < kCount; ++n) {
    const auto k = static_cast<double>(n);
    if (n > 1) factorial *= k;
    out[n] = (n % 2 == 0 ? 1.0 : -1.0) / (factorial * (2.0 * k + 1.0));
  }
  return out;
}

// scale / n, scale / (n + 2), ...
template <std::size_t kCount>
constexpr std::array<double, kCount> inverse_odds(int n, double scale, double sign) {
  std::array<double, kCount> out{};
  for (std::size_t i = 0; i < kCount; ++i, n += 2, scale *= sign) out[i] = scale / n;
  return out;
}

// Nearest whole number, |x| < 2^51: above 1.5 * 2^52 a double has no fraction.
double nearest(double x) {
  constexpr double kNoFraction = 0x1.8p52;
  return (x + kNoFraction) - kNoFraction;
}

double times_power_of_two(double x, int exponent) {
  if (exponent < -1021 || exponent > 1023) return std::ldexp(x, exponent);
  return x * std::bit_cast<double>(static_cast<std::uint64_t>(exponent + 1023) << 52);
}

// --- Angles ---

constexpr Pair kHalfPi{0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54};

struct Turned {
  Pair rest;  // -pi/4 .. pi/4
  unsigned quarter;
};

// x less the nearest whole number of quarter turns (Cody and Waite). pi/2 in pieces of 27 bits, so their products
// with a quarter of up to 26 bits are exact; what cancels is at most 2^-53, the last piece is good to 2^-113.
Turned turn(double x) {
  constexpr std::array<double, 4> kPieces{0x1.921fb54p+0, 0x1.10b461p-30, 0x1.a62633p-58, 0x1.45c06e0e68948p-86};
  constexpr double kLimit = 1e8;
  constexpr double kPeriod = 4.0 * kHalfPi.hi;
  if (!(std::abs(x) <= kLimit)) x = std::remainder(x, kPeriod);
  const double quarter = nearest(x * (1.0 / kHalfPi.hi));
  const Pair first = exact_sum(x - quarter * kPieces[0], -(quarter * kPieces[1]));
  const Pair second = exact_sum(first.hi, -(quarter * kPieces[2]));
  const Pair rest = fast_sum(second.hi, (first.lo + second.lo) - quarter * kPieces[3]);
  return {rest, static_cast<unsigned>(static_cast<int>(quarter)) & 3u};
}

// Taylor's series; the first term left out is 1e-19 of the result for sine, 2e-18 for cosine.
double sin_of_rest(Pair x) {
  static constexpr auto kTerms = inverse_factorials<8>(3, 2, -1.0);
  const double z = x.hi * x.hi;
  return x.hi - (x.hi * z * polynomial(z, kTerms) - x.lo * (1.0 - 0.5 * z));
}

double cos_of_rest(Pair x) {
  static constexpr auto kTerms = inverse_factorials<7>(4, 2, -1.0);
  const double z = x.hi * x.hi;
  const Pair start = fast_sum(1.0, -0.5 * z);
  return start.hi + (start.lo + (z * z * polynomial(z, kTerms) - x.hi * x.lo));
}

// --- Exponential ---

constexpr Pair kLn2{0x1.62e42fefa2000p-1, 0x1.9ef35793c7673p-41};  // 40 bits, the rest

struct Reduced {
  Pair rest;  // -ln(2)/2 .. ln(2)/2
  int power;
};

// hi + lo less a whole number of ln 2. Range: |hi| < 1100, so the first product and difference are exact.
Reduced less_powers_of_two(double hi, double lo) {
  const double power = nearest(hi * 1.4426950408889634);
  return {exact_sum(hi - power * kLn2.hi, lo - power * kLn2.lo), static_cast<int>(power)};
}

// e^x - 1 - x of the rest: Taylor's series; the first term left out is 1e-17 of x.
double beyond_linear(Pair x) {
  static constexpr auto kTerms = inverse_factorials<12>(2, 1);
  return x.hi * x.hi * polynomial(x.hi, kTerms) + x.lo;
}

double exp_of_sum(double hi, double lo) {
  if (hi > 710.0) return kInfinity;
  if (hi < -746.0) return 0.0;
  const Reduced x = less_powers_of_two(hi, lo);
  return times_power_of_two(1.0 + (x.rest.hi + beyond_linear(x.rest)), x.power);
}

// --- Logarithm ---

struct Split {
  double less_one;  // mantissa - 1, the mantissa in sqrt(1/2) .. sqrt(2)
  double power;
};

// Range: x > 0, finite.
Split split(double x) {
  double shift = 0.0;
  if (x < std::numeric_limits<double>::min()) {
    x *= 0x1p54;
    shift = -54.0;
  }
  constexpr auto kSqrtHalf = std::bit_cast<std::uint64_t>(0x1.6a09e667f3bcdp-1);
  const auto bits = std::bit_cast<std::uint64_t>(x);
  const std::uint64_t power = (bits - kSqrtHalf) & 0xfff0000000000000u;
  return {std::bit_cast<double>(bits - power) - 1.0,
          static_cast<double>(static_cast<std::int64_t>(power) >> 52) + shift};
}

// ln((1 + f) 2^k). With s = f / (2 + f), ln(1 + f) = 2 atanh s = 2 s + s R(s^2), and 2 s = f - s f, so
// f - s (f - R): f is exact and only the small second term is rounded. |s| < 0.172; first term left out: 6e-19.
double log_of(Split x) {
  static constexpr auto kTerms = inverse_odds<10>(3, 2.0, 1.0);
  const double f = x.less_one;
  const double s = f / (2.0 + f);
  const double z = s * s;
  return x.power * kLn2.hi + (f - (s * (f - z * polynomial(z, kTerms)) - x.power * kLn2.lo));
}

}  // namespace

double sin(double x) {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  const Turned t = turn(x);
  const double value = t.quarter % 2 == 0 ? sin_of_rest(t.rest) : cos_of_rest(t.rest);
  return t.quarter < 2 ? value : -value;
}

double cos(double x) {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return 1.0;
  const Turned t = turn(x);
  const double value = t.quarter % 2 == 0 ? cos_of_rest(t.rest) : sin_of_rest(t.rest);
  return t.quarter == 0 || t.quarter == 3 ? value : -value;
}

double tan(double x) {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  const Turned t = turn(x);
  const double sine = sin_of_rest(t.rest);
  const double cosine = cos_of_rest(t.rest);
  return t.quarter % 2 == 0 ? sine / cosine : -(cosine / sine);
}

// Up to 1/2 by a Chebyshev series of (asin(x)/x - 1) / x^2 in x^2 (13 terms, written as powers; truncation 3e-18 of
// the result); above through the half angle, pi/2 - 2 asin(sqrt((1 - x) / 2)).
double asin(double x) {
  static constexpr std::array<double, 13> kTerms{
      0.16666666666666669,  0.0749999999999834,    0.04464285714653523,  0.03038194412500875, 0.022372173467043486,
      0.017352380709839098, 0.01397138708310213,   0.011477517005507167, 0.01033337215296726, 0.005413184483715509,
      0.01751883397953867,  -0.015032162599250314, 0.028878362746452394};
  const double away = std::abs(x);
  if (!(away <= 1.0)) return kNan;
  if (away < 0x1p-27) return x;
  if (away <= 0.5) {
    const double z = x * x;
    return x + x * (z * polynomial(z, kTerms));
  }
  const double z = 0.5 * (1.0 - away);
  const double s = std::sqrt(z);
  const Pair straight = fast_sum(kHalfPi.hi, -2.0 * s);
  const double angle = straight.hi + ((straight.lo + kHalfPi.lo) - 2.0 * s * (z * polynomial(z, kTerms)));
  return std::copysign(angle, x);
}

// The angle to the nearer axis, less the nearest of nine angles whose tangents are whole eighths:
// atan(q) - atan(c) = atan((q - c) / (1 + c q)) =: atan(u), |u| <= 1/16. First term left out: u^15 / 15, 6e-20.
double atan2(double y, double x) {
  static constexpr auto kTerms = inverse_odds<6>(3, 1.0, -1.0);
  static constexpr std::array<Pair, 9> kEighths{{{0.0, 0.0},
                                                 {0.12435499454676144, -3.1253241424539383e-18},
                                                 {0.24497866312686414, 1.0698755618734451e-17},
                                                 {0.35877067027057225, -2.4623815582638635e-17},
                                                 {0.4636476090008061, 2.2698777452961687e-17},
                                                 {0.5585993153435624, -5.4556305485916264e-18},
                                                 {0.6435011087932844, 1.5834785051444286e-17},
                                                 {0.7188299996216245, -2.1478388444456983e-17},
                                                 {0.7853981633974483, 3.061616997868383e-17}}};
  if (std::isnan(x) || std::isnan(y)) return kNan;
  double small = std::abs(y);
  double large = std::abs(x);
  const bool steep = small > large;
  if (steep) std::swap(small, large);
  if (std::isinf(large)) {
    small = std::isinf(small) ? 1.0 : 0.0;
    large = 1.0;
  }
  // c * large must neither overflow nor lose digits to denormals.
  if (large > 0x1p1000 || large < 0x1p-900) {
    const double scale = large > 1.0 ? 0x1p-100 : 0x1p100;
    small *= scale;
    large *= scale;
  }
  double angle = 0.0;
  if (small > 0.0) {
    double u = small / large;
    const auto eighth = static_cast<std::size_t>(8.0 * u + 0.5);
    if (eighth > 0) {
      const double c = static_cast<double>(eighth) / 8.0;
      u = (small - c * large) / (large + c * small);
    }
    const double z = u * u;
    angle = kEighths[eighth].hi + (kEighths[eighth].lo + (u - u * (z * polynomial(z, kTerms))));
  }
  const auto from = [&angle](Pair whole) {
    const Pair difference = fast_sum(whole.hi, -angle);
    angle = difference.hi + (difference.lo + whole.lo);
  };
  if (steep) from(kHalfPi);
  if (std::signbit(x)) from({2.0 * kHalfPi.hi, 2.0 * kHalfPi.lo});
  return std::copysign(angle, y);
}

double exp(double x) {
  return std::isnan(x) ? kNan : exp_of_sum(x, 0.0);
}

// 2^k e^r - 1 = (2^k - 1) + 2^k r + 2^k (e^r - 1 - r), the largest parts first.
double expm1(double x) {
  if (std::isnan(x)) return kNan;
  if (x < -40.0) return -1.0;
  if (x > 50.0) return exp_of_sum(x, 0.0);
  if (std::abs(x) < 0x1p-54) return x;
  const Reduced r = less_powers_of_two(x, 0.0);
  const double scale = times_power_of_two(1.0, r.power);
  const Pair sum = exact_sum(scale - 1.0, scale * r.rest.hi);
  return sum.hi + (sum.lo + scale * beyond_linear(r.rest));
}

double log(double x) {
  if (std::isnan(x) || x < 0.0) return kNan;
  if (x == 0.0) return -kInfinity;
  if (std::isinf(x)) return x;
  return log_of(split(x));
}

// A cubic good to 0.5 % on 1/8 .. 1 (minimax), then two steps of Halley's method: the error e becomes 2/3 e^3.
double cbrt(double x) {
  static constexpr std::array<double, 4> kStart{0.3408419, 1.4581131, -1.3859251, 0.59218529};
  if (std::isnan(x)) return kNan;
  if (x == 0.0 || std::isinf(x)) return x;
  int exponent = 0;
  double mantissa = std::frexp(std::abs(x), &exponent);
  const int thirds = (exponent + 1074 + 2) / 3 - 1074 / 3;  // rounded up: the mantissa stays at most 1
  mantissa = times_power_of_two(mantissa, exponent - 3 * thirds);
  double root = polynomial(mantissa, kStart);
  for (int step = 0; step < 2; ++step) {
    const double cube = root * root * root;
    root += root * (mantissa - cube) / (2.0 * cube + mantissa);
  }
  return std::copysign(times_power_of_two(root, thirds), x);
}

// Near 0 by Taylor's series of erf (first term left out: 5e-18). Else
// erfc(x) = e^(-x^2) g(t) / (1 + 2 x) for x >= 0 with t = (x - 3) / (x + 3): g is smooth and within 1 .. 1.26 for
// t in -1 .. 1 (Shepherd and Laframboise 1981 have the mapping). Chebyshev series of 28 terms, as powers; 6e-18.
double erfc(double x) {
  static constexpr auto kNear = erf_terms<12>();
  constexpr double kTwoOverRootPi = 1.1283791670955126;
  static constexpr std::array<double, 28> kTerms{
      1.2530080582697296,     -0.1356211061245812,     -0.04756229435345109,    0.1296451587027629,
      -0.11927366341528023,   0.06830802734391057,     -0.023770514919506852,   0.0025293918169509407,
      0.0018886903716907627,  -0.0007798322781262303,  -0.00010515990108729849, 0.00012509937456456623,
      4.949988662264347e-06,  -2.0100605325083817e-05, -7.33143259743597e-07,   3.472390115145775e-06,
      3.603910925712771e-07,  -6.163869055512103e-07,  -1.4683175494120584e-07, 1.0126845607238986e-07,
      4.6950946691614734e-08, -1.2581767405545219e-08, -1.1734464137789657e-08, 4.4817555029519333e-10,
      2.0626322959832455e-09, 2.1675048969615204e-10,  -1.881936630944858e-10,  -3.722451327004375e-11};
  if (std::isnan(x)) return kNan;
  const double away = std::abs(x);
  if (away < 0.5) return 1.0 - kTwoOverRootPi * x * polynomial(x * x, kNear);
  double tail = 0.0;
  if (away < 28.0) {
    const Pair square = exact_product(away, away);
    tail = exp_of_sum(-square.hi, -square.lo) * polynomial((away - 3.0) / (away + 3.0), kTerms) / (1.0 + 2.0 * away);
  }
  return x < 0.0 ? 2.0 - tail : tail;
}

double hypot(double x, double y) {
  const double large = std::max(std::abs(x), std::abs(y));
  if (std::isinf(x) || std::isinf(y)) return kInfinity;
  if (std::isnan(x) || std::isnan(y)) return kNan;
  // Squares must stay within the doubles.
  double scale = 1.0;
  if (large > 0x1p500) scale = 0x1p-600;
  if (large < 0x1p-450) scale = 0x1p600;
  x *= scale;
  y *= scale;
  return std::sqrt(x * x + y * y) / scale;
}

}  // namespace holdfast::scene::portable
