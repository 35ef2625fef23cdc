// SPDX-License-Identifier: Apache-2.0
#include "store/settings.hpp"

#include <string_view>

#include "base/crc32.hpp"
#include "base/little_endian.hpp"

namespace holdfast::settings {
namespace {

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

Loaded read(std::span<const std::uint8_t> payload, Params& params) {
  if (payload.size() > kMostPayload || payload.size() % kEntryBytes != 0) return Loaded::kNothing;
  Params read = params;
  Loaded loaded = Loaded::kAll;
  for (std::size_t at = 0; at < payload.size(); at += kEntryBytes) {
    const ParamInfo* const row = find(get_le<std::uint32_t>(payload, at));
    const auto value = static_cast<std::int32_t>(get_le<std::uint32_t>(payload, at + 4));
    if (row == nullptr || value < row->min || value > row->max) {
      loaded = Loaded::kSome;
      continue;
    }
    read.*row->member = value;
  }
  if (!validate(read).ok()) return Loaded::kNothing;
  params = read;
  return loaded;
}

bool good(std::span<const std::uint8_t> payload) {
  Params params;
  return read(payload, params) != Loaded::kNothing;
}

bool fits(std::span<const std::uint8_t> payload) {
  Params params;
  return read(payload, params) == Loaded::kAll;
}

Found take(const SlotStore& slots, Params& params) {
  if (!slots.has_place()) return Found::kNoPlace;
  if (slots.damaged()) {
    if (!slots.counts()) return Found::kLost;
    (void)read(slots.payload(), params);
    return Found::kEither;
  }
  if (slots.sequence() == 0) return Found::kFirst;
  return read(slots.payload(), params) == Loaded::kSome ? Found::kPartly : Found::kWhole;
}

std::size_t write(const Params& params, std::span<std::uint8_t> out) {
  std::size_t size = 0;
  for (const ParamInfo& row : kParams) {
    if (params.*row.member == row.default_value) continue;
    put_le32(out.subspan(size), crc_of(row.name));
    put_le32(out.subspan(size + 4), static_cast<std::uint32_t>(params.*row.member));
    size += kEntryBytes;
  }
  return size;
}

}  // namespace holdfast::settings
