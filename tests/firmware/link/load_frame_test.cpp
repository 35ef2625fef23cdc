// SPDX-License-Identifier: Apache-2.0
#include "link/load_frame.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

#include "tests/fuzz/link_check.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::load_frame;
using namespace holdfast::test;

namespace {

LinkBytes wire_of(const LoadFrame& frame) {
  std::array<std::uint8_t, kWireBytes> wire{};
  LONGS_EQUAL(kWireBytes, encode(frame, wire));
  return {wire.begin(), wire.end()};
}

}  // namespace

TEST_GROUP(LoadFrame){};

// By hand: COBS and CRC of link_check.hpp share nothing with the firmware's.
TEST(LoadFrame, LayoutIsTheOneOfVersion1) {
  const LoadFrame frame{.sequence = 0x1234,
                        .finger = 1,
                        .basis = 2,
                        .flags = 3,
                        .shear_x_mn = -2,
                        .shear_y_mn = 0x0405,
                        .normal_mn = -32768,
                        .friction_use_permille = 0x0607};
  CHECK_TRUE(wire_of(frame) ==
             frame_around({1, 7, 0x34, 0x12, 1, 2, 3, 0xFE, 0xFF, 0x05, 0x04, 0x00, 0x80, 0x07, 0x06}));
  link::Payload payload;
  CHECK_TRUE(link::open(wire_of(frame), payload) == link::DecodeError::kNone);
  CHECK_TRUE(read(payload) == frame);
  CHECK_FALSE(evidence_frame::read(payload).has_value());
}

TEST(LoadFrame, SoundFramesOfAnotherKindVersionOrLengthAreNone) {
  const auto reads = [](std::uint8_t version, std::uint8_t kind, std::size_t size) {
    LinkBytes body(size);
    body[0] = version;
    body[1] = kind;
    link::Payload payload;
    CHECK_TRUE(link::open(frame_around(body), payload) == link::DecodeError::kNone);
    return read(payload).has_value();
  };
  CHECK_TRUE(reads(1, 7, 15));
  CHECK_FALSE(reads(2, 7, 15));
  CHECK_FALSE(reads(1, 7, 14));
  CHECK_FALSE(reads(1, 7, 16));
  for (std::uint8_t kind = 0; kind < 7; ++kind) CHECK_FALSE(reads(1, kind, 15));
}

TEST(LoadFrame, SaysWhatTheStageSays) {
  load::Load load;
  load.basis = load::Basis::kTwoWeights;
  load.within = true;
  load.shear_x = Millinewtons::from_raw(Millinewtons::kMin);
  load.shear_y = Millinewtons::from_raw(7);
  load.normal = Millinewtons::from_raw(Millinewtons::kMax);
  load.friction_use = Permille::from_raw(Permille::kMax);
  LoadFrame want{.sequence = 9,
                 .finger = 1,
                 .basis = 3,
                 .flags = 1,
                 .shear_x_mn = -32'767,
                 .shear_y_mn = 7,
                 .normal_mn = 32'767,
                 .friction_use_permille = 9'999};
  CHECK_TRUE(frame_of(9, 1, load) == want);
  load.within = false;
  load.strained = true;
  want.flags = 2;
  CHECK_TRUE(frame_of(9, 1, load) == want);
  CHECK_TRUE(frame_of(0, 0, {}) == LoadFrame{});
  for (std::size_t i = 0; i < kBases.size(); ++i) LONGS_EQUAL(i, kBases[i].number);
}
