// SPDX-License-Identifier: Apache-2.0
// The functions of <cmath> that libraries round differently, the same to the last bit on every CPU: scenes are
// compared as bytes between machines. Built from + - * / and sqrt, which IEEE 754 rounds correctly, and from exact
// steps (frexp, ldexp, bits), in a file without contraction of products (drivers/CMakeLists.txt sees to it).
//
// Errors, largest seen against long double over dense sweeps (portable_test.cpp asserts them), in units of the last
// place: sin, cos, exp, log, cbrt 1; asin, expm1, hypot 1.5; atan2 2; tan 2.5; erfc 4.5. A denormal
// result may be half a unit worse: it is rounded twice.
// Cost next to glibc's: 0.7 times (atan2, hypot) to twice (exp 8 ns, log 8 ns, sin 12 ns).
//
// Range: any double. Special values as <cmath> has them (C17 annex F), with these differences:
//   * every NaN that comes out is the same one, whatever went in
//   * sin, cos, tan: beyond 1e8 the argument's period is the double next to 2 pi, so the phase drifts (1e-16 of the
//     argument); the value stays within [-1, 1]
// errno and floating-point exceptions mean nothing here.
#pragma once

namespace holdfast::scene::portable {

[[nodiscard]] double sin(double x);
[[nodiscard]] double cos(double x);
[[nodiscard]] double tan(double x);
[[nodiscard]] double asin(double x);
[[nodiscard]] double atan2(double y, double x);
[[nodiscard]] double exp(double x);
[[nodiscard]] double expm1(double x);
[[nodiscard]] double log(double x);
[[nodiscard]] double cbrt(double x);
[[nodiscard]] double erfc(double x);
[[nodiscard]] double hypot(double x, double y);

}  // namespace holdfast::scene::portable
