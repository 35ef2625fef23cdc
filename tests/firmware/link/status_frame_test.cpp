// SPDX-License-Identifier: Apache-2.0
#include "link/status_frame.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <numeric>
#include <random>
#include <span>
#include <vector>

#include "base/cobs.hpp"
#include "base/crc16.hpp"
#include "base/crc32.hpp"
#include "tests/fuzz/link_check.hpp"

#include <CppUTest/TestHarness.h>

namespace sf = holdfast::status_frame;
namespace cobs = holdfast::cobs;
using holdfast::DeviceState;
using holdfast::Micros;
using holdfast::Reason;
using holdfast::test::slow_crc16;
using sf::DecodeError;
using sf::StatusFrame;

namespace {

using Bytes = std::vector<std::uint8_t>;
using Wire = std::array<std::uint8_t, sf::kWireBytes>;

Bytes cobs_encode(const Bytes& in) {
  Bytes out(cobs::max_encoded_bytes(in.size()));
  const auto size = cobs::encode(in, out);
  CHECK_TRUE(size.has_value());
  out.resize(*size);
  return out;
}

Bytes counting(int from, int to) {
  Bytes bytes(static_cast<std::size_t>(to - from + 1));
  std::iota(bytes.begin(), bytes.end(), static_cast<std::uint8_t>(from));
  return bytes;
}

Bytes joined(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

StatusFrame random_frame(std::mt19937& random) {
  StatusFrame frame;
  // Small numbers leave zero bytes: every block structure of COBS occurs.
  const auto number = [&] { return static_cast<std::uint32_t>(random()) >> (random() % 4 * 8); };
  frame.sequence = static_cast<std::uint16_t>(number());
  frame.timestamp_us = number();
  frame.age_100us = static_cast<std::uint16_t>(number());
  frame.state = static_cast<DeviceState>(random() % 6);
  frame.reason = static_cast<Reason>(random() % 256);
  frame.slip = random() % 2 != 0;
  frame.grip_ok = random() % 2 != 0;
  frame.features_valid = random() % 2 != 0;
  frame.alive = random() % 2 != 0;
  frame.markers = static_cast<std::uint8_t>(number());
  frame.vx_um_s = static_cast<std::int32_t>(number());
  frame.vy_um_s = static_cast<std::int32_t>(number());
  frame.entropy_nat_q16 = static_cast<std::int32_t>(number());
  frame.entropy_rate_nat_s_q8 = static_cast<std::int32_t>(number());
  return frame;
}

Wire encoded(const StatusFrame& frame) {
  Wire wire{};
  LONGS_EQUAL(sf::kWireBytes, sf::encode(frame, wire));
  return wire;
}

// A wire with a right CRC around any payload of 30 bytes.
Wire wire_of(const std::array<std::uint8_t, sf::kPayloadBytes - 2>& body) {
  Bytes payload(body.begin(), body.end());
  const int crc = slow_crc16(payload);
  payload.push_back(static_cast<std::uint8_t>(crc));
  payload.push_back(static_cast<std::uint8_t>(crc >> 8));
  Wire wire{};
  CHECK_TRUE(cobs::encode(payload, std::span(wire).first<sf::kWireBytes - 1>()) == sf::kWireBytes - 1);
  return wire;
}

Bytes bytes_of(const Wire& wire) {
  return {wire.begin(), wire.end()};
}

// What both frozen layouts are tried with.
StatusFrame known_frame() {
  StatusFrame frame;
  frame.sequence = 0x1234;
  frame.timestamp_us = 0x89ABCDEF;
  frame.age_100us = 0x01F4;
  frame.state = DeviceState::kSlip;
  frame.reason = Reason::kSlipDetected;
  frame.slip = frame.features_valid = frame.alive = true;
  frame.markers = 63;
  frame.vx_um_s = -2;
  frame.vy_um_s = 0x00010203;
  frame.entropy_nat_q16 = 0x00018000;
  frame.entropy_rate_nat_s_q8 = -0x00000100;
  return frame;
}

}  // namespace

TEST_GROUP(Crc){};

// The catalogue's check value and the values that its other descriptions give for the empty message, "A" and zeros.
TEST(Crc, KnownAnswers) {
  const Bytes digits{'1', '2', '3', '4', '5', '6', '7', '8', '9'};
  LONGS_EQUAL(0x29B1, holdfast::crc16(digits));
  LONGS_EQUAL(0xFFFF, holdfast::crc16({}));
  LONGS_EQUAL(0xB915, holdfast::crc16(Bytes{'A'}));
  UNSIGNED_LONGS_EQUAL(0xCBF43926U, holdfast::crc32(digits));
  UNSIGNED_LONGS_EQUAL(0U, holdfast::crc32({}));
}

TEST(Crc, EqualToLongDivisionAndContinuable) {
  std::mt19937 random(1);
  for (std::size_t length = 0; length < 300; ++length) {
    Bytes bytes(length);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    LONGS_EQUAL(slow_crc16(bytes), holdfast::crc16(bytes));
    const std::span all(bytes);
    const std::uint16_t first = holdfast::crc16(all.first(length / 3));
    LONGS_EQUAL(holdfast::crc16(bytes), holdfast::crc16(all.subspan(length / 3), first));
  }
}

TEST_GROUP(Cobs){};

TEST(Cobs, KnownVectors) {
  struct Case {
    Bytes plain;
    Bytes coded;
  };
  const Case cases[] = {
      {{}, {0x01}},
      {{0x00}, {0x01, 0x01}},
      {{0x00, 0x00}, {0x01, 0x01, 0x01}},
      {{0x00, 0x11, 0x00}, {0x01, 0x02, 0x11, 0x01}},
      {{0x11, 0x22, 0x00, 0x33}, {0x03, 0x11, 0x22, 0x02, 0x33}},
      {{0x11, 0x22, 0x33, 0x44}, {0x05, 0x11, 0x22, 0x33, 0x44}},
      {{0x11, 0x00, 0x00, 0x00}, {0x02, 0x11, 0x01, 0x01, 0x01}},
      {counting(1, 253), joined({{0xFE}, counting(1, 253)})},
      {counting(1, 254), joined({{0xFF}, counting(1, 254)})},
      {counting(0, 254), joined({{0x01, 0xFF}, counting(1, 254)})},
      {counting(1, 255), joined({{0xFF}, counting(1, 254), {0x02, 0xFF}})},
      {joined({counting(2, 255), {0x00}}), joined({{0xFF}, counting(2, 255), {0x01, 0x01}})},
      {joined({counting(3, 255), {0x00, 0x01}}), joined({{0xFE}, counting(3, 255), {0x02, 0x01}})},
      {counting(0, 255), joined({{0x01, 0xFF}, counting(1, 254), {0x02, 0xFF}})},
      {Bytes(508, 7), joined({{0xFF}, Bytes(254, 7), {0xFF}, Bytes(254, 7)})},
      {Bytes(509, 7), joined({{0xFF}, Bytes(254, 7), {0xFF}, Bytes(254, 7), {0x02, 0x07}})},
  };
  for (const Case& c : cases) {
    CHECK_TRUE(c.coded == cobs_encode(c.plain));
    Bytes plain(c.coded.size());
    const auto size = cobs::decode(c.coded, plain);
    LONGS_EQUAL(c.plain.size(), size.value_or(9999));
    plain.resize(c.plain.size());
    CHECK_TRUE(c.plain == plain);
  }
}

TEST(Cobs, RoundTripOfRunsAroundTheBlockLength) {
  std::mt19937 random(2);
  for (std::size_t length = 0; length < 800; ++length) {
    Bytes plain(length);
    for (std::uint8_t& byte : plain) byte = random() % 200 == 0 ? std::uint8_t{0} : std::uint8_t{0xA5};
    const Bytes coded = cobs_encode(plain);
    for (const std::uint8_t byte : coded) CHECK_TRUE(byte != 0);
    Bytes back(length);
    LONGS_EQUAL(length, cobs::decode(coded, back).value_or(9999));
    CHECK_TRUE(plain == back);
    if (length > 0) CHECK_FALSE(cobs::decode(coded, std::span(back).first(length - 1)).has_value());
    if (length > 0) CHECK_FALSE(cobs::encode(plain, std::span(back)).has_value());
  }
}

TEST(Cobs, RefusesWhatIsNotCobs) {
  const Bytes cases[] = {
      {},
      {0x00},
      {0x02},              // the block is cut off
      {0xFF, 0x01, 0x02},  //
      {0x03, 0x11, 0x00},  // a zero inside a block
      {0x02, 0x11, 0x00},  // a zero for a code
  };
  Bytes out(16);
  for (const Bytes& coded : cases) CHECK_FALSE(cobs::decode(coded, out).has_value());
}

TEST_GROUP(StatusFrame){};

// Packed from the byte table, given its CRC (binascii.crc_hqx) and split at its zeros by a few lines of
// Python. Guards the frozen layout of version 1.
TEST(StatusFrame, KnownAnswer) {
  const StatusFrame frame = known_frame();
  const std::array<std::uint8_t, 30> body{0x01, 0x01, 0x34, 0x12, 0xEF, 0xCD, 0xAB, 0x89, 0xF4, 0x01,
                                          3,    98,   0x0D, 63,   0xFE, 0xFF, 0xFF, 0xFF, 0x03, 0x02,
                                          0x01, 0x00, 0x00, 0x80, 0x01, 0x00, 0x00, 0xFF, 0xFF, 0xFF};
  LONGS_EQUAL(0xF97D, slow_crc16(body));
  const Wire want{0x16, 0x01, 0x01, 0x34, 0x12, 0xEF, 0xCD, 0xAB, 0x89, 0xF4, 0x01, 0x03, 0x62, 0x0D, 0x3F, 0xFE, 0xFF,
                  0xFF, 0xFF, 0x03, 0x02, 0x01, 0x01, 0x03, 0x80, 0x01, 0x01, 0x06, 0xFF, 0xFF, 0xFF, 0x7D, 0xF9, 0x00};
  CHECK_TRUE(want == encoded(frame));
  CHECK_TRUE(want == wire_of(body));
}

// Likewise; guards the frozen layout of version 2.
TEST(StatusFrame, KnownAnswerOfAHand) {
  StatusFrame frame = known_frame();
  frame.fingers = 3;
  frame.healthy = 1;
  frame.contact = 2;
  const Bytes want{0x16, 0x02, 0x01, 0x34, 0x12, 0xEF, 0xCD, 0xAB, 0x89, 0xF4, 0x01, 0x03, 0x62,
                   0x0D, 0x3F, 0xFE, 0xFF, 0xFF, 0xFF, 0x03, 0x02, 0x01, 0x01, 0x03, 0x80, 0x01,
                   0x01, 0x09, 0xFF, 0xFF, 0xFF, 0x03, 0x01, 0x02, 0xA0, 0xCF, 0x00};
  Bytes wire(sf::kMostWireBytes);
  LONGS_EQUAL(want.size(), sf::encode(frame, wire));
  CHECK_TRUE(want == wire);
  const sf::Decoded decoded = sf::decode(want);
  CHECK_TRUE(decoded.ok() && decoded.frame == frame);
}

// A receiver of version 1 has room for 33 bytes before the 0x00: of each longer frame it hears nothing.
TEST(StatusFrame, VersionTwoIsLongerThanAnyFrameOfVersionOne) {
  LONGS_EQUAL(34, sf::kWireBytes);
  LONGS_EQUAL(37, sf::kMostWireBytes);
  for (const auto& field : sf::kFields) {
    if (field.name == "crc16" || field.name == "version") continue;
    CHECK_TRUE(std::any_of(sf::kHandFields.begin(), sf::kHandFields.end(), [&](const auto& of_hand) {
      return of_hand.name == field.name && of_hand.offset == field.offset && of_hand.type == field.type;
    }));
  }
}

TEST(StatusFrame, EachFlagHasItsBit) {
  for (const sf::Flag& flag : sf::kFlags) {
    StatusFrame frame;
    frame.*flag.member = true;
    const Wire wire = encoded(frame);
    Bytes payload(sf::kPayloadBytes);
    CHECK_TRUE(cobs::decode(std::span(wire).first(sf::kWireBytes - 1), payload).has_value());
    LONGS_EQUAL(1 << flag.bit, payload[12]);
  }
}

TEST(StatusFrame, AgeIsRoundedUpAndSaturates) {
  LONGS_EQUAL(0, sf::age_100us(Micros{0}));
  LONGS_EQUAL(1, sf::age_100us(Micros{1}));
  LONGS_EQUAL(1, sf::age_100us(Micros{100}));
  LONGS_EQUAL(2, sf::age_100us(Micros{101}));
  LONGS_EQUAL(65534, sf::age_100us(Micros{6'553'400}));
  LONGS_EQUAL(65535, sf::age_100us(Micros{6'553'401}));
  LONGS_EQUAL(65535, sf::age_100us(Micros{6'553'501}));
  LONGS_EQUAL(65535, sf::age_100us(Micros::max()));
  LONGS_EQUAL(65535, sf::age_100us(Micros{-1}));
  LONGS_EQUAL(65535, sf::age_100us(Micros::min()));
}

TEST(StatusFrame, TimestampKeepsItsLow32Bits) {
  UNSIGNED_LONGS_EQUAL(0xFFFFFFFFU, sf::low_timestamp_us(Micros{0xFFFFFFFF}));
  UNSIGNED_LONGS_EQUAL(0U, sf::low_timestamp_us(Micros{0x100000000}));
  UNSIGNED_LONGS_EQUAL(7U, sf::low_timestamp_us(Micros{0x7700000007}));
}

TEST(StatusFrame, RoundTripOfRandomFrames) {
  std::mt19937 random(3);
  for (int i = 0; i < 20'000; ++i) {
    const StatusFrame frame = random_frame(random);
    const sf::Decoded decoded = sf::decode(encoded(frame));
    CHECK_TRUE(decoded.ok());
    CHECK_TRUE(frame == decoded.frame);
  }
}

// The property that the CRC is chosen for, by brute force at this length: no error of one or two bits in the
// payload keeps its CRC. (A CRC is linear: whether an error passes does not depend on the message.)
TEST(StatusFrame, EveryOneAndTwoBitErrorOfThePayloadChangesTheCrc) {
  constexpr std::size_t kBits = 8 * sf::kPayloadBytes;
  constexpr std::size_t kCrcAt = sf::kPayloadBytes - 2;
  // Syndrome of one wrong bit: what it changes between the CRC sent and the CRC computed.
  std::array<std::uint16_t, kBits> syndrome{};
  const std::array<std::uint8_t, kCrcAt> zeros{};
  for (std::size_t bit = 0; bit < kBits; ++bit) {
    if (bit < 8 * kCrcAt) {
      auto flipped = zeros;
      flipped[bit / 8] = static_cast<std::uint8_t>(1U << bit % 8);
      syndrome[bit] = static_cast<std::uint16_t>(holdfast::crc16(flipped) ^ holdfast::crc16(zeros));
    } else {
      syndrome[bit] = static_cast<std::uint16_t>(1U << (bit - 8 * kCrcAt));
    }
  }
  int missed = 0;
  for (std::size_t a = 0; a < kBits; ++a) {
    if (syndrome[a] == 0) ++missed;
    for (std::size_t b = 0; b < a; ++b) missed += syndrome[a] == syndrome[b] ? 1 : 0;
  }
  LONGS_EQUAL(0, missed);
}

// On the wire a flipped bit of a COBS code moves zeros about, which the CRC sees as many wrong bits: no proof
// covers these. Measured over random frames (2026-11-21): 0 of 544 000 single and 0 of 11 056 800 double flips pass.
TEST(StatusFrame, EverySingleBitFlipOnTheWireIsRefused) {
  std::mt19937 random(4);
  int accepted = 0;
  for (int i = 0; i < 300; ++i) {
    const Wire wire = encoded(random_frame(random));
    for (std::size_t bit = 0; bit < 8 * wire.size(); ++bit) {
      Wire bad = wire;
      bad[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
      accepted += sf::decode(bad).ok() ? 1 : 0;
    }
  }
  LONGS_EQUAL(0, accepted);
}

TEST(StatusFrame, EveryCutAndEveryByteTooManyIsRefused) {
  std::mt19937 random(5);
  const Wire wire = encoded(random_frame(random));
  for (std::size_t size = 0; size < wire.size(); ++size) {
    CHECK_FALSE(sf::decode(std::span(wire).first(size)).ok());
    CHECK_FALSE(sf::decode(std::span(wire).last(size)).ok());
    Bytes missing = bytes_of(wire);
    missing.erase(missing.begin() + static_cast<std::ptrdiff_t>(size));
    CHECK_FALSE(sf::decode(missing).ok());
    Bytes doubled = bytes_of(wire);
    doubled.insert(doubled.begin() + static_cast<std::ptrdiff_t>(size), doubled[size]);
    CHECK_FALSE(sf::decode(doubled).ok());
  }
  CHECK_TRUE(sf::decode(joined({bytes_of(wire), bytes_of(wire)})).error == DecodeError::kLength);
}

TEST(StatusFrame, SoundFramesThatAreNotOursSayWhy) {
  std::array<std::uint8_t, 30> body{};
  body[0] = 1;
  body[1] = 1;
  CHECK_TRUE(sf::decode(wire_of(body)).ok());
  body[10] = 5;
  CHECK_TRUE(sf::decode(wire_of(body)).ok());
  body[10] = 6;
  CHECK_TRUE(sf::decode(wire_of(body)).error == DecodeError::kState);
  body[1] = 2;
  CHECK_TRUE(sf::decode(wire_of(body)).error == DecodeError::kKind);
  body[0] = 2;
  CHECK_TRUE(sf::decode(wire_of(body)).error == DecodeError::kKind);
  body[1] = 1;
  CHECK_TRUE(sf::decode(wire_of(body)).error == DecodeError::kLength);  // version 2 has 33 bytes before the CRC
  body[0] = 3;
  CHECK_TRUE(sf::decode(wire_of(body)).error == DecodeError::kVersion);
  Wire damaged = wire_of(body);
  damaged[0] ^= 1;
  CHECK_TRUE(sf::decode(damaged).error != DecodeError::kNone);
  CHECK_TRUE(sf::decode(Wire{}).error == DecodeError::kFraming);
  Wire unterminated = wire_of(body);
  unterminated.back() = 1;
  CHECK_TRUE(sf::decode(unterminated).error == DecodeError::kFraming);
}

TEST(StatusFrame, UnknownFlagBitsAndReasonsAreTakenAsTheyAre) {
  std::array<std::uint8_t, 30> body{};
  body[0] = body[1] = 1;
  body[11] = 250;
  body[12] = 0xF2;
  const sf::Decoded decoded = sf::decode(wire_of(body));
  CHECK_TRUE(decoded.ok());
  LONGS_EQUAL(250, static_cast<int>(decoded.frame.reason));
  CHECK_TRUE(decoded.frame.grip_ok);
  CHECK_FALSE(decoded.frame.slip || decoded.frame.features_valid || decoded.frame.alive);
}
