// SPDX-License-Identifier: Apache-2.0
// The parameters as they are stored: the payload of a sealed record (sealed.hpp).
//
//   offset  bytes  what
//        0    8 k  k entries, up to 64; what is not listed has its default:
//                    0  4  CRC-32 of the parameter's name
//                    4  4  value, signed, in the parameter's unit
//
// All numbers are little-endian. A value stands beside the CRC of its parameter's name, so that a firmware with other
// parameters takes those that it knows, within its own ranges, and leaves the others at their defaults.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "app/params.hpp"
#include "app/sealed.hpp"

namespace holdfast::settings {

inline constexpr std::size_t kMaxEntries = 64;
inline constexpr std::size_t kEntryBytes = 8;
inline constexpr std::size_t kMostPayload = kMaxEntries * kEntryBytes;
inline constexpr std::size_t kMostBytes = kMostPayload + sealed::kAround;  // of a record
static_assert(kParams.size() <= kMaxEntries);

enum class Loaded : std::uint8_t {
  kNothing,  // it holds no settings, or such that contradict each other
  kAll,
  kSome,  // values that this firmware does not know or does not allow were left out
};

// Lays what the payload holds over `params`, which changes only when the whole is valid. Range: any bytes.
Loaded read(std::span<const std::uint8_t> payload, Params& params);
// Whether a device that starts can use it: anything but kNothing over the defaults.
[[nodiscard]] bool good(std::span<const std::uint8_t> payload);
// Whether all of it counts here: what is taken from outside.
[[nodiscard]] bool fits(std::span<const std::uint8_t> payload);
// What differs from the defaults: a later firmware may have better ones. Its size. Range: `out` of kMostPayload.
[[nodiscard]] std::size_t write(const Params& params, std::span<std::uint8_t> out);

}  // namespace holdfast::settings
