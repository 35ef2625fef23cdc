// SPDX-License-Identifier: Apache-2.0
// What a process leaves to the next one: which sensor it was, where its markers rest and what its empty gel looks like.
// A firmware that is killed in the middle of a grasp, or started anew, goes on with it instead of learning a gel that
// something presses on.
//
// Two slots in memory that outlives the process (hal/keep.hpp), written in turn, so that a process killed while it
// writes, or a file system that is full, leaves the older one whole. A slot is believed only with its magic, its size,
// its version (of this very layout: another build learns anew) and its CRC, and then its figures are checked against
// their ranges.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>

#include "base/crc32.hpp"
#include "base/math.hpp"
#include "base/units.hpp"
#include "hal/keep.hpp"
#include "tactile/imprint.hpp"
#include "vision/markers.hpp"

namespace holdfast::checkpoint {

inline constexpr std::uint32_t kMagic = 0x464B4448;  // "HDKF", little endian
inline constexpr std::uint32_t kVersion = 5;
inline constexpr std::size_t kMaxIdentity = 64;

struct Identity {
  std::array<char, kMaxIdentity> text{};  // filled up with 0; what is longer is cut
  friend bool operator==(const Identity&, const Identity&) = default;
};

[[nodiscard]] inline Identity identity_of(std::string_view text) {
  Identity identity;
  std::copy_n(text.begin(), std::min(text.size(), identity.text.size()), identity.text.begin());
  return identity;
}

// The rest position and the empty gel. Everything is a plain number: the bytes are the format.
struct Contents {
  Identity sensor;
  std::int32_t width = 0, height = 0;  // of the working picture
  std::int32_t pitch_um = 0;           // as configured when it was learned
  PixelsQ8 pitch;                      // of the rest position
  MarkerField rest;
  MarkerField first;  // as it was learned: the drift that is followed counts from there
  imprint::Empty empty;
};

// How hard the gripper holds, so that the regulator goes on where it was: a gripper does not tell.
struct Grip {
  enum Doing : std::uint8_t { kNothing, kHolds, kLetsGo };  // the last from RELEASE until the gripper was told to open
  std::uint8_t doing = kNothing;
  std::uint8_t force = 0;  // counts
  friend bool operator==(const Grip&, const Grip&) = default;
};

template <typename Kept>
struct SlotOf {
  std::uint32_t magic = 0;
  std::uint32_t version = 0;
  std::uint32_t bytes = 0;
  std::uint32_t crc = 0;       // of the two below
  std::uint64_t sequence = 0;  // the larger is the newer
  Kept contents;
};

// In the process, because what lies outside may change under the reader's eyes.
template <typename Kept>
struct StateOf {
  SlotOf<Kept> slot;  // read last, or being written
  struct Pair {
    std::uint64_t sequence = 0;  // of the newer slot outside
    std::size_t next = 0;        // that save() writes
  };
  std::array<Pair, 2> pairs;    // of each finger
  std::uint32_t discarded = 0;  // slots that held something and were not believed
};

using Slot = SlotOf<Contents>;
using State = StateOf<Contents>;
using GripSlot = SlotOf<Grip>;
using GripState = StateOf<Grip>;
static_assert(std::is_trivially_copyable_v<Slot> && std::is_trivially_copyable_v<GripSlot>);

// Two slots of each, one after the other.
inline constexpr std::size_t kReferenceBytes = 2 * sizeof(Slot);
inline constexpr std::size_t kBytes = kReferenceBytes + 2 * sizeof(GripSlot);
inline constexpr std::size_t kHandBytes = kBytes + kReferenceBytes;  // and a right finger's reference

namespace detail {

template <typename Kept>
[[nodiscard]] std::uint32_t crc_of(const SlotOf<Kept>& slot) {
  const auto* const from = reinterpret_cast<const std::uint8_t*>(&slot.sequence);
  return crc32({from, sizeof slot - offsetof(SlotOf<Kept>, sequence)});
}

// A CRC is no proof that the figures are in range when another build wrote them.
[[nodiscard]] inline bool is_sane(const Contents& contents) {
  const auto in_range = [](PixelsQ8 value) { return value.raw() >= PixelsQ8::kMin && value.raw() <= PixelsQ8::kMax; };
  if (contents.rest.grid.rows == 0 || contents.rest.grid.cols == 0) return false;
  if (contents.rest.grid.count() > kMaxMarkers || contents.pitch.raw() <= 0 || !in_range(contents.pitch)) return false;
  if (contents.empty.frames < 0 || contents.empty.frames > imprint::kEmptyMean) return false;
  if (contents.first.grid != contents.rest.grid) return false;
  if (contents.empty.noise_relief < 0 || contents.empty.noise_relief > imprint::kMostRelief) return false;
  // Another byte in a bool is undefined, so it is looked at as a byte.
  const auto is_bool = [](const bool& one) { return std::bit_cast<std::uint8_t>(one) <= 1; };
  if (!std::ranges::all_of(contents.empty.learned, is_bool)) return false;
  if (!std::ranges::all_of(contents.empty.marked, is_bool)) return false;
  // 16 x luma in Q4.
  const auto is_luma = [](std::uint16_t sample_q4) { return sample_q4 <= 16 * 16 * 255; };
  for (const auto& eight : contents.empty.samples_q4) {
    if (!std::ranges::all_of(eight, is_luma)) return false;
  }
  const auto all_in_range = [&](const MarkerField& field) {
    return std::ranges::all_of(field.markers,
                               [&](const Marker& m) { return in_range(m.x) && in_range(m.y) && is_bool(m.valid); });
  };
  return all_in_range(contents.rest) && all_in_range(contents.first);
}
[[nodiscard]] inline bool is_sane(const Grip& grip) {
  return grip.doing <= Grip::kLetsGo;
}

template <typename Kept>
[[nodiscard]] std::span<std::uint8_t> bytes_of(SlotOf<Kept>& slot) {
  return {reinterpret_cast<std::uint8_t*>(&slot), sizeof slot};
}

[[nodiscard]] inline std::size_t place_of(const State& /*reference*/, std::size_t finger) {
  return finger == 0 ? 0 : kBytes;
}
[[nodiscard]] inline std::size_t place_of(const GripState& /*grip*/, std::size_t /*finger*/) {
  return kReferenceBytes;
}
[[nodiscard]] constexpr std::size_t needs(std::size_t finger) {
  return finger == 0 ? kBytes : kHandBytes;
}

}  // namespace detail

// Looks at both slots and leaves the newer sound one in state.slot. False: there is none, and state.slot is blank.
// Range: any bytes; `finger` 0 or 1, and 0 for the grip, which is the hand's.
template <typename Kept>
[[nodiscard]] bool load(StateOf<Kept>& state, hal::Keep& keep, std::size_t finger = 0) {
  constexpr std::size_t kSlot = sizeof(SlotOf<Kept>);
  auto& pair = state.pairs[finger];
  pair = {};
  if (keep.size() < detail::needs(finger)) return false;
  const std::size_t from = detail::place_of(state, finger);
  std::size_t best = 2;
  for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
    if (!keep.read(from + k * kSlot, detail::bytes_of(state.slot))) continue;
    const bool blank = state.slot.magic == 0;
    const bool sound = state.slot.magic == kMagic && state.slot.version == kVersion && state.slot.bytes == kSlot &&
                       state.slot.crc == detail::crc_of(state.slot) && detail::is_sane(state.slot.contents);
    if (!sound && !blank) count_up(state.discarded);
    if (!sound || (best < 2 && state.slot.sequence <= pair.sequence)) continue;
    best = k;
    pair.sequence = state.slot.sequence;
  }
  if (best < 2) pair.next = 1 - best;
  if (best < 2 && keep.read(from + best * kSlot, detail::bytes_of(state.slot)) &&
      state.slot.crc == detail::crc_of(state.slot)) {
    return true;
  }
  // What was not believed is nothing to compare with: keep_grip() would take a grip for kept that is not.
  std::ranges::fill(detail::bytes_of(state.slot), std::uint8_t{});
  return false;
}

// Writes state.slot.contents over the older slot. False: there is no memory, or it did not take all of it; then the
// next one goes over this slot again, and the other stays.
// Cost: a CRC over the slot, 20 kB for a reference: 0.6 M instructions. Once per rest position, and every few seconds
// on an empty gel.
template <typename Kept>
[[nodiscard]] bool save(StateOf<Kept>& state, hal::Keep& keep, std::size_t finger = 0) {
  constexpr std::size_t kSlot = sizeof(SlotOf<Kept>);
  auto& pair = state.pairs[finger];
  if (keep.size() < detail::needs(finger)) return false;
  state.slot.magic = kMagic;
  state.slot.version = kVersion;
  state.slot.bytes = kSlot;
  state.slot.sequence = ++pair.sequence;
  state.slot.crc = detail::crc_of(state.slot);
  const std::size_t at = detail::place_of(state, finger) + pair.next * kSlot;
  if (!keep.write(at, detail::bytes_of(state.slot))) return false;
  pair.next = 1 - pair.next;
  return true;
}

// The rest position that is kept is no longer true: another process must not go on with it.
// Range: of each slot so much is wiped that it is not believed. What takes no byte (full) holds none either.
inline void forget(State& state, hal::Keep& keep, std::size_t finger = 0) {
  constexpr std::array<std::uint8_t, offsetof(Slot, contents)> kBlank{};
  if (keep.size() < detail::needs(finger)) return;
  const std::size_t from = detail::place_of(state, finger);
  for (const std::size_t at : {from, from + sizeof(Slot)}) (void)keep.write(at, kBlank);
  state.pairs[finger].next = 0;
}

}  // namespace holdfast::checkpoint
