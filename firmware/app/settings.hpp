// SPDX-License-Identifier: Apache-2.0
// The parameters as they are stored: in binary, checked, in two slots that are written in turn.
//
// A value stands beside the CRC of its parameter's name, so that a firmware with other parameters takes those that it
// knows, within its own ranges, and leaves the others at their defaults.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "app/params.hpp"

namespace holdfast::settings {

inline constexpr std::uint32_t kMagic = 0x54534448;  // "HDST", little endian
inline constexpr std::size_t kMaxEntries = 64;

struct Entry {
  std::uint32_t name_crc = 0;
  std::int32_t value = 0;
};

struct Slot {
  std::uint32_t magic = 0;
  std::uint32_t bytes = 0;
  std::uint32_t crc = 0;       // of what follows
  std::uint32_t sequence = 0;  // the larger is the newer
  std::uint32_t count = 0;
  std::array<Entry, kMaxEntries> entries{};
};

inline constexpr std::size_t kBytes = 2 * sizeof(Slot);
static_assert(kParams.size() <= kMaxEntries);

struct State {
  Slot slot;
  std::uint32_t sequence = 0;
  std::size_t next = 0;
};

enum class Loaded : std::uint8_t {
  kNothing,  // none were ever stored, or neither slot is sound
  kAll,
  kSome,  // values that this firmware does not know or does not allow were left out
};

// Lays what is stored over `params`, which changes only when the whole is valid. Range: any bytes.
Loaded load(State& state, std::span<const std::uint8_t> memory, Params& params);
// Over the older slot. False: there is no memory. After load().
[[nodiscard]] bool save(State& state, std::span<std::uint8_t> memory, const Params& params);

}  // namespace holdfast::settings
