// SPDX-License-Identifier: Apache-2.0
#include "app/settings.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

#include "base/crc32.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using settings::Loaded;

TEST_GROUP(Settings) {
  std::vector<std::uint8_t> memory = std::vector<std::uint8_t>(settings::kBytes);
  settings::State state;

  Params load(Loaded expected) {
    Params params;
    settings::State reader;
    CHECK(settings::load(reader, memory, params) == expected);
    return params;
  }
  void save(const Params& params) {
    CHECK(settings::save(state, memory, params));
  }
};

TEST(Settings, AreWhatWasStored) {
  CHECK(load(Loaded::kNothing) == Params{});
  Params params;
  for (const ParamInfo& row : kParams) params.*row.member = row.min;
  params.degraded_markers_pct = 50;
  CHECK(validate(params).ok());
  save(params);
  CHECK(load(Loaded::kAll) == params);
  save(Params{});
  CHECK(load(Loaded::kAll) == Params{});
}

TEST(Settings, GoOnBehindTheNewerSlot) {
  Params params;
  for (int k = 1; k <= 5; ++k) {
    params.raise_frames = k;
    settings::State other;
    Params ignored;
    (void)settings::load(other, memory, ignored);
    CHECK(settings::save(other, memory, params));
    LONGS_EQUAL(k, load(Loaded::kAll).raise_frames);
  }
}

// Torn at any byte, or any byte another: the older settings, never a mixture.
TEST(Settings, SurviveATornWrite) {
  Params older, newer;
  older.raise_frames = 3;
  newer.raise_frames = 7;
  newer.hold_ms = 999;
  save(older);
  const std::vector<std::uint8_t> before = memory;
  save(newer);
  const std::vector<std::uint8_t> after = memory;
  std::vector<std::size_t> every_place(memory.size());
  std::iota(every_place.begin(), every_place.end(), std::size_t{0});
  for (std::size_t cut = 0; cut <= memory.size(); ++cut) {
    std::copy_n(after.begin(), cut, memory.begin());
    std::copy(before.begin() + static_cast<std::ptrdiff_t>(cut), before.end(),
              memory.begin() + static_cast<std::ptrdiff_t>(cut));
    const Params read = load(Loaded::kAll);
    CHECK(read == older || read == newer);
  }
  for (const std::size_t k : every_place) {
    memory = after;
    memory[k] ^= 0x10;
    const Params read = load(Loaded::kAll);
    CHECK(read == older || read == newer);
  }
}

// Of a firmware with other parameters or ranges: what is known and allowed is taken.
TEST(Settings, TakeWhatTheyKnow) {
  Params params;
  params.raise_frames = 3;
  params.hold_ms = 300;
  const auto stored_as = [&](std::uint32_t name_crc, std::int32_t value) {
    std::fill(memory.begin(), memory.end(), std::uint8_t{0});
    state = {};
    save(params);
    settings::Slot slot;
    std::memcpy(&slot, memory.data(), sizeof slot);
    settings::Entry& entry = slot.entries[0];
    if (name_crc != 0) entry.name_crc = name_crc;
    entry.value = value;
    const auto* const from = reinterpret_cast<const std::uint8_t*>(&slot.sequence);
    slot.crc = crc32({from, sizeof slot - offsetof(settings::Slot, sequence)});
    std::memcpy(memory.data(), &slot, sizeof slot);
  };
  stored_as(0xDEADBEEF, 3);
  Params read = load(Loaded::kSome);
  LONGS_EQUAL(Params{}.raise_frames, read.raise_frames);
  LONGS_EQUAL(300, read.hold_ms);
  stored_as(0, 11);
  read = load(Loaded::kSome);
  LONGS_EQUAL(Params{}.raise_frames, read.raise_frames);
  stored_as(0, 0);
  LONGS_EQUAL(300, load(Loaded::kSome).hold_ms);
  // Each in its range, and together a contradiction.
  params = {};
  params.fault_markers_pct = 60;
  stored_as(0, 99);
  CHECK(load(Loaded::kNothing) == Params{});
}

TEST(Settings, NeedMemory) {
  memory.resize(settings::kBytes - 1);
  CHECK(load(Loaded::kNothing) == Params{});
  CHECK_FALSE(settings::save(state, memory, {}));
}
