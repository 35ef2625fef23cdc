// SPDX-License-Identifier: Apache-2.0
// The few integer functions that more than one stage needs.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace holdfast {

// Quotient rounded to nearest, halves away from zero.
// Range: |numerator| <= 2^62, denominator in [1, 2^61]; the sum with half the denominator stays below 2^63.
[[nodiscard]] constexpr std::int64_t div_round(std::int64_t numerator, std::int64_t denominator) {
  const std::int64_t half = denominator / 2;
  return (numerator >= 0 ? numerator + half : numerator - half) / denominator;
}

// Largest r with r * r <= value. Range: any uint64. Newton's method from above: the first guess is off
// by a quarter and 1 at most, so six divisions do.
[[nodiscard]] constexpr std::uint32_t isqrt(std::uint64_t value) {
  if (value == 0) return 0;
  const int half = (63 - std::countl_zero(value)) / 2;
  std::uint64_t root = 0, next = ((std::uint64_t{1} << half) + (value >> half) + 1) / 2;
  do {
    root = next;
    next = (root + value / root) / 2;
  } while (next < root);
  return static_cast<std::uint32_t>(root);
}

// log2 of value in Q8, rounded down. Range: any value >= 1; result 0..16383. One squaring a bit, always eight; each
// cuts off less than 2^-31, so that a value less than 2^-22 of an LSB above a step may still count as below it.
[[nodiscard]] constexpr std::int32_t log2_q8(std::uint64_t value) {
  const int power = 63 - std::countl_zero(value);
  std::uint64_t mantissa = power > 31 ? value >> (power - 31) : value << (31 - power);  // [1, 2) in Q31
  std::int32_t log = power;
  for (int bit = 0; bit < 8; ++bit) {
    mantissa = (mantissa * mantissa) >> 31;
    const std::uint64_t two = mantissa >> 32;
    mantissa >>= two;
    log = log * 2 + static_cast<std::int32_t>(two);
  }
  return log;
}

// 1000 * 2^(value / 256), within 0.4 %. Range: a Log2Q8; up to 2^42.
[[nodiscard]] constexpr std::int64_t exp2_milli(std::int32_t value_q8) {
  const std::int32_t whole = value_q8 >> 8;
  const std::int64_t f = value_q8 & 255;
  // 2^f = 1 + 0.6565 f + 0.3435 f^2 within 0.4 % from 0 to 1.
  const std::int64_t mantissa_q16 = 65536 + f * 168 + f * f * 22'512 / 65536;
  const std::int64_t milli_q16 = 1000 * mantissa_q16;
  return whole >= 0 ? (milli_q16 << whole) >> 16 : milli_q16 >> std::min(16 - whole, 62);
}

// Range: |value| <= 3'037'000'499, the root of 2^63.
[[nodiscard]] constexpr std::int64_t square(std::int64_t value) {
  return value * value;
}

// For what is counted since start: stays at its largest value. One that wrapped would say that nothing had happened.
constexpr void count_up(std::uint32_t& counter, std::uint32_t by = 1) {
  counter += by < UINT32_MAX - counter ? by : UINT32_MAX - counter;
}

// Array index of a non-negative int; spares a static_cast at each use.
[[nodiscard]] constexpr std::size_t idx(std::int32_t i) {
  return static_cast<std::size_t>(i);
}

// Sorts a handful of integers in place: insertion sort, because std::sort recurses.
// Range: count <= 768 in this firmware (neighbour distances of 192 dots), so at most 294 528 moves.
constexpr void sort_few(std::int32_t* values, int count) {
  for (int i = 1; i < count; ++i) {
    const std::int32_t value = values[i];
    int hole = i;
    for (; hole > 0 && values[hole - 1] > value; --hole) values[hole] = values[hole - 1];
    values[hole] = value;
  }
}

// The middle value (lower middle of an even count); sorts in place. Range: count >= 1.
[[nodiscard]] constexpr std::int32_t median_of_few(std::int32_t* values, int count) {
  sort_few(values, count);
  return values[(count - 1) / 2];
}

}  // namespace holdfast
