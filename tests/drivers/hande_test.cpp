// SPDX-License-Identifier: Apache-2.0
// The simulated Hand-E by itself, spoken to in the bytes of the manual: it is the oracle of the firmware's.
#include "drivers/sim/hande.hpp"

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/clock.hpp"
#include "tests/support/modbus_bytes.hpp"

#include <CppUTest/TestHarness.h>

namespace sim = holdfast::sim;
using holdfast::test::hex;
using holdfast::test::with_crc;
using sim::LineTrouble;
using Bytes = holdfast::test::ModbusBytes;
using std::chrono::microseconds;
using namespace std::chrono_literals;

namespace {

// From the manual; those of other commands have their CRC from the definition.
constexpr std::string_view kActivate = "09 10 03E8 0003 06 0100 0000 0000 72E1";
constexpr std::string_view kClear = "09 10 03E8 0003 06 0000 0000 0000 7330";
constexpr std::string_view kCloseFully = "09 10 03E8 0003 06 0900 00FF FFFF 4229";
constexpr std::string_view kOpenFully = "09 10 03E8 0003 06 0900 0000 FFFF 7219";
constexpr std::string_view kAck = "09 10 03E8 0003 0130";
constexpr std::string_view kRead3 = "09 03 07D0 0003 040E";
constexpr std::string_view kRead4 = "09 04 07D0 0003 B1CE";

Bytes go(unsigned position, unsigned speed, unsigned force) {
  Bytes bytes = hex("09 10 03E8 0003 06 0900 00");
  for (const unsigned value : {position, speed, force}) bytes.push_back(static_cast<std::uint8_t>(value));
  return with_crc(bytes);
}

}  // namespace

TEST_GROUP(SimHandE) {
  sim::Clock clock;
  sim::HandE gripper{clock};

  void setup() override {
    clock.advance(1s);
  }

  void write(const Bytes& request) {
    clock.advance(10ms);
    CHECK_TRUE(static_cast<holdfast::hal::Serial&>(gripper).write(request));
  }
  Bytes heard() {
    Bytes bytes(1024);
    bytes.resize(static_cast<holdfast::hal::Serial&>(gripper).read(bytes));
    return bytes;
  }
  Bytes ask(const Bytes& request) {
    write(request);
    clock.advance(4ms);
    return heard();
  }
  Bytes ask(std::string_view request) {
    return ask(hex(request));
  }
  std::uint8_t status(std::size_t byte) {
    return ask(kRead4).at(3 + byte);
  }
  void activate() {
    CHECK_TRUE(ask(kActivate) == hex(kAck));
    clock.advance(2s);
    CHECK_TRUE(ask("09 03 07D0 0001 85CF") == hex("09 03 02 3100 4C15"));
  }
};

TEST(SimHandE, AnswersAsTheManualSays) {
  CHECK_TRUE(ask(kClear) == hex(kAck));
  CHECK_TRUE(ask(kActivate) == hex(kAck));
  clock.advance(20ms);
  CHECK_TRUE(ask("09 03 07D0 0001 85CF") == hex("09 03 02 1100 55D5"));
  CHECK_TRUE(ask("09 04 07D0 0001 300F") == hex("09 04 02 1100 54A1"));
  clock.advance(1500ms);
  CHECK_TRUE(ask("09 03 07D0 0001 85CF") == hex("09 03 02 3100 4C15"));
  CHECK_TRUE(ask("09 04 07D0 0001 300F") == hex("09 04 02 3100 4D61"));

  gripper.put_object({.width_mm = 9.447});
  clock.advance_to(4990ms);  // write() advances to a renewal
  CHECK_TRUE(ask(go(255, 0, 255)) == hex(kAck));
  CHECK_TRUE(ask(kRead3) == hex("09 03 06 3900 00FF 0E0A F78B"));
  clock.advance(4s);
  CHECK_TRUE(ask(kRead3) != hex("09 03 06 B900 00FF BD00 1D7C"));  // 4 s of silence: gFLT 9
  CHECK_TRUE(ask(kCloseFully) == hex(kAck));
  clock.advance(20ms);
  CHECK_TRUE(ask(kRead3) == hex("09 03 06 B900 00FF BD00 1D7C"));
  gripper.remove_object();
  CHECK_TRUE(ask(kOpenFully) == hex(kAck));
  clock.advance(900ms);
  CHECK_TRUE(ask(kRead4) == hex("09 04 06 F900 0000 0D00 17AA"));
  CHECK_TRUE(ask(kRead3) == hex("09 03 06 F900 0000 0D00 564C"));
}

TEST(SimHandE, IsSilentAboutWhatItDoesNotLike) {
  const Bytes silent[] = {
      hex("09 04 07D0 0003 B1CF"),       // CRC
      hex("09 04 07D0 0003"),            // cut
      hex("09"),                         //
      with_crc(hex("08 04 07D0 0003")),  // another slave
      with_crc(hex("09 06 03E8 0001")),  // another function
      with_crc(hex("09 04 07D0 0009")),  // beyond the registers
      with_crc(hex("09 04 07CF 0001")),  //
      with_crc(hex("09 04 07D0 0000")),  //
      with_crc(hex("09 10 03E8 0009 12 0100 0000 0000 0000 0000 0000 0000 0000 0000")),
      with_crc(hex("09 10 03E8 0003 04 0100 0000")),  // counts that differ
  };
  for (const Bytes& request : silent) CHECK_TRUE(ask(request).empty());
  LONGS_EQUAL(0, gripper.output(0));
  LONGS_EQUAL(3, gripper.damaged());
  write(hex(kActivate));
  clock.advance(4999us);
  CHECK_TRUE(static_cast<holdfast::hal::Serial&>(gripper).write(hex(kClear)));  // too soon: not heard
  LONGS_EQUAL(1, gripper.output(0));
  LONGS_EQUAL(4999, gripper.shortest_gap().count());
}

TEST(SimHandE, RepliesComeByteByByteAfterTheirTimeOnTheWire) {
  write(hex(kActivate));
  clock.advance(15 * 87us + 1ms + 86us);
  CHECK_TRUE(heard().empty());
  for (const std::uint8_t byte : hex(kAck)) {
    clock.advance(87us);
    const Bytes got = heard();
    LONGS_EQUAL(1, got.size());
    LONGS_EQUAL(byte, got[0]);
  }
}

TEST(SimHandE, SpeedFollowsItsRegister) {
  for (const auto& [speed, time] : {std::pair(0U, 2500ms), std::pair(255U, 334ms)}) {
    sim::HandE other(clock);
    other.start_active(0, 0, 0);
    Bytes request = go(255, speed, 0);
    CHECK_TRUE(static_cast<holdfast::hal::Serial&>(other).write(request));
    clock.advance(time - 5ms);
    CHECK_TRUE(other.width_mm() > 0);
    clock.advance(5ms);
    DOUBLES_EQUAL(0, other.width_mm(), 1e-9);
  }
}

TEST(SimHandE, ForceFollowsItsRegisterAndTheObjectYields) {
  activate();
  gripper.put_object({.width_mm = 20, .stiffness_n_mm = 10});
  for (const unsigned force : {0U, 100U, 255U, 30U}) {
    (void)ask(go(255, 255, force));
    clock.advance(900ms);
    const double newtons = 20 + 165.0 * force / 255;
    DOUBLES_EQUAL(newtons, gripper.force_n(), 1e-6);
    DOUBLES_EQUAL(20 - newtons / 10, gripper.width_mm(), 1e-6);
    LONGS_EQUAL(2, status(0) >> 6);
  }
  gripper.remove_object();
  DOUBLES_EQUAL(0, gripper.force_n(), 0);
  clock.advance(30ms);
  LONGS_EQUAL(0, status(0) >> 6);
  clock.advance(500ms);
  LONGS_EQUAL(3, status(0) >> 6);
  LONGS_EQUAL(0, gripper.drops());
}

TEST(SimHandE, OpeningDropsTheObjectAndSoDoesActivation) {
  activate();
  gripper.put_object({.width_mm = 20});
  (void)ask(kCloseFully);
  clock.advance(500ms);
  CHECK_TRUE(gripper.object_held());
  (void)ask(kClear);
  clock.advance(500ms);
  CHECK_TRUE(gripper.object_held());
  gripper.power_cycle();
  CHECK_TRUE(gripper.object_held());  // by the brake
  (void)ask(kActivate);
  clock.advance(500ms);
  CHECK_FALSE(gripper.object_held());
  LONGS_EQUAL(1, gripper.drops());
  LONGS_EQUAL(2, gripper.activations());
}

TEST(SimHandE, FaultsComeByThemselvesWhereTheyDoInLife) {
  (void)ask(kCloseFully);  // activates, and moves too early
  LONGS_EQUAL(5, gripper.fault());
  clock.advance(900ms);
  (void)status(2);
  clock.advance(900ms);
  LONGS_EQUAL(0, gripper.fault());
  clock.advance(999ms);
  LONGS_EQUAL(9, gripper.fault());
  (void)ask(with_crc(hex("09 10 03E8 0003 06 0800 00FF FFFF")));
  LONGS_EQUAL(7, gripper.fault());
  (void)ask(kActivate);
  LONGS_EQUAL(0, gripper.fault());
  clock.advance(2s);
  (void)ask(kClear);
  gripper.fail_activation(true);
  (void)ask(kActivate);
  clock.advance(900ms);
  LONGS_EQUAL(0xD, gripper.fault());
}

TEST(SimHandE, TroublesOfTheLineAreWhatTheirNamesSay) {
  activate();
  const Bytes good = ask(kRead4);
  const auto got = [&](LineTrouble kind) {
    gripper.trouble(kind, 1, 20ms);
    Bytes bytes = ask(kRead4);
    clock.advance(100ms);
    return bytes;
  };
  CHECK_TRUE(got(LineTrouble::kNone) == good);
  CHECK_TRUE(got(LineTrouble::kDeaf).empty());
  CHECK_TRUE(got(LineTrouble::kMute).empty());
  const Bytes wrong = got(LineTrouble::kWrongCrc);
  CHECK_TRUE(wrong != good && Bytes(wrong.begin(), wrong.end() - 2) == Bytes(good.begin(), good.end() - 2));
  LONGS_EQUAL(10, got(LineTrouble::kWrongSlave)[0]);
  LONGS_EQUAL(5, got(LineTrouble::kWrongFunction)[1]);
  CHECK_TRUE(got(LineTrouble::kTruncated).size() < good.size());
  CHECK_TRUE(got(LineTrouble::kGarbage) != good);
  CHECK_TRUE(got(LineTrouble::kNoiseBefore).size() == good.size() + 1);
  CHECK_TRUE(got(LineTrouble::kException) == with_crc({9, 0x84, 4}));
  CHECK_TRUE(got(LineTrouble::kLate).empty());
  CHECK_TRUE(heard() == good);
  gripper.trouble(LineTrouble::kDeaf, 3);
  int answers = 0;
  for (int i = 0; i < 300; ++i) answers += ask(kRead4).empty() ? 0 : 1;
  CHECK_TRUE(answers > 150 && answers < 250);
  gripper.unplug();
  CHECK_FALSE(static_cast<holdfast::hal::Serial&>(gripper).write(hex(kRead4)));
  CHECK_TRUE(heard().empty());
}
