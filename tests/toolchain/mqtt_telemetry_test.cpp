// SPDX-License-Identifier: Apache-2.0
// What a fleet is told, from frames of the firmware, in virtual time. With a broker: tests/python/test_mqtt.py.
#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "link/status_frame.hpp"
#include "toolchain/console/backlog.hpp"
#include "toolchain/mqtt/telemetry.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
namespace sf = status_frame;
using nlohmann::json;

TEST_GROUP(MqttTelemetry) {
  std::vector<json> changes;
  fleet::Telemetry telemetry{[this](const std::string& text) { changes.push_back(json::parse(text)); }};
  fleet::Now now{.steady_ms = 0xFFFFFF00, .unix_ms = 1'764'131'696'007};  // 32 bits come round in between
  sf::StatusFrame frame{.sequence = 65'530, .state = DeviceState::kOk, .grip_ok = true};

  void pass(std::uint64_t ms) {
    now.steady_ms += ms;
    now.unix_ms += static_cast<std::int64_t>(ms);
    telemetry.tick(now);
  }
  void hear(int step = 1, bool old = false) {
    frame.sequence = static_cast<std::uint16_t>(frame.sequence + step);
    frame.alive = !frame.alive;
    std::array<std::uint8_t, sf::kWireBytes> wire{};
    sf::encode(frame, wire);
    telemetry.hear(wire, now, old);
  }
  json counters() {
    return json::parse(telemetry.counters(now, 3, 4));
  }
};

TEST(MqttTelemetry, TellsChangesAlone) {
  telemetry.tick(now);
  LONGS_EQUAL(0, changes.size());
  for (int k = 0; k < 100; ++k) hear(), pass(40);
  LONGS_EQUAL(2, changes.size());  // heard; then ALIVE changed, and the grip is confirmed
  CHECK_TRUE(changes[0]["heard"] == 1 && changes[0]["confirmed"] == 0 && changes[0]["state"] == "OK");
  CHECK_TRUE(changes[1]["confirmed"] == 1 && changes[1]["state_number"] == 2 && changes[1]["reason"] == "none");
  STRCMP_EQUAL("2025-11-26T04:34:56.007Z", changes[0]["time"].get<std::string>().c_str());  // `date -u -d @1764131696`
  frame.state = DeviceState::kSlip, frame.reason = Reason::kSlipDetected, frame.slip = true, frame.grip_ok = false;
  hear();
  LONGS_EQUAL(3, changes.size());
  CHECK_TRUE(changes[2]["reason"] == "slip" && changes[2]["reason_number"] == 98 && changes[2]["slip"] == 1);
  CHECK_TRUE(changes[2]["confirmed"] == 0);
  CHECK_TRUE(counters()["slips"] == 1 && counters()["frames"] == 101 && counters()["changes"] == 3);
}

// The publisher stood still, and reads what waited: it is counted, and is no word of a board of now.
TEST(MqttTelemetry, WhatHasWaitedConfirmsNothing) {
  for (int k = 0; k < 5; ++k) hear(), pass(40);
  pass(8000);
  CHECK_TRUE(changes.back()["confirmed"] == 0 && changes.back()["heard"] == 0);
  frame.state = DeviceState::kSlip, frame.reason = Reason::kSlipDetected, frame.slip = true;
  for (int k = 0; k < 100; ++k) hear(1, true);
  CHECK_TRUE(changes.back()["confirmed"] == 0 && changes.back()["heard"] == 0 && changes.back()["slip"] == 1);
  frame = {.sequence = frame.sequence, .state = DeviceState::kOk, .grip_ok = true};
  for (int k = 0; k < 100; ++k) hear(1, true);
  CHECK_TRUE(changes.back()["confirmed"] == 0 && changes.back()["heard"] == 0);
  hear(), pass(40), hear();
  CHECK_TRUE(changes.back()["confirmed"] == 1 && changes.back()["heard"] == 1);
  CHECK_TRUE(counters()["frames"] == 207 && counters()["lost"] == 0 && counters()["slips"] == 1);
}

// Stopped for 150 ms and more: old until the port is silent once.
TEST(MqttTelemetry, APortIsOldFromAPauseToItsFirstSilence) {
  console_tool::Backlog backlog;
  std::uint64_t at = 1'000'000;
  const auto turn = [&](std::uint64_t after_ms, bool readable) { return backlog.is_old(readable, at += after_ms); };
  CHECK_FALSE(turn(0, true));
  CHECK_FALSE(turn(150, true));
  CHECK_TRUE(turn(151, true));
  for (int k = 0; k < 10; ++k) CHECK_TRUE(turn(1, true));
  CHECK_FALSE(turn(5, false));
  CHECK_FALSE(turn(5, true));
  CHECK_TRUE(turn(8000, false));  // what comes with the next turn may have waited as well
  CHECK_FALSE(turn(5, false));
}

TEST(MqttTelemetry, SilenceIsToldByTheRuleAndAfterASecond) {
  hear(), pass(40), hear();
  pass(149);
  LONGS_EQUAL(1, changes.back()["confirmed"].get<int>());
  pass(1);
  LONGS_EQUAL(0, changes.back()["confirmed"].get<int>());
  pass(849);
  LONGS_EQUAL(1, changes.back()["heard"].get<int>());
  pass(1);
  CHECK_TRUE(changes.back()["heard"] == 0 && changes.back()["state"] == "OK");  // the last that was heard
  LONGS_EQUAL(1, counters()["silences"].get<int>());
  hear();
  LONGS_EQUAL(1, changes.back()["heard"].get<int>());
}

TEST(MqttTelemetry, CountsWhatWasLostDamagedOrBeganAnew) {
  hear();
  hear(8);  // through the wrap
  CHECK_TRUE(counters()["lost"] == 7 && counters()["restarts"] == 0);
  hear(-100);
  CHECK_TRUE(counters()["lost"] == 7 && counters()["restarts"] == 1);
  std::array<std::uint8_t, sf::kWireBytes> wire{};
  sf::encode(frame, wire);
  wire[20] ^= 0x10;
  telemetry.hear(wire, now);
  CHECK_TRUE(counters()["damaged"] == 1 && counters()["frames"] == 3);
  CHECK_TRUE(counters()["dropped"] == 3 && counters()["connects"] == 4);
  frame.state = DeviceState::kFault, frame.reason = Reason::kNoFrame;
  hear(), hear();
  LONGS_EQUAL(1, counters()["faults"].get<int>());
}
