// SPDX-License-Identifier: Apache-2.0
#include "store/settings.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/crc32.hpp"
#include "base/little_endian.hpp"
#include "drivers/sim/store.hpp"
#include "store/slot_store.hpp"
#include "tests/support/owner.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using settings::Loaded;

TEST_GROUP(Settings) {
  sim::Store store{settings::kMostBytes};

  [[nodiscard]] SlotStore slots() {
    return {sealed::Kind::kSettings, settings::good, &store, nullptr};
  }
  Params load(Loaded expected) {
    Params params;
    const SlotStore reader = slots();
    if (expected == Loaded::kNothing) {
      CHECK(reader.payload().empty());
      LONGS_EQUAL(0, reader.sequence());
    } else {
      CHECK(settings::read(reader.payload(), params) == expected);
    }
    return params;
  }
  void save(const Params& params) {
    SlotStore writer = slots();
    std::vector<std::uint8_t> payload(settings::kMostPayload);
    payload.resize(settings::write(params, payload));
    save(writer.next_sequence(), payload);
  }
  void save(std::uint32_t sequence, const std::vector<std::uint8_t>& payload) {
    SlotStore writer = slots();
    std::vector<std::uint8_t> record(payload.size() + sealed::kAround);
    LONGS_EQUAL(record.size(), sealed::write(sealed::Kind::kSettings, sequence, payload, record));
    CHECK(writer.put(record, [](auto) { return true; }) == SlotStore::Put::kBegun);
    CHECK(writer.settle() == hal::Store::State::kDone);
    LONGS_EQUAL(sequence, writer.sequence());
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
  LONGS_EQUAL(2, slots().sequence());
}

// Of a firmware with other parameters or ranges: what is known and allowed is taken when it starts, and refused from
// outside.
TEST(Settings, TakeWhatTheyKnow) {
  Params params;
  params.raise_frames = 3;
  params.hold_ms = 300;
  std::vector<std::uint8_t> payload(settings::kMostPayload);
  payload.resize(settings::write(params, payload));
  LONGS_EQUAL(16, payload.size());
  const std::vector<std::uint8_t> good = payload;
  CHECK(settings::fits(good));

  put_le32(payload, 0xDEADBEEF);
  CHECK_FALSE(settings::fits(payload));
  save(1, payload);
  Params read = load(Loaded::kSome);
  LONGS_EQUAL(Params{}.raise_frames, read.raise_frames);
  LONGS_EQUAL(300, read.hold_ms);

  for (const std::uint32_t out_of_range : {11U, 0U, 0xFFFFFFFFU}) {
    payload = good;
    put_le32(std::span(payload).subspan(4), out_of_range);
    CHECK_FALSE(settings::fits(payload));
    read = {};
    CHECK(settings::read(payload, read) == Loaded::kSome);
    LONGS_EQUAL(Params{}.raise_frames, read.raise_frames);
    LONGS_EQUAL(300, read.hold_ms);
  }
  payload.pop_back();
  CHECK(settings::read(payload, read) == Loaded::kNothing);
  payload.assign(65 * 8, 0);  // an entry too many
  CHECK(settings::read(payload, read) == Loaded::kNothing);
  CHECK(settings::read({}, read) == Loaded::kAll);
}

// Each in its range, and together a contradiction: the record before it stays in force.
TEST(Settings, AreGoodTogetherOrNotAtAll) {
  Params params;
  params.hold_ms = 300;
  save(params);
  params.fault_markers_pct = 99;
  std::vector<std::uint8_t> payload(settings::kMostPayload);
  payload.resize(settings::write(params, payload));
  CHECK_FALSE(settings::good(payload));
  save(2, payload);
  LONGS_EQUAL(300, load(Loaded::kAll).hold_ms);
  LONGS_EQUAL(1, slots().sequence());
}

// No smaller number passes for a newer one where an owner signs: it would open the way back to all that was signed.
TEST(Settings, OfAnOwnerEndWithTheLastNumber) {
  constexpr std::uint32_t kLast = 0xFFFFFFFF;
  const test::Owner owner{1};
  const drivers::Ed25519 verifier{owner.key};
  for (const std::uint32_t sequence : {kLast, 1U}) {
    SlotStore writer(sealed::Kind::kSettings, settings::good, &store, &verifier);
    LONGS_EQUAL(0, writer.next_sequence());
    std::vector<std::uint8_t> record(sealed::kAround);
    (void)sealed::write(sealed::Kind::kSettings, sequence, {}, record);
    owner.sign(record);
    CHECK(writer.put(record, settings::fits) == (sequence == kLast ? SlotStore::Put::kBegun : SlotStore::Put::kOld));
  }
}

TEST(Settings, HaveWordsForWhatAStartFinds) {
  for (const settings::FoundInfo& row : settings::kFound) {
    CHECK(!row.name.empty() && !row.from.empty());
    CHECK(&settings::info(row.found) == &row);
  }
  for (int k = 0; k <= static_cast<int>(SlotStore::State::kNotGood); ++k) {
    SlotStore::Slot slot;
    slot.state = static_cast<SlotStore::State>(k);
    slot.refusal = sealed::Refusal::kDamaged;
    CHECK(!words(slot).empty());
  }
}
