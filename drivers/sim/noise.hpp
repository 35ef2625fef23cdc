// SPDX-License-Identifier: Apache-2.0
// What tells two pictures of a sensor apart, for pictures that are shown again and again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::sim {

// One level in every second pixel, by chance; the same for the same seed.
inline void add_noise(std::span<std::uint8_t> luma, std::uint64_t seed) {
  scene::Random random(seed);
  std::uint64_t word = 0;
  for (std::size_t k = 0; k + sizeof word <= luma.size(); k += sizeof word) {
    std::memcpy(&word, &luma[k], sizeof word);
    word ^= random.next() & 0x0101010101010101u;
    std::memcpy(&luma[k], &word, sizeof word);
  }
}

}  // namespace holdfast::sim
