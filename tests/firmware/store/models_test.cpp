// SPDX-License-Identifier: Apache-2.0
// Models as a device stores them: which one a start decides by, and every change of a signed one.
#include "store/models.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/crc32.hpp"
#include "base/little_endian.hpp"
#include "drivers/sim/store.hpp"
#include "store/slot_store.hpp"
#include "tests/fuzz/model_check.hpp"
#include "tests/support/owner.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using Bytes = std::vector<std::uint8_t>;
using model_file::Refusal;

namespace {

constexpr const FeatureSet& kSet = *find_feature_set("paper");

Bytes model_named(std::string_view name, std::uint32_t seed = 1) {
  return test::model_bytes(kSet, test::RandomNodes(seed, kSet, 4, 63).nodes(), name);
}

Bytes record_of(std::uint32_t sequence, const Bytes& payload) {
  Bytes record(payload.size() + sealed::kAround);
  LONGS_EQUAL(record.size(), sealed::write(sealed::Kind::kModel, sequence, payload, record));
  return record;
}

void put_crc(std::span<std::uint8_t> record) {
  put_le32(record.last(4), crc32(record.first(record.size() - 4)));
}

int depth_below(const model::Tree& tree, std::size_t at) {
  const model::Node& node = tree.nodes[at];
  if (node.kind != model::Kind::kSplit) return 0;
  return 1 + std::max(depth_below(tree, at + 1), depth_below(tree, node.child_false));
}

}  // namespace

TEST_GROUP(Models) {
  test::Owner owner{1};
  drivers::Ed25519 verifier{owner.key};
  sim::Store store{models::kMostBytes};
  model::Tree tree;

  Bytes signed_record(std::uint32_t sequence, const Bytes& payload) {
    Bytes record = record_of(sequence, payload);
    owner.sign(record);
    return record;
  }
  void put(const Bytes& record, SlotStore::Put expected = SlotStore::Put::kBegun) {
    SlotStore slots(sealed::Kind::kModel, models::good, &store, &verifier);
    CHECK(slots.put(record, models::good) == expected);
    (void)slots.settle();
  }
  // By name; empty: the tree that is compiled in.
  std::string decides(const hal::Verifier* who) {
    const SlotStore slots(sealed::Kind::kModel, models::good, &store, who);
    const model::Tree* const found = models::in_force(slots, tree);
    CHECK(found == nullptr || found == &tree);
    return found == nullptr ? std::string{} : std::string(model::name_of(*found));
  }
};

TEST(Models, AreWhatWasStored) {
  STRCMP_EQUAL("", decides(&verifier).c_str());
  put(signed_record(5, model_named("first")));
  STRCMP_EQUAL("first", decides(&verifier).c_str());
  model::Tree read;
  CHECK(model_file::read(model_named("first"), read) == Refusal::kNone);
  CHECK(tree.nodes == read.nodes);
  put(signed_record(6, model_named("second", 2)));
  STRCMP_EQUAL("second", decides(&verifier).c_str());
  put(signed_record(6, model_named("third", 3)), SlotStore::Put::kOld);
  put(record_of(7, model_named("third", 3)), SlotStore::Put::kRefused);
  STRCMP_EQUAL("second", decides(&verifier).c_str());
}

// Back to the tree that is compiled in, by a record like any other, and on to another model.
TEST(Models, MayBeNone) {
  put(signed_record(5, model_named("first")));
  put(record_of(6, {}), SlotStore::Put::kRefused);
  put(signed_record(5, {}), SlotStore::Put::kOld);
  STRCMP_EQUAL("first", decides(&verifier).c_str());
  put(signed_record(6, {}));
  STRCMP_EQUAL("", decides(&verifier).c_str());
  put(signed_record(7, model_named("second")));
  STRCMP_EQUAL("second", decides(&verifier).c_str());
}

// A slot damaged anywhere, or erased: nobody knows whether it was the newer one. A device with an owner goes by none of
// the two, development mode by the other one. Both damaged: the tree that is compiled in.
TEST(Models, FallBack) {
  put(signed_record(5, model_named("first")));
  put(signed_record(6, model_named("second", 2)));
  const Bytes older(store.slot(0).begin(), store.slot(0).end()), newer(store.slot(1).begin(), store.slot(1).end());
  const Bytes nothing(models::kMostBytes);
  const auto lay = [&](std::size_t slot, const Bytes& bytes) {
    std::copy(bytes.begin(), bytes.end(), store.slot(slot).begin());
  };
  const auto check = [&](const char* developed) {
    STRCMP_EQUAL("", decides(&verifier).c_str());
    CHECK(SlotStore(sealed::Kind::kModel, models::good, &store, &verifier).damaged());
    STRCMP_EQUAL(developed, decides(nullptr).c_str());
    CHECK(SlotStore(sealed::Kind::kModel, models::good, &store, nullptr).damaged());
  };
  for (std::size_t at = 0; at < newer.size(); at += 31) {
    Bytes damaged = newer;
    damaged[at] ^= 4;
    lay(1, damaged);
    check("first");
    // Torn there, over zeros: at 0 the slot is erased.
    Bytes torn = nothing;
    std::copy_n(newer.begin(), at, torn.begin());
    lay(1, torn);
    check("first");
  }
  for (std::size_t at = 0; at < older.size(); at += 31) {
    Bytes damaged = older;
    damaged[at] ^= 8;
    lay(0, damaged);
    check("");
  }
  lay(0, nothing);
  lay(1, newer);
  check("second");
  lay(0, older);
  STRCMP_EQUAL("second", decides(&verifier).c_str());
}

// A firmware that another one follows finds models that it cannot use: signed and whole, they count as damaged.
TEST(Models, OfAnotherFirmwareCountAsDamaged) {
  put(signed_record(5, model_named("first")));
  Bytes other = model_named("second", 2);
  std::fill_n(other.begin() + 52, 32, std::uint8_t{0});
  test::put_name(other, 52, "later");
  other = test::repaired(other);
  CHECK(models::refusal_of(other) == Refusal::kSetUnknown);
  put(signed_record(6, other), SlotStore::Put::kNotGood);
  const Bytes record = signed_record(6, other);
  std::copy(record.begin(), record.end(), store.slot(1).begin());
  STRCMP_EQUAL("", decides(&verifier).c_str());
  STRCMP_EQUAL("first", decides(nullptr).c_str());
  CHECK(SlotStore(sealed::Kind::kModel, models::good, &store, &verifier).damaged());
}

// Whole and the owner's, its number counts also where this firmware cannot use it: an older record would be a way back.
TEST(Models, AreNotOlderThanOneThatCannotBeUsed) {
  Bytes other = model_named("later", 2);
  std::fill_n(other.begin() + 52, 32, std::uint8_t{0});
  test::put_name(other, 52, "later");
  other = test::repaired(other);
  for (const bool beside_a_good_one : {false, true}) {
    store = sim::Store{models::kMostBytes};
    if (beside_a_good_one) put(signed_record(150, model_named("first")));
    const Bytes record = signed_record(200, other);
    std::copy(record.begin(), record.end(), store.slot(beside_a_good_one ? 1 : 0).begin());
    put(signed_record(199, model_named("second")), SlotStore::Put::kOld);
    put(signed_record(200, model_named("second")), SlotStore::Put::kOld);
    LONGS_EQUAL(201, SlotStore(sealed::Kind::kModel, models::good, &store, nullptr).next_sequence());
    put(signed_record(201, model_named("second")));
    STRCMP_EQUAL("second", decides(&verifier).c_str());
  }
}

TEST(Models, AreRefusedForWhatIsWrongWithThem) {
  const auto with = [](std::size_t at, std::uint8_t value) {
    Bytes bytes = model_named("test");
    bytes[at] = value;
    return test::repaired(bytes);
  };
  const Bytes whole = model_named("test");
  CHECK(models::refusal_of(whole) == Refusal::kNone);
  CHECK(models::refusal_of({}) == Refusal::kNone);
  const std::vector<std::pair<Refusal, Bytes>> cases{
      {Refusal::kMagic, with(0, 0)},
      {Refusal::kVersion, with(8, 4)},
      {Refusal::kSize, Bytes(whole.begin(), whole.end() - 1)},
      {Refusal::kSigned, with(5228, 1)},
      {Refusal::kForm, with(13, 1)},
      {Refusal::kFeatures, with(84, 'x')},
      {Refusal::kNode, with(1146, 30)},
  };
  for (const auto& [refusal, bytes] : cases) {
    CHECK(models::refusal_of(bytes) == refusal);
    CHECK_FALSE(models::good(bytes));
  }
}

// Every byte of a signed record, in one bit each, and in every bit where it is no payload: refused by the check sum,
// and by the signature, or an earlier look, when the check sum was made to fit. In development mode, where nobody looks
// at a signature, what is no longer the model that was sealed is refused by the model's own check sum (every eighth
// byte is tried).
TEST(Models, AnyOtherByteIsRefused) {
  const Bytes record = signed_record(77, model_named("test"));
  sealed::Record read;
  int refused = 0, repaired = 0, by_signature = 0, by_model = 0;
  const auto why = [&](const Bytes& bytes, const hal::Verifier* who) {
    return sealed::read(bytes, sealed::Kind::kModel, who, read);
  };
  CHECK(why(record, &verifier) == sealed::Refusal::kNone);
  for (std::size_t at = 0; at < record.size(); ++at) {
    const bool payload = at >= sealed::kPayloadAt && at < sealed::kPayloadAt + model_file::kBytes;
    for (unsigned bit = 0; bit < 8; ++bit) {
      if (payload && bit != at % 8) continue;
      Bytes changed = record;
      changed[at] ^= static_cast<std::uint8_t>(1U << bit);
      CHECK(why(changed, &verifier) != sealed::Refusal::kNone);
      ++refused;
      if (at >= record.size() - 4) continue;
      put_crc(changed);
      const sealed::Refusal refusal = why(changed, &verifier);
      CHECK(refusal != sealed::Refusal::kNone);
      ++repaired;
      by_signature += refusal == sealed::Refusal::kSignature ? 1 : 0;
      if (!payload || at % 8 != 0) continue;
      CHECK(why(changed, nullptr) == sealed::Refusal::kNone);
      by_model += models::good(read.payload) ? 0 : 1;
    }
  }
  LONGS_EQUAL(5296 + 84 * 8, refused);
  LONGS_EQUAL(5296 + (4 + 64) * 8, by_signature);  // payload, sequence and signature
  LONGS_EQUAL(5296 / 8, by_model);
  std::printf(" %d changed records refused;", refused + repaired);
}

TEST(Models, HaveTheDepthOfTheirLongestPath) {
  for (std::uint32_t seed = 1; seed <= 30; ++seed) {
    const int depth = 1 + static_cast<int>(seed % 20);
    const auto bytes = test::model_bytes(kSet, test::RandomNodes(seed, kSet, depth, 511).nodes());
    CHECK(model_file::read(bytes, tree) == Refusal::kNone);
    LONGS_EQUAL(depth_below(tree, 0), model::depth_of(tree));
  }
  LONGS_EQUAL(0, model::depth_of(model::Tree{}));
}

TEST(Models, EveryRefusalOfARecordHasWords) {
  for (const sealed::RefusalInfo& row : sealed::kRefusals) {
    CHECK(!row.what.empty() && !row.cause.empty() && !row.next.empty());
    CHECK(&sealed::info(row.refusal) == &row);
  }
}
