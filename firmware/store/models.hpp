// SPDX-License-Identifier: Apache-2.0
// A model as it is stored: the payload of a sealed record (sealed.hpp).
//
//   payload  what decides slip
//      5296  the tree in these bytes, which `holdfast compile --binary` wrote (slip/model_file.hpp)
//         0  the tree that is compiled in
//
// The way back is a record like any other, so that it is as durable as the way there, and nobody goes it who may not
// go the other one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "slip/model.hpp"
#include "slip/model_file.hpp"
#include "store/sealed.hpp"
#include "store/slot_store.hpp"

namespace holdfast::models {

inline constexpr std::size_t kMostPayload = model_file::kBytes;
inline constexpr std::size_t kMostBytes = kMostPayload + sealed::kAround;  // of a record
static_assert(kMostBytes == 5380);

// Why this firmware cannot decide by it; kNone: it can. Range: any bytes. Takes a tree of stack: 4.1 kB.
[[nodiscard]] model_file::Refusal refusal_of(std::span<const std::uint8_t> payload);
[[nodiscard]] bool good(std::span<const std::uint8_t> payload);

// What decides by a store of such records: `tree`, which is filled then, or null: the tree that is compiled in.
// For a start. With a damaged slot (SlotStore::damaged, counts) either is to be held in FAULT.
[[nodiscard]] const model::Tree* in_force(const SlotStore& slots, model::Tree& tree);

}  // namespace holdfast::models
