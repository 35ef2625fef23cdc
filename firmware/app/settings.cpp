// SPDX-License-Identifier: Apache-2.0
#include "app/settings.hpp"

#include <atomic>
#include <cstring>
#include <string_view>

#include "base/crc32.hpp"

namespace holdfast::settings {
namespace {

std::uint32_t crc_of(const Slot& slot) {
  const auto* const from = reinterpret_cast<const std::uint8_t*>(&slot.sequence);
  return crc32({from, sizeof slot - offsetof(Slot, sequence)});
}

std::uint32_t crc_of(std::string_view name) {
  return crc32({reinterpret_cast<const std::uint8_t*>(name.data()), name.size()});
}

const ParamInfo* find(std::uint32_t name_crc) {
  for (const ParamInfo& row : kParams) {
    if (crc_of(row.name) == name_crc) return &row;
  }
  return nullptr;
}

}  // namespace

Loaded load(State& state, std::span<const std::uint8_t> memory, Params& params) {
  state.sequence = 0;
  state.next = 0;
  if (memory.size() < kBytes) return Loaded::kNothing;
  std::size_t best = 2;
  for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
    std::memcpy(&state.slot, memory.data() + k * sizeof(Slot), sizeof(Slot));
    const bool sound = state.slot.magic == kMagic && state.slot.bytes == sizeof(Slot) &&
                       state.slot.count <= kMaxEntries && state.slot.crc == crc_of(state.slot);
    if (!sound || (best < 2 && state.slot.sequence <= state.sequence)) continue;
    best = k;
    state.sequence = state.slot.sequence;
  }
  if (best == 2) return Loaded::kNothing;
  state.next = 1 - best;
  std::memcpy(&state.slot, memory.data() + best * sizeof(Slot), sizeof(Slot));
  if (state.slot.crc != crc_of(state.slot) || state.slot.count > kMaxEntries) return Loaded::kNothing;
  Params read = params;
  Loaded loaded = Loaded::kAll;
  for (std::size_t k = 0; k < state.slot.count; ++k) {
    const Entry& entry = state.slot.entries[k];
    const ParamInfo* const row = find(entry.name_crc);
    if (row == nullptr || entry.value < row->min || entry.value > row->max) {
      loaded = Loaded::kSome;
      continue;
    }
    read.*row->member = entry.value;
  }
  if (!validate(read).ok()) return Loaded::kNothing;
  params = read;
  return loaded;
}

bool save(State& state, std::span<std::uint8_t> memory, const Params& params) {
  if (memory.size() < kBytes) return false;
  Slot& slot = state.slot;
  slot = {};
  slot.bytes = sizeof(Slot);
  slot.sequence = ++state.sequence;
  for (const ParamInfo& row : kParams) {
    if (params.*row.member == row.default_value) continue;  // a later firmware may have a better default
    slot.entries[slot.count++] = {crc_of(row.name), params.*row.member};
  }
  slot.crc = crc_of(slot);
  std::uint8_t* const to = memory.data() + state.next * sizeof(Slot);
  std::memcpy(to, &slot, sizeof slot);  // without its magic: not sound until all of it is there
  std::atomic_thread_fence(std::memory_order_release);
  slot.magic = kMagic;
  std::memcpy(to, &slot.magic, sizeof slot.magic);
  state.next = 1 - state.next;
  return true;
}

}  // namespace holdfast::settings
