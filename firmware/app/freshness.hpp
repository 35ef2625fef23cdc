// SPDX-License-Identifier: Apache-2.0
// Whether a sensor's picture is news.
//
// The worst accident in the records is the frozen frame: a camera that stopped, the same picture served on with new
// stamps, and a robot that went on open loop (pollen-robotics/grabette #89). A driver can do the same with a ring of
// old buffers. No two pictures of a sensor are alike, because they have noise: one that was shown before is refused, by
// what was decoded, since bytes that nobody looks at (a JPEG comment) may differ. Of sources that are no sensor
// (hal::Camera::live()) nothing is asked.
//
// Known limitation: a ring of more than kRemembered pictures, ten seconds at 25 fps. V4L2 has at most 32 buffers.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "base/math.hpp"
#include "base/status.hpp"
#include "vision/luma.hpp"

namespace holdfast::freshness {

inline constexpr std::size_t kRemembered = 256;  // pictures

struct State {
  std::array<std::uint64_t, kRemembered> seen{};  // fingerprints of the newest `count`, a ring
  std::size_t count = 0;
  std::size_t next = 0;
  std::uint32_t sequence = 0;  // of the frame before
  bool any = false;
  std::uint32_t repeated = 0;  // frames since start; saturates
};

// The stream begins anew, and counts anew. Pictures of before stay known.
inline void restart(State& state) {
  state.any = false;
}

// Of the picture's shape and of up to kSampledWords runs of eight pixels, spread evenly over its rows. A sensor whose
// pictures differ in one pixel of a hundred has two equal ones once in 1e35. Multiply and rotate, 64 bits: any one
// word that changes changes it.
// Range: rows of 8 pixels and more (kMinLumaWidth).
inline constexpr std::size_t kSampledWords = 1024;
[[nodiscard]] inline std::uint64_t fingerprint_of(const LumaView& luma) {
  const std::size_t words_a_row = idx(luma.width) / 8;
  const std::size_t words = words_a_row * idx(luma.height);
  const std::size_t step = words / kSampledWords + 1;
  std::uint64_t hash = 0xcbf29ce484222325u ^ (idx(luma.width) << 32 | idx(luma.height));
  const std::uint8_t* row = luma.data;
  std::size_t in_row = 0;
  for (std::size_t k = 0; k < words; k += step) {
    std::uint64_t word = 0;
    std::memcpy(&word, row + in_row * 8, sizeof word);
    hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
    hash = std::rotl(hash, 29);
    for (in_row += step; in_row >= words_a_row && k + step < words; in_row -= words_a_row) row += luma.stride;
  }
  return hash;
}

// kFrameFrozen when the picture is one of the last kRemembered, or has the number of the frame before.
[[nodiscard]] inline Status update(State& state, const LumaView& luma, std::uint32_t sequence) {
  const std::uint64_t fingerprint = fingerprint_of(luma);
  const std::span<const std::uint64_t> seen = std::span(state.seen).first(state.count);
  const bool known = std::find(seen.begin(), seen.end(), fingerprint) != seen.end();
  const bool same_number = state.any && sequence == state.sequence;
  state.any = true;
  state.sequence = sequence;
  state.seen[state.next] = fingerprint;
  state.next = (state.next + 1) % kRemembered;
  state.count = std::min(state.count + 1, kRemembered);
  if (!known && !same_number) return kOkStatus;
  count_up(state.repeated);
  return {Reason::kFrameFrozen};
}

}  // namespace holdfast::freshness
