// SPDX-License-Identifier: Apache-2.0
// Records, their two slots, and the owner's signature (Ed25519 by libsodium; its oracle is RFC 8032).
#include "store/sealed.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include <sodium.h>

#include "base/crc32.hpp"
#include "base/little_endian.hpp"
#include "drivers/common/ed25519.hpp"
#include "drivers/sim/store.hpp"
#include "store/slot_store.hpp"
#include "tests/support/owner.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using sealed::Kind;
using sealed::Refusal;
using test::Owner;
using Bytes = std::vector<std::uint8_t>;

namespace {

Bytes of_hex(std::string_view text) {
  Bytes bytes(text.size() / 2);
  std::size_t size = 0;
  if (bytes.empty()) return bytes;  // sodium takes no null
  CHECK(sodium_hex2bin(bytes.data(), bytes.size(), text.data(), text.size(), nullptr, &size, nullptr) == 0);
  LONGS_EQUAL(text.size() / 2, size);
  return bytes;
}

Bytes record_of(Kind kind, std::uint32_t sequence, const Bytes& payload) {
  Bytes record(payload.size() + sealed::kAround);
  LONGS_EQUAL(record.size(), sealed::write(kind, sequence, payload, record));
  return record;
}

bool anything(std::span<const std::uint8_t> /*payload*/) {
  return true;
}

}  // namespace

TEST_GROUP(Sealed) {
  Owner owner{1}, other{2};
  drivers::Ed25519 verifier{owner.key};
  sealed::Record read;

  Bytes signed_record(std::uint32_t sequence, const Bytes& payload = {1, 2, 3}) {
    Bytes record = record_of(Kind::kSettings, sequence, payload);
    owner.sign(record);
    return record;
  }
  static void put_crc(Bytes & record) {
    put_le32(std::span(record).last(4), crc32(std::span(record).first(record.size() - 4)));
  }
};

// A record says of what kind it is; a number that is given is never given to another.
TEST(Sealed, KindsKeepTheirNumbers) {
  LONGS_EQUAL(1, record_of(Kind::kSettings, 1, {})[5]);
  LONGS_EQUAL(2, record_of(Kind::kModel, 1, {})[5]);
}

// RFC 8032, 7.1: tests 1, 2, 3, and the one of SHA(abc).
TEST(Sealed, VerifiesAsTheRfcSays) {
  struct Vector {
    const char* key;
    const char* message;
    const char* signature;
  };
  for (const Vector& v :
       std::initializer_list<Vector>{{"d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a", "",
                                      "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bac"
                                      "c61e39701cf9b46bd25bf5f0595b"
                                      "be24655141438e7a100b"},
                                     {"3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c", "72",
                                      "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e"
                                      "458f3613d0f11d8c387b2eaeb430"
                                      "2aeeb00d291612bb0c00"},
                                     {"fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025", "af82",
                                      "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac18ff9b538d16f290"
                                      "ae67f760984dc6594a7c15e9716e"
                                      "d28dc027beceea1ec40a"},
                                     {"ec172b93ad5e563bf4932c70e1245034c35467ef2efd4d64ebf819683467e2bf",
                                      "ddaf35a193617abacc417349ae20413112e6fa4e89a97ea20a9eeee64b55d39a2192992a274fc1a8"
                                      "36ba3c23a3feebbd454d4423643ce8"
                                      "0e2a9ac94fa54ca49f",
                                      "dc2a4459e7369633a52b1bf277839a00201009a3efbf3ecb69bea2186c26b58909351fc9ac90b3ec"
                                      "fdfbc7c66431e0303dca179c138a"
                                      "c17ad9bef1177331a704"}}) {
    drivers::Ed25519::Key key{};
    const Bytes key_bytes = of_hex(v.key);
    std::copy(key_bytes.begin(), key_bytes.end(), key.begin());
    Bytes message = of_hex(v.message);
    Bytes signature = of_hex(v.signature);
    const drivers::Ed25519 one(key);
    const auto holds = [&] { return one.holds(message, std::span<const std::uint8_t, 64>(signature)); };
    CHECK(holds());
    signature[40] ^= 1;
    CHECK_FALSE(holds());
    signature[40] ^= 1;
    message.push_back(0);
    CHECK_FALSE(holds());
  }
}

TEST(Sealed, IsReadAsItWasWritten) {
  const Bytes record = signed_record(0x01020304, {9, 8, 7});
  Bytes slot = record;
  slot.resize(record.size() + 100, 0xEE);  // of what stood there before
  for (const hal::Verifier* const who :
       {static_cast<const hal::Verifier*>(&verifier), static_cast<const hal::Verifier*>(nullptr)}) {
    CHECK(sealed::read(slot, Kind::kSettings, who, read) == Refusal::kNone);
    LONGS_EQUAL(0x01020304, read.sequence);
    LONGS_EQUAL(record.size(), read.bytes);
    CHECK(read.is_signed);
    CHECK(Bytes(read.payload.begin(), read.payload.end()) == Bytes({9, 8, 7}));
  }
  const Bytes table{'H', 'D', 'S', 'R', 1, 1, 0, 0, 4, 3, 2, 1, 3, 0, 0, 0, 9, 8, 7};
  CHECK(std::equal(table.begin(), table.end(), record.begin()));
}

TEST(Sealed, IsRefusedForWhatItIs) {
  const Bytes unsigned_one = record_of(Kind::kSettings, 5, {1, 2, 3});
  CHECK(sealed::read(unsigned_one, Kind::kSettings, nullptr, read) == Refusal::kNone);
  CHECK_FALSE(read.is_signed);
  CHECK(sealed::read(unsigned_one, Kind::kSettings, &verifier, read) == Refusal::kUnsigned);
  const hal::NoOwner nobody;
  CHECK(sealed::read(signed_record(5), Kind::kSettings, &nobody, read) == Refusal::kSignature);
  Bytes forged = record_of(Kind::kSettings, 5, {1, 2, 3});
  other.sign(forged);
  CHECK(sealed::read(forged, Kind::kSettings, &verifier, read) == Refusal::kSignature);
  CHECK(sealed::read(signed_record(5), Kind::kModel, &verifier, read) == Refusal::kOtherKind);
  CHECK(sealed::read({}, Kind::kSettings, nullptr, read) == Refusal::kNoRecord);
  Bytes later = signed_record(5);
  later[4] = 2;
  CHECK(sealed::read(later, Kind::kSettings, &verifier, read) == Refusal::kVersion);
  Bytes none = record_of(Kind::kSettings, 0, {1});
  CHECK(sealed::read(none, Kind::kSettings, nullptr, read) == Refusal::kNoRecord);
  for (const std::uint32_t size : {4U, 0x7FFFFFFFU, 0xFFFFFFFFU}) {
    Bytes longer = unsigned_one;
    put_le32(std::span(longer).subspan(sealed::kSizeAt), size);
    CHECK(sealed::read(longer, Kind::kSettings, nullptr, read) == Refusal::kNoRecord);
  }
  Bytes small(sealed::kAround + 2);
  LONGS_EQUAL(0, sealed::write(Kind::kSettings, 1, Bytes{1, 2, 3}, small));
  LONGS_EQUAL(0, sealed::write(Kind::kSettings, 1, {}, std::span(small).first(10)));
}

TEST(Sealed, AKeyIsReadFromItsFile) {
  const test::TempDir dir;
  drivers::Ed25519::Key key{};
  const auto wrong = [&](const std::string& text) {
    const auto path = dir.path() / "owner.pub";
    std::ofstream(path) << text;
    return drivers::read_public_key(path, key);
  };
  const std::string good = "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c";
  STRCMP_EQUAL("", wrong(good + "\n").c_str());
  CHECK(Bytes(key.begin(), key.end()) == of_hex(good));
  STRCMP_EQUAL("", wrong(good + " \r\n").c_str());
  STRCMP_CONTAINS("cannot read the owner's key from ", drivers::read_public_key(dir.path() / "none", key).c_str());
  STRCMP_CONTAINS("cannot read", wrong("").c_str());
  for (const std::string& text : {good.substr(1), good + "0", "x" + good.substr(1), std::string(64, ' ')}) {
    STRCMP_CONTAINS("is not 64 hex digits in one line", wrong(text + "\n").c_str());
  }
  STRCMP_CONTAINS("is not an Ed25519 public key", wrong(std::string(64, '0') + "\n").c_str());
}

TEST_GROUP(SlotStore) {
  Owner owner{1};
  drivers::Ed25519 verifier{owner.key};
  sim::Store store{200};

  Bytes record(std::uint32_t sequence, bool is_signed) {
    Bytes bytes = record_of(Kind::kSettings, sequence, {static_cast<std::uint8_t>(sequence)});
    if (is_signed) owner.sign(bytes);
    return bytes;
  }
  [[nodiscard]] SlotStore of(const hal::Verifier* who) {
    return {Kind::kSettings, anything, &store, who};
  }
  static SlotStore::Put put(SlotStore & slots, const Bytes& bytes) {
    const SlotStore::Put result = slots.put(bytes, anything);
    (void)slots.settle();
    return result;
  }
};

TEST(SlotStore, TakesOnlyWhatIsSignedAndNewer) {
  SlotStore slots = of(&verifier);
  CHECK_FALSE(slots.development());
  LONGS_EQUAL(0, slots.next_sequence());
  CHECK(put(slots, record(10, false)) == SlotStore::Put::kRefused);
  CHECK(slots.refusal() == Refusal::kUnsigned);
  CHECK(put(slots, record(10, true)) == SlotStore::Put::kBegun);
  LONGS_EQUAL(10, slots.sequence());
  for (const std::uint32_t old : {1U, 9U, 10U}) CHECK(put(slots, record(old, true)) == SlotStore::Put::kOld);
  CHECK(put(slots, record(11, true)) == SlotStore::Put::kBegun);
  CHECK(put(slots, record(10, true)) == SlotStore::Put::kOld);
  SlotStore next = of(&verifier);
  LONGS_EQUAL(11, next.sequence());
  CHECK(put(next, record(10, true)) == SlotStore::Put::kOld);
  LONGS_EQUAL(2, store.writes());
  Bytes longer = record(12, true);
  longer.push_back(0);
  CHECK(put(next, longer) == SlotStore::Put::kRefused);
  CHECK(next.refusal() == Refusal::kNoRecord);
  CHECK(next.put(record(12, true), [](auto) { return false; }) == SlotStore::Put::kNotGood);
  CHECK(put(next, Bytes(201)) == SlotStore::Put::kRefused);  // told for what it is before its length is
  Bytes too_long = record_of(Kind::kSettings, 12, Bytes(200 - sealed::kAround + 1));
  owner.sign(too_long);
  CHECK(put(next, too_long) == SlotStore::Put::kNoPlace);
  LONGS_EQUAL(2, store.writes());
}

// Of a time in development mode: what was not signed then is nothing afterwards, however new, and is written over.
TEST(SlotStore, ForgetsWhatWasNotSigned) {
  SlotStore slots = of(nullptr);
  CHECK(slots.development());
  CHECK(put(slots, record(100, false)) == SlotStore::Put::kBegun);
  CHECK(put(slots, record(101, true)) == SlotStore::Put::kBegun);
  CHECK(put(slots, record(102, false)) == SlotStore::Put::kBegun);
  SlotStore owned = of(&verifier);
  LONGS_EQUAL(101, owned.sequence());
  CHECK(put(owned, record(103, true)) == SlotStore::Put::kBegun);
  LONGS_EQUAL(103, of(nullptr).sequence());
  LONGS_EQUAL(101, owned.payload()[0]);
}

TEST(SlotStore, NeverWritesTheSlotInForce) {
  SlotStore slots = of(nullptr);
  for (std::uint32_t k = 1; k <= 6; ++k) {
    const std::size_t in_force = k % 2;  // from the second on: the first goes into both, and is read from slot 0
    const Bytes before(store.slot(in_force).begin(), store.slot(in_force).end());
    store.set_failure(5, 30);
    CHECK(put(slots, record(k, false)) == SlotStore::Put::kBegun);
    CHECK(slots.settle() == hal::Store::State::kFailed);
    LONGS_EQUAL(k - 1, slots.sequence());
    LONGS_EQUAL(5, slots.error());
    store.set_failure(0);
    CHECK(put(slots, record(k, false)) == SlotStore::Put::kBegun);
    CHECK_EQUAL(k > 1, std::equal(before.begin(), before.end(), store.slot(in_force).begin()));
    LONGS_EQUAL(k, slots.sequence());
  }
}

TEST(SlotStore, WaitsForWhatIsUnderWay) {
  SlotStore slots = of(nullptr);
  store.set_slow(true);
  CHECK(put(slots, record(1, false)) == SlotStore::Put::kBegun);
  CHECK(slots.settle() == hal::Store::State::kBusy);
  CHECK(put(slots, record(2, false)) == SlotStore::Put::kStillBusy);
  LONGS_EQUAL(0, slots.sequence());
  store.finish();
  CHECK(put(slots, record(2, false)) == SlotStore::Put::kBegun);
  LONGS_EQUAL(1, slots.sequence());
  store.finish();
  CHECK(slots.settle() == hal::Store::State::kDone);
  LONGS_EQUAL(2, slots.sequence());
}

TEST(SlotStore, NeedsAPlaceAndNumbersAnewBehindTheLast) {
  SlotStore none(Kind::kSettings, anything, nullptr, nullptr);
  CHECK(put(none, record(1, false)) == SlotStore::Put::kNoPlace);
  CHECK(none.settle() == hal::Store::State::kIdle);
  LONGS_EQUAL(0, none.error());
  SlotStore slots = of(nullptr);
  CHECK(put(slots, record(std::numeric_limits<std::uint32_t>::max(), false)) == SlotStore::Put::kBegun);
  LONGS_EQUAL(1, slots.next_sequence());
}
