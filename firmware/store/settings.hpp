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
#include <string_view>

#include "params/params.hpp"
#include "store/sealed.hpp"
#include "store/slot_store.hpp"

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

// What a start found of the settings that it is to go by.
enum class Found : std::uint8_t { kNoPlace, kFirst, kWhole, kPartly, kEither, kLost };

struct FoundInfo {
  Found found;
  std::string_view name;  // in the log
  std::string_view from;  // where the values come from, for people
};

inline constexpr std::array<FoundInfo, 6> kFound{{
    {Found::kNoPlace, "no_place", "defaults: there is no place to store any"},
    {Found::kFirst, "first_start", "defaults: none were ever stored"},
    {Found::kWhole, "whole", "what was stored"},
    {Found::kPartly, "partly", "what was stored, without values that this firmware does not know"},
    {Found::kEither, "one_of_two", "one of two records: the other, maybe the newer one, is damaged"},
    {Found::kLost, "lost", "defaults: what was stored is lost or damaged"},
}};

[[nodiscard]] constexpr const FoundInfo& info(Found found) {
  return kFound[static_cast<std::size_t>(found)];
}

// Values that somebody stored do not count now: the device may not say that all is fine (App::report) until somebody
// who may change them has said what counts.
[[nodiscard]] constexpr bool lost(Found found) {
  return found == Found::kPartly || found == Found::kEither || found == Found::kLost;
}

// For a start: what is stored and counts (SlotStore::counts), over `params`.
Found take(const SlotStore& slots, Params& params);

}  // namespace holdfast::settings
