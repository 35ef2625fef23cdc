// SPDX-License-Identifier: Apache-2.0
// The robot's header, compiled as C99 (tests/robot/link_c99.c), against the firmware.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "app/supervisor.hpp"
#include "link/command_frame.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/load_frame.hpp"
#include "link/status_frame.hpp"
#include "tests/fuzz/link_check.hpp"
#include "tests/robot/link_c99.h"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
namespace cf = command_frame;
namespace ef = evidence_frame;
namespace lf = load_frame;
namespace sf = status_frame;
using test::LinkBytes;

namespace {

template <typename Number>
Number any(std::mt19937& random) {
  using Limits = std::numeric_limits<Number>;
  constexpr std::array kEnds{Limits::min(), Limits::max(), Number{0}, Number{1},
                             static_cast<Number>(Limits::max() / 2)};
  if (random() % 4 == 0) return kEnds[random() % kEnds.size()];
  return static_cast<Number>(static_cast<std::uint32_t>(random()) >> random() % 32);
}

sf::StatusFrame any_status(std::mt19937& random) {
  sf::StatusFrame frame;
  frame.sequence = any<std::uint16_t>(random);
  frame.timestamp_us = any<std::uint32_t>(random);
  frame.age_100us = any<std::uint16_t>(random);
  frame.state = static_cast<DeviceState>(random() % 6);
  frame.reason = static_cast<Reason>(any<std::uint8_t>(random));
  frame.slip = random() % 2 != 0;
  frame.grip_ok = random() % 2 != 0;
  frame.features_valid = random() % 2 != 0;
  frame.alive = random() % 2 != 0;
  frame.markers = any<std::uint8_t>(random);
  frame.vx_um_s = any<std::int32_t>(random);
  frame.vy_um_s = any<std::int32_t>(random);
  frame.entropy_nat_q16 = any<std::int32_t>(random);
  frame.entropy_rate_nat_s_q8 = any<std::int32_t>(random);
  if (random() % 2 != 0) {  // version 2
    frame.fingers = static_cast<std::uint8_t>(1 + random() % 255);
    frame.healthy = any<std::uint8_t>(random);
    frame.contact = any<std::uint8_t>(random);
  }
  return frame;
}

LinkBytes wire_of(const sf::StatusFrame& frame) {
  LinkBytes wire(sf::kMostWireBytes);
  wire.resize(sf::encode(frame, wire));
  return wire;
}

ef::EvidenceFrame any_evidence(std::mt19937& random) {
  ef::EvidenceFrame frame;
  frame.sequence = any<std::uint16_t>(random);
  frame.finger = any<std::uint8_t>(random);
  frame.contact = any<std::uint8_t>(random);
  frame.evidence = any<std::uint8_t>(random);
  frame.unit = any<std::uint8_t>(random);
  frame.run = any<std::uint8_t>(random);
  frame.patches = any<std::uint16_t>(random);
  frame.value_milli = any<std::int32_t>(random);
  frame.threshold_milli = any<std::int32_t>(random);
  frame.motion_log2_um_q8 = any<std::int16_t>(random);
  frame.coarse_log2_um_q8 = any<std::int16_t>(random);
  frame.growth_log2_q8 = any<std::int16_t>(random);
  return frame;
}

std::array<std::uint8_t, ef::kWireBytes> wire_of(const ef::EvidenceFrame& frame) {
  std::array<std::uint8_t, ef::kWireBytes> wire{};
  ef::encode(frame, wire);
  return wire;
}

lf::LoadFrame any_load(std::mt19937& random) {
  lf::LoadFrame frame;
  frame.sequence = any<std::uint16_t>(random);
  frame.finger = any<std::uint8_t>(random);
  frame.basis = any<std::uint8_t>(random);
  frame.flags = any<std::uint8_t>(random);
  frame.shear_x_mn = any<std::int16_t>(random);
  frame.shear_y_mn = any<std::int16_t>(random);
  frame.normal_mn = any<std::int16_t>(random);
  frame.friction_use_permille = any<std::uint16_t>(random);
  return frame;
}

std::array<std::uint8_t, lf::kWireBytes> wire_of(const lf::LoadFrame& frame) {
  std::array<std::uint8_t, lf::kWireBytes> wire{};
  lf::encode(frame, wire);
  return wire;
}

// What the last byte of `bytes` completes; the others complete nothing that is no text or damage.
int pushed(holdfast_receiver& receiver, std::span<const std::uint8_t> bytes) {
  int last = 0;
  for (const std::uint8_t byte : bytes) last = c99_push(&receiver, byte);
  return last;
}

}  // namespace

TEST_GROUP(RobotLink) {
  std::mt19937 random{1};
  holdfast_receiver receiver{};
};

TEST(RobotLink, EveryFieldOfAStatusIsReadAsItWasWritten) {
  for (int i = 0; i < 20'000; ++i) {
    const sf::StatusFrame frame = any_status(random);
    LONGS_EQUAL(HOLDFAST_KIND_STATUS, pushed(receiver, wire_of(frame)));
    holdfast_status status{};
    LONGS_EQUAL(1, c99_status(&receiver, &status));
    CHECK_TRUE(test::same(frame, status));
  }
  LONGS_EQUAL(20'000, receiver.frames);
  LONGS_EQUAL(0, receiver.damaged);
}

TEST(RobotLink, EveryFieldOfAnEvidenceIsReadAsItWasWritten) {
  for (int i = 0; i < 20'000; ++i) {
    const ef::EvidenceFrame frame = any_evidence(random);
    LONGS_EQUAL(HOLDFAST_KIND_EVIDENCE, pushed(receiver, wire_of(frame)));
    holdfast_evidence evidence{};
    c99_evidence(&receiver, &evidence);
    CHECK_TRUE(test::same(frame, evidence));
  }
  LONGS_EQUAL(0, receiver.damaged);
}

TEST(RobotLink, EveryFieldOfALoadIsReadAsItWasWritten) {
  for (int i = 0; i < 20'000; ++i) {
    const lf::LoadFrame frame = any_load(random);
    LONGS_EQUAL(HOLDFAST_KIND_LOAD, pushed(receiver, wire_of(frame)));
    holdfast_load load{};
    c99_load(&receiver, &load);
    CHECK_TRUE(test::same(frame, load));
  }
  LONGS_EQUAL(0, receiver.damaged);
}

TEST(RobotLink, CommandsAndAnswersAreReadAsTheyWereWritten) {
  for (int i = 0; i < 20'000; ++i) {
    const cf::CommandFrame want{any<std::uint16_t>(random), static_cast<cf::Command>(any<std::uint8_t>(random)),
                                any<std::uint8_t>(random)};
    const holdfast_command command{want.sequence, static_cast<std::uint8_t>(want.command), want.argument};
    std::array<std::uint8_t, HOLDFAST_COMMAND_WIRE> wire{};
    c99_command(&command, wire.data());
    link::Receiver firmware;
    link::Event event{};
    for (const std::uint8_t byte : wire) event = firmware.push(byte);
    CHECK_TRUE(event == link::Event::kFrame && cf::read_command(firmware.payload()) == want);

    const cf::AnswerFrame answer{want.sequence, want.command, static_cast<cf::Outcome>(any<std::uint8_t>(random))};
    std::array<std::uint8_t, cf::kAnswerBytes> answer_wire{};
    cf::encode(answer, answer_wire);
    LONGS_EQUAL(HOLDFAST_KIND_ANSWER, pushed(receiver, answer_wire));
    holdfast_answer heard{};
    c99_answer(&receiver, &heard);
    CHECK_TRUE(test::same(answer, heard) && holdfast_link_answers(&heard, &command) != 0);
    ++heard.sequence;
    CHECK_FALSE(holdfast_link_answers(&heard, &command) != 0);
  }
}

TEST(RobotLink, EverySingleBitFlipIsRefused) {
  int taken = 0;
  const auto flip = [&](const auto& wire) {
    for (std::size_t bit = 0; bit < 8 * wire.size(); ++bit) {
      auto bad = wire;
      bad[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
      receiver = {};
      for (const std::uint8_t byte : bad) taken += c99_push(&receiver, byte) > 0 ? 1 : 0;
      taken += c99_push(&receiver, 0) > 0 ? 1 : 0;
    }
  };
  for (int i = 0; i < 300; ++i) {
    flip(wire_of(any_status(random)));
    flip(wire_of(any_evidence(random)));
    flip(wire_of(any_load(random)));
  }
  LONGS_EQUAL(0, taken);
}

TEST(RobotLink, HearsTheNextFrameBehindAnyJunk) {
  const sf::StatusFrame frame = any_status(random);
  const auto wire = wire_of(frame);
  for (int i = 0; i < 5000; ++i) {
    LinkBytes junk(random() % 300);
    for (std::uint8_t& byte : junk) byte = static_cast<std::uint8_t>(random() % (i % 2 == 0 ? 256 : 8));
    junk.push_back(0);
    (void)pushed(receiver, junk);
    LONGS_EQUAL(HOLDFAST_KIND_STATUS, pushed(receiver, wire));
    holdfast_status status{};
    LONGS_EQUAL(1, c99_status(&receiver, &status));
    CHECK_TRUE(test::same(frame, status));
  }
}

TEST(RobotLink, SaysWhatItDoesNotKnow) {
  LONGS_EQUAL(HOLDFAST_LINK_OTHER, pushed(receiver, test::frame_around({2, 1, 0, 0})));
  LONGS_EQUAL(HOLDFAST_LINK_OTHER, pushed(receiver, test::frame_around({1, 9, 0, 0})));
  LONGS_EQUAL(HOLDFAST_LINK_OTHER, pushed(receiver, test::frame_around({1, 1, 0, 0})));
  LinkBytes body(30);
  body[0] = body[1] = 1;
  body[10] = 6;
  LONGS_EQUAL(HOLDFAST_KIND_STATUS, pushed(receiver, test::frame_around(body)));
  holdfast_status status{};
  LONGS_EQUAL(0, c99_status(&receiver, &status));
  LinkBytes bad = test::frame_around(body);
  bad[20] ^= 2;
  LONGS_EQUAL(HOLDFAST_LINK_DAMAGED, pushed(receiver, bad));
  LONGS_EQUAL(4, receiver.frames);
  LONGS_EQUAL(1, receiver.damaged);
}

TEST(RobotLink, NamesAreThoseOfTheFirmware) {
  for (int number = 0; number < 256; ++number) {
    std::array<std::string, 8> want{"?", "?", "?", "?", "?", "?", "?", "?"};
    for (const StateInfo& row : kStates) {
      if (static_cast<int>(row.state) == number) want[0] = row.name;
    }
    for (const ReasonInfo& row : kReasons) {
      if (static_cast<int>(row.reason) == number) want[1] = row.name;
    }
    for (const cf::CommandInfo& row : cf::kCommands) {
      if (static_cast<int>(row.command) == number) want[2] = row.name;
    }
    for (const cf::ResultInfo& row : cf::kResults) {
      if (static_cast<int>(row.result) == number) want[3] = row.name;
    }
    for (const ef::Row& row : ef::kContacts) {
      if (row.number == number) want[4] = row.name;
    }
    for (const ef::Row& row : ef::kEvidences) {
      if (row.number == number) want[5] = row.name;
    }
    for (const link::Row& row : lf::kBases) {
      if (row.number == number) want[7] = row.name;
    }
    const auto byte = static_cast<std::uint8_t>(number);
    if (byte < ef::kUnits.size()) want[6] = ef::kUnits[byte];
    STRCMP_EQUAL(want[0].c_str(), c99_name('s', byte));
    STRCMP_EQUAL(want[1].c_str(), c99_name('r', byte));
    STRCMP_EQUAL(want[2].c_str(), c99_name('c', byte));
    STRCMP_EQUAL(want[3].c_str(), c99_name('a', byte));
    STRCMP_EQUAL(want[4].c_str(), c99_name('t', byte));
    STRCMP_EQUAL(want[5].c_str(), c99_name('e', byte));
    STRCMP_EQUAL(want[6].c_str(), c99_name('u', byte));
    STRCMP_EQUAL(want[7].c_str(), c99_name('b', byte));
  }
}

TEST(RobotLink, ConstantsAndTheirMeaningsAreThoseOfTheFirmware) {
  const std::string header = test::read_file(holdfast::test::source("toolchain/robot/holdfast_link.h"));
  std::size_t constants = 0;
  const auto check = [&](std::string line, std::string_view name, auto number, const std::string& meaning) {
    for (const char c : name) line += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    line = "\n  " + line + " = " + std::to_string(static_cast<unsigned>(number));
    const std::string comment = "  // " + meaning + "\n";
    const bool there =
        header.find(line + comment) != std::string::npos || header.find(line + "," + comment) != std::string::npos;
    CHECK_TEXT(there, (line + comment).c_str());
    ++constants;
  };
  for (const sf::Flag& row : sf::kFlags) check("HOLDFAST_FLAG_", row.name, 1U << row.bit, std::string(row.meaning));
  for (const StateInfo& row : kStates) check("HOLDFAST_STATE_", row.name, row.state, std::string(row.meaning));
  for (const ReasonInfo& row : kReasons) check("HOLDFAST_REASON_", row.name, row.reason, std::string(row.what));
  for (const cf::CommandInfo& row : cf::kCommands) {
    check("HOLDFAST_COMMAND_", row.name, row.command,
          std::string(row.meaning) + " (argument " + std::string(row.argument) + ")");
  }
  for (const cf::ResultInfo& row : cf::kResults) {
    check("HOLDFAST_RESULT_", row.name, row.result, std::string(row.meaning));
  }
  for (const ef::Row& row : ef::kContacts) check("HOLDFAST_CONTACT_", row.name, row.number, std::string(row.meaning));
  for (const ef::Row& row : ef::kEvidences) check("HOLDFAST_EVIDENCE_", row.name, row.number, std::string(row.meaning));
  for (const link::Row& row : lf::kBases) check("HOLDFAST_BASIS_", row.name, row.number, std::string(row.meaning));
  for (const link::Row& row : lf::kFlags) check("HOLDFAST_LOAD_", row.name, 1U << row.number, std::string(row.meaning));
  // The enums with a tag have no others.
  std::size_t found = 0;
  for (std::size_t at = header.find("enum holdfast_"); at < header.find("static inline"); ++at) {
    found += header.compare(at, 3, " = ") == 0 ? 1U : 0U;
  }
  LONGS_EQUAL(found, constants);
}

TEST_GROUP(ReceiversRule) {
  holdfast_grip grip{};

  void hear(bool alive, bool ok, std::uint32_t now_ms) {
    holdfast_status status{};
    status.flags = static_cast<std::uint8_t>((alive ? HOLDFAST_FLAG_ALIVE : 0) | (ok ? HOLDFAST_FLAG_GRIP_OK : 0));
    c99_grip_update(&grip, &status, now_ms);
  }
  bool fine(std::uint32_t now_ms) {
    return c99_grip_ok(&grip, now_ms) != 0;
  }
};

TEST(ReceiversRule, IsTheFirmwaresTime) {
  LONGS_EQUAL(HOLDFAST_GRIP_FRESH_MS * 1000, sf::kFreshFor.count());
  LONGS_EQUAL(sf::kFreshFor.count(), supervisor::Config{}.hold.count());
}

TEST(ReceiversRule, CountsFor149Milliseconds) {
  for (const std::uint32_t start : {0U, 1000U, 0x7FFFFFC0U, 0xFFFFFF00U, 0xFFFFFFC0U, 0xFFFFFFFFU}) {
    for (const auto& [age, want] : {std::pair(0U, true),
                                    {1U, true},
                                    {149U, true},
                                    {150U, false},
                                    {151U, false},
                                    {0x7FFFFFFFU, false},
                                    {0x80000000U, false},
                                    {0xFFFFFF6AU, false},  // 150 ms before
                                    {0xFFFFFF6BU, true},
                                    {0xFFFFFFFFU, true}}) {
      grip = {};
      CHECK_FALSE(fine(start));
      hear(false, true, start - 40);
      CHECK_FALSE(fine(start - 40));  // a first level may be an old one
      hear(true, true, start);
      CHECK_EQUAL(want, fine(start + age));
    }
  }
}

// Bytes are taken in an interrupt; the control step had read its clock before.
TEST(ReceiversRule, AnAskerWhoseClockWasReadBeforeTheFrameCameIsNoSilence) {
  hear(false, true, 1000);
  hear(true, true, 1040);
  CHECK_TRUE(fine(1039));
  CHECK_TRUE(fine(1041));
  CHECK_TRUE(fine(1075));
  CHECK_FALSE(fine(1190));
  CHECK_FALSE(fine(1041));  // found too old
  hear(false, true, 1200);
  hear(true, true, 1199);
  CHECK_TRUE(fine(1199));
}

TEST(ReceiversRule, FramesWithoutAChangeOfAliveVouchForNothing) {
  hear(false, true, 0);
  hear(true, true, 40);
  hear(true, true, 100);
  hear(true, true, 189);
  CHECK_TRUE(fine(189));
  hear(true, true, 190);
  CHECK_FALSE(fine(190));
  hear(false, true, 400);
  CHECK_TRUE(fine(400));
}

TEST(ReceiversRule, LowCountsAtOnce) {
  hear(false, true, 0);
  hear(true, true, 40);
  CHECK_TRUE(fine(41));
  hear(true, false, 42);
  CHECK_FALSE(fine(42));
  hear(true, true, 43);
  CHECK_TRUE(fine(43));
  hear(false, false, 44);
  CHECK_FALSE(fine(44));
}

// 49.7 days of silence, in which somebody asked, or frames came in which `alive` stood still.
TEST(ReceiversRule, WhatWasTooOldStaysSoWhenTheClockComesRound) {
  hear(false, true, 0);
  hear(true, true, 40);
  CHECK_FALSE(fine(1000));
  CHECK_FALSE(fine(40));
  CHECK_FALSE(fine(41));
  hear(false, true, 50);
  CHECK_TRUE(fine(50));
  hear(false, true, 5000);
  hear(false, true, 50);
  CHECK_FALSE(fine(51));
}

// A device, its link and a receiver in virtual time; clocks that begin shortly before they come round, and an oracle
// that knows what the receiver does not: when a frame's picture was taken by the receiver's clock.
TEST_GROUP(LateFrames) {
  static constexpr std::int64_t kPeriodUs = 40'000, kLeastLagUs = 45'000;
  static constexpr std::int64_t kWireUs = 2'952;  // 34 bytes at 115200 baud
  holdfast_grip grip{};
  std::uint32_t clock_ms = 0xFFFFFFFF - 5'000;  // the receiver's at 0
  std::uint32_t device_us = 0xFFFFFFFF - 9'000'000;
  std::uint16_t sequence = 65'500;
  bool alive = false;
  std::int64_t taken_us = 0, heard_us = 0;  // picture and arrival of the last frame
  std::int64_t fine_ms = 0, oldest_us = 0;  // asked at each millisecond: how often fine, on how old a picture at most

  // What the device sends of a picture at `at_us`, when it is not heard.
  void take(std::int64_t at_us) {
    taken_us = at_us;
    ++sequence;
    alive = !alive;
  }
  // It is heard at `arrives_us`; until then the receiver is asked at each millisecond about what it had.
  void hear(std::int64_t at_us, std::int64_t arrives_us) {
    ask_until(arrives_us);
    take(at_us);
    tell(arrives_us);
  }
  void tell(std::int64_t arrives_us) {
    holdfast_status status{};
    status.sequence = sequence;
    status.timestamp_us = device_us + static_cast<std::uint32_t>(taken_us);
    status.flags = static_cast<std::uint8_t>((alive ? HOLDFAST_FLAG_ALIVE : 0) | HOLDFAST_FLAG_GRIP_OK);
    heard_us = arrives_us;
    c99_grip_update(&grip, &status, now_ms(arrives_us));
    ask(arrives_us);
  }
  [[nodiscard]] std::uint32_t now_ms(std::int64_t us) const {
    return clock_ms + static_cast<std::uint32_t>(us / 1000);
  }
  bool ask(std::int64_t us) {
    if (c99_grip_ok(&grip, now_ms(us)) == 0) return false;
    ++fine_ms;
    oldest_us = std::max(oldest_us, us - taken_us);
    return true;
  }
  void ask_until(std::int64_t us) {
    for (std::int64_t at = heard_us + 1000; at < us && at < heard_us + 400'000; at += 1000) (void)ask(at);
  }
  // Healthy for `count` frames from a picture at `at_us` on. Returns when the next one is taken.
  std::int64_t healthy(std::int64_t at_us, int count) {
    for (int k = 0; k < count; ++k, at_us += kPeriodUs) hear(at_us, at_us + kLeastLagUs + k * 7919 % 30'000);
    return at_us;
  }
  // Nothing comes for `stall_us`, then all that waited at the speed of the line, up to the frame that waits for
  // nothing.
  std::int64_t stall(std::int64_t at_us, std::int64_t stall_us, std::int64_t wire_us = kWireUs, int burst = 1) {
    std::int64_t arrives = at_us + kLeastLagUs + stall_us;
    for (int k = 1; at_us + kLeastLagUs < arrives; ++k, at_us += kPeriodUs) {
      hear(at_us, arrives);
      if (k % burst == 0) arrives += wire_us * burst;
    }
    return at_us;
  }
  // The picture's age when a frame came that is not late, and the rule's time since then.
  void check_never_old(std::int64_t silence_us) const {
    CHECK_COMPARE(oldest_us, <=, kLeastLagUs + 30'000 + 2LL * HOLDFAST_GRIP_LATE_US + silence_us / 4'000);
  }
};

TEST(LateFrames, AreNeverFineBehindAStall) {
  for (const std::int64_t stall_ms : {160, 300, 1'000, 3'000, 20'000, 600'000, 1'700'000}) {
    for (const int burst : {1, 2, 20, 70}) {
      grip = {}, heard_us = 0, oldest_us = 0;
      std::int64_t at = healthy(0, 100);
      at = stall(at, stall_ms * 1000, kWireUs, burst);
      check_never_old(stall_ms * 1000);
      at = healthy(at, 10);
      CHECK_TRUE(ask(heard_us));
      check_never_old(stall_ms * 1000);
    }
  }
}

TEST(LateFrames, AreNeverFineBehindAStallThatLostSome) {
  std::int64_t at = healthy(0, 100);
  const std::int64_t ends = at + 60'000'000;
  for (int k = 0; k < 1'400; ++k, at += kPeriodUs) take(at);
  at = stall(at, ends - at);
  check_never_old(60'000'000);
  healthy(at, 10);
  CHECK_TRUE(ask(heard_us));
}

// 2^31 us are 35.8 minutes: older ones would look as if they came from the future.
TEST(LateFrames, AreNeverFineBehindHoursOfSilence) {
  for (const std::int64_t stall_s : {1'799, 1'801, 2'200, 3'000, 4'294, 4'296, 4'400, 40'000}) {
    grip = {}, heard_us = 0, oldest_us = 0;
    std::int64_t at = healthy(0, 100);
    const std::int64_t ends = at + stall_s * 1'000'000;
    for (int k = 0; k < 100; ++k, at += kPeriodUs) hear(at, ends + k * kWireUs);
    check_never_old(1'800'000'000);
    for (; at < ends + 1'000'000; at += kPeriodUs) take(at);
    healthy(at, 40);
    CHECK_TRUE(ask(heard_us));
    check_never_old(1'800'000'000);
  }
}

TEST(LateFrames, AreNeverFineWhereTheReceiverBeginsWithABacklog) {
  for (const int burst : {1, 2, 20, 70}) {
    grip = {}, heard_us = 0;
    const std::int64_t at = stall(0, 3'000'000, kWireUs, burst);
    check_never_old(0);
    healthy(at, 25);
    CHECK_TRUE(ask(heard_us));
  }
}

TEST(LateFrames, AreNeverFineWhereTheDeviceStartedAnewWhileTheLinkStalled) {
  std::int64_t at = healthy(0, 100);
  const std::int64_t ends = at + 8'000'000;
  for (int k = 0; k < 40; ++k, at += kPeriodUs) hear(at, ends + k * kWireUs);
  at += 1'000'000;
  device_us = 3'000'000U - static_cast<std::uint32_t>(at);
  sequence = 0;
  for (int k = 40; k < 100; ++k, at += kPeriodUs) hear(at, ends + k * kWireUs);
  at = stall(at, heard_us + kWireUs - at - kLeastLagUs);
  check_never_old(0);
  healthy(at, 25);
  CHECK_TRUE(ask(heard_us));
}

TEST(LateFrames, AHealthyLinkIsAlwaysFineForADayOfClocksThatDiffer) {
  for (const std::int64_t ppm : {-200, 0, 200}) {
    grip = {};
    std::mt19937 random(1);
    for (std::int64_t k = 0; k < 24LL * 3600 * 25; ++k) {
      const std::int64_t at = k * kPeriodUs;
      // Most frames are 60 ms late, few none; 100 ms are the most that 150 ms allow for.
      const auto more = static_cast<std::int64_t>(random() % 1000 == 0 ? 0U : 60'000 + random() % 40'000);
      const std::int64_t lag = kLeastLagUs + more;
      holdfast_status status{};
      status.sequence = ++sequence;
      status.timestamp_us = device_us + static_cast<std::uint32_t>(at + at * ppm / 1'000'000);
      status.flags = static_cast<std::uint8_t>((k % 2 != 0 ? HOLDFAST_FLAG_ALIVE : 0) | HOLDFAST_FLAG_GRIP_OK);
      c99_grip_update(&grip, &status, now_ms(at + lag));
      if (k >= 25) CHECK_TRUE(c99_grip_ok(&grip, now_ms(at + lag)) != 0);
    }
  }
}

TEST(LateFrames, ADeviceThatStartsAnewIsFineWithinASecond) {
  std::mt19937 random(2);
  for (int k = 0; k < 2'000; ++k) {
    grip = {}, heard_us = 0;
    device_us = static_cast<std::uint32_t>(random());
    sequence = static_cast<std::uint16_t>(random());
    std::int64_t at = healthy(0, 50);
    at += k % 2 != 0 ? 300'000 : 20'000'000;  // the process with a clock of its own; the board
    device_us = static_cast<std::uint32_t>(random() % 20'000'000) - static_cast<std::uint32_t>(at);
    sequence = 0;
    healthy(at, 24);  // 0.96 s
    CHECK_TRUE(ask(heard_us));
  }
}

TEST(LateFrames, AFasterModeEndsNothing) {
  std::int64_t at = healthy(0, 100);
  for (int k = 0; k < 50; ++k, at += kPeriodUs) {
    hear(at, at + kLeastLagUs - 40'000);
    CHECK_TRUE(ask(heard_us));
  }
}

// `timestamp_us` is the left finger's, also while it is left out by `lost_finger`.
TEST(LateFrames, ATimestampThatStandsStillShowsNothing) {
  std::int64_t at = healthy(0, 100);
  for (int k = 0; k < 500; ++k) {
    at += kPeriodUs;
    ++sequence;
    alive = !alive;
    tell(at);
    CHECK_TRUE(ask(at));
  }
}

// The same draws in tests/python/test_link.py give the same sum of answers there.
TEST(LateFrames, AreThoseOfTheTwinInPython) {
  std::uint32_t x = 1, sum = 0, fine = 0, now = 0xFFFF0000, stamp = 0xFFF00000, wait = 40;
  sequence = 65'000;
  const auto draw = [&x](std::uint32_t below) {
    x = x * 1664525 + 1013904223;
    return (x >> 8) % below;
  };
  for (int k = 0; k < 100'000; ++k) {
    const std::uint32_t mode = k % 64 == 0 ? draw(4) : 4;
    if (mode < 4) wait = mode == 2 ? 3 : 40;
    if (mode == 2) now += 200 + draw(3'000);
    if (mode == 3) stamp = draw(1 << 24) * 256, sequence = static_cast<std::uint16_t>(draw(65'536));
    if (draw(2'000) == 0) now += 1'900'000;
    now += wait + draw(8);
    stamp += 38'000 + draw(4'000);
    alive = alive != (draw(16) != 0);
    holdfast_status status{};
    status.sequence = ++sequence;
    status.timestamp_us = stamp;
    status.flags =
        static_cast<std::uint8_t>((alive ? HOLDFAST_FLAG_ALIVE : 0) | (draw(16) != 0 ? HOLDFAST_FLAG_GRIP_OK : 0));
    c99_grip_update(&grip, &status, now);
    for (const std::uint32_t later : {0U, draw(40), 0U - draw(4)}) {
      const std::uint32_t answer = c99_grip_ok(&grip, now + later) != 0 ? 1 : 0;
      sum = sum * 31 + answer;
      fine += answer;
    }
  }
  UNSIGNED_LONGS_EQUAL(64'491, fine);
  UNSIGNED_LONGS_EQUAL(2'265'733'411, sum);
}
