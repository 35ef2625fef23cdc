// SPDX-License-Identifier: Apache-2.0
// Random numbers of a scene: integers, so the same on every machine. xoshiro256** by Blackman and Vigna, state filled
// by splitmix64 (both public domain).
#pragma once

#include <array>
#include <bit>
#include <cstdint>

namespace holdfast::scene {

class Random {
 public:
  explicit Random(std::uint64_t seed) {
    for (std::uint64_t& word : state_) {
      seed += 0x9e3779b97f4a7c15u;
      std::uint64_t z = seed;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
      z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
      word = z ^ (z >> 31);
    }
  }
  // A stream of its own for each purpose and frame of a scene.
  Random(std::uint64_t seed, std::uint64_t purpose, std::uint64_t frame)
      : Random(seed * 0x9e3779b97f4a7c15u ^ std::rotl(purpose * 0xd1342543de82ef95u, 17) ^
               std::rotl(frame * 0xd1342543de82ef95u, 32)) {}

  std::uint64_t next() {
    const std::uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = std::rotl(state_[3], 45);
    return result;
  }

  // [0, 1): 53 bits.
  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }

  // The sum of 12 uniforms of 16 bits: sigma 1, none beyond 6.
  double normal() {
    std::int32_t sum = -393210;
    for (int draw = 0; draw < 3; ++draw) {
      const std::uint64_t bits = next();
      for (int k = 0; k < 64; k += 16) sum += static_cast<std::int32_t>((bits >> k) & 0xffff);
    }
    return sum * 0x1p-16;
  }

  // 0 .. count - 1; count >= 1. The bias of count / 2^64 is no matter here.
  int below(int count) { return static_cast<int>(next() % static_cast<std::uint64_t>(count)); }

 private:
  std::array<std::uint64_t, 4> state_{};
};

}  // namespace holdfast::scene
