// SPDX-License-Identifier: Apache-2.0
// What the integer gate must let pass: a double that only the compiler sees.
#include <cstdint>

consteval std::int32_t to_q8(double value) {
  return static_cast<std::int32_t>(value * 256.0);
}

std::int32_t scaled(std::int32_t value);
std::int32_t scaled(std::int32_t value) {
  return (value * to_q8(0.375)) >> 8;
}
