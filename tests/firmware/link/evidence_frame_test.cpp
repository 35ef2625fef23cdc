// SPDX-License-Identifier: Apache-2.0
#include "link/evidence_frame.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <string>

#include "tests/fuzz/link_check.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::evidence_frame;
using namespace holdfast::test;

namespace {

LinkBytes wire_of(const EvidenceFrame& frame) {
  std::array<std::uint8_t, kWireBytes> wire{};
  LONGS_EQUAL(kWireBytes, encode(frame, wire));
  return {wire.begin(), wire.end()};
}

// Small numbers leave zero bytes: every block structure of COBS occurs.
EvidenceFrame random_frame(std::mt19937& random) {
  const auto number = [&] { return static_cast<std::uint32_t>(random()) >> (random() % 4 * 8); };
  EvidenceFrame frame;
  frame.sequence = static_cast<std::uint16_t>(number());
  frame.finger = static_cast<std::uint8_t>(random() % 2);
  frame.contact = static_cast<std::uint8_t>(number());
  frame.evidence = static_cast<std::uint8_t>(number());
  frame.unit = static_cast<std::uint8_t>(number());
  frame.run = static_cast<std::uint8_t>(number());
  frame.patches = static_cast<std::uint16_t>(number());
  frame.value_milli = static_cast<std::int32_t>(number());
  frame.threshold_milli = static_cast<std::int32_t>(number());
  frame.motion_log2_um_q8 = static_cast<std::int16_t>(number());
  frame.coarse_log2_um_q8 = static_cast<std::int16_t>(number());
  frame.growth_log2_q8 = static_cast<std::int16_t>(number());
  return frame;
}

}  // namespace

TEST_GROUP(EvidenceFrame) {
  std::mt19937 random{1};
  evidence::Shown shown{Evidence::kImprint, 61'440, 34'000, "um"};
  contact::Contact contact{.judged = true, .touching = true};
  ImprintFeatures imprint;
};

// By hand: COBS and CRC of link_check.hpp share nothing with the firmware's.
TEST(EvidenceFrame, LayoutIsTheOneOfVersion1) {
  const EvidenceFrame frame{.sequence = 0x1234,
                            .finger = 1,
                            .contact = 2,
                            .evidence = 3,
                            .unit = 4,
                            .run = 5,
                            .patches = 0x0607,
                            .value_milli = -2,
                            .threshold_milli = 0x08090A0B,
                            .motion_log2_um_q8 = 0x0C0D,
                            .coarse_log2_um_q8 = -32768,
                            .growth_log2_q8 = 0};
  CHECK_TRUE(wire_of(frame) == frame_around({1,    6,    0x34, 0x12, 1,    2,    3,    4,    5, 7,    6, 0xFE, 0xFF,
                                             0xFF, 0xFF, 0x0B, 0x0A, 0x09, 0x08, 0x0D, 0x0C, 0, 0x80, 0, 0}));
}

TEST(EvidenceFrame, EveryFrameIsReadBack) {
  for (int i = 0; i < 50'000; ++i) {
    const EvidenceFrame frame = random_frame(random);
    link::Payload payload;
    CHECK_TRUE(link::open(wire_of(frame), payload) == link::DecodeError::kNone);
    CHECK_TRUE(read(payload) == frame);
    CHECK_TRUE(status_frame::read(payload).error == link::DecodeError::kKind);
  }
}

TEST(EvidenceFrame, SoundFramesOfAnotherKindVersionOrLengthAreNone) {
  const auto reads = [](std::uint8_t version, std::uint8_t kind, std::size_t size) {
    LinkBytes body(size);
    body[0] = version;
    body[1] = kind;
    link::Payload payload;
    CHECK_TRUE(link::open(frame_around(body), payload) == link::DecodeError::kNone);
    return read(payload).has_value();
  };
  CHECK_TRUE(reads(1, 6, 25));
  CHECK_FALSE(reads(2, 6, 25));
  CHECK_FALSE(reads(1, 6, 24));
  CHECK_FALSE(reads(1, 6, 26));
  for (std::uint8_t kind = 0; kind < 6; ++kind) CHECK_FALSE(reads(1, kind, 25));
}

// In a stream, where a flip may make a delimiter of a byte or a byte of a delimiter.
TEST(EvidenceFrame, NoSingleBitFlipOnTheWireMakesAFrame) {
  int taken = 0;
  for (int i = 0; i < 5000; ++i) {
    const LinkBytes wire = wire_of(random_frame(random));
    for (std::size_t bit = 0; bit < 8 * wire.size(); ++bit) {
      LinkBytes bad = wire + LinkBytes{0};
      bad[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
      link::Receiver receiver;
      for (const std::uint8_t byte : bad) {
        if (receiver.push(byte) == link::Event::kFrame && read(receiver.payload())) ++taken;
      }
    }
  }
  LONGS_EQUAL(0, taken);
}

TEST(EvidenceFrame, SaysWhatIsShown) {
  imprint.patches = Count::from_raw(300);
  imprint.motion = Log2Q8::from_raw(1521);
  imprint.coarse = Log2Q8::from_raw(Log2Q8::kMax);
  imprint.growth = Log2Q8::from_raw(Log2Q8::kMin);
  const EvidenceFrame want{.sequence = 9,
                           .contact = 2,
                           .evidence = 1,
                           .unit = 1,
                           .run = 2,
                           .patches = 300,
                           .value_milli = 61'440,
                           .threshold_milli = 34'000,
                           .motion_log2_um_q8 = 1521,
                           .coarse_log2_um_q8 = Log2Q8::kMax,
                           .growth_log2_q8 = Log2Q8::kMin};
  CHECK_TRUE(frame_of(9, shown, contact, imprint, 2) == want);
}

TEST(EvidenceFrame, SaysHowTheContactIs) {
  const auto name = [&] {
    const std::uint8_t number = frame_of(0, shown, contact, imprint, 0).contact;
    for (const Row& row : kContacts) {
      if (row.number == number) return std::string(row.name);
    }
    return std::string();
  };
  STRCMP_EQUAL("HELD", name().c_str());
  imprint.growth = Log2Q8::from_raw(256);
  STRCMP_EQUAL("TOUCHING", name().c_str());
  contact.touching = false;
  STRCMP_EQUAL("EMPTY", name().c_str());
  contact.judged = false;
  STRCMP_EQUAL("UNKNOWN", name().c_str());
}

TEST(EvidenceFrame, CutsWhatDoesNotFit) {
  using Limits = std::numeric_limits<std::int32_t>;
  shown.value_milli = std::int64_t{1000} << 32;
  shown.threshold_milli = -(std::int64_t{1000} << 32);
  const EvidenceFrame frame = frame_of(0, shown, contact, imprint, 1000);
  LONGS_EQUAL(Limits::max(), frame.value_milli);
  LONGS_EQUAL(Limits::min(), frame.threshold_milli);
  LONGS_EQUAL(255, frame.run);
}

TEST(EvidenceFrame, NumbersAreThoseOfTheFirmware) {
  for (std::size_t i = 0; i < kEvidences.size(); ++i) LONGS_EQUAL(i, kEvidences[i].number);
  for (std::size_t i = 0; i + 1 < kContacts.size(); ++i) LONGS_EQUAL(i, kContacts[i].number);
  for (std::size_t i = 0; i < kUnits.size(); ++i) LONGS_EQUAL(i, unit_of(kUnits[i]));
  LONGS_EQUAL(0, unit_of("furlong"));
  LONGS_EQUAL(8, unit_of(evidence::show({}, {}, Evidence::kNone, true).unit));
}
