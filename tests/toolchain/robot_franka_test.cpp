// SPDX-License-Identifier: Apache-2.0
// The example of a libfranka control loop, on a stub of libfranka (tests/robot/franka_stub), with frames of the
// firmware.
#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdint>

#include "link/status_frame.hpp"
#include "toolchain/robot/franka_lift.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
namespace sf = status_frame;

TEST_GROUP(RobotFranka) {
  static constexpr std::uint64_t kFrameMs = 40;
  std::array<int, 2> ends{};
  holdfast_receiver receiver{};
  holdfast_grip grip{};
  franka::Robot robot;
  sf::StatusFrame frame{.state = DeviceState::kOk, .grip_ok = true};
  std::uint64_t silent_from_ms = UINT64_MAX, slips_from_ms = UINT64_MAX;

  void setup() override {
    CHECK_EQUAL(0, ::pipe2(ends.data(), O_NONBLOCK));
    robot.before = [this](std::uint64_t now_ms) {
      if (now_ms % kFrameMs != 0 || now_ms >= silent_from_ms) return;
      frame.alive = !frame.alive;
      frame.grip_ok = now_ms < slips_from_ms;
      send();
    };
    // Two frames before: the grip is confirmed when the lift begins.
    send();
    (void)holdfast_poll(ends[0], receiver, grip, 0xFFFFFFFF - 40);
    frame.alive = !frame.alive;
    send();
    CHECK_TRUE(holdfast_poll(ends[0], receiver, grip, 0xFFFFFFFF));
  }
  void teardown() override {
    for (const int end : ends) ::close(end);
  }
  void send() {
    std::array<std::uint8_t, sf::kWireBytes> wire{};
    sf::encode(frame, wire);
    CHECK_EQUAL(static_cast<ssize_t>(wire.size()), ::write(ends[1], wire.data(), wire.size()));
  }
  bool lift(double seconds) {
    return holdfast_lift(robot, ends[0], receiver, grip, seconds);
  }
  double speed(std::size_t ms) {
    return robot.commands.at(ms)[2];
  }
  // The arm refuses steps: none is larger than 0.1 m/s^2 makes it in a millisecond.
  void check_smooth() {
    double before = 0.0;
    for (const auto& command : robot.commands) {
      CHECK_TRUE(std::abs(command[2] - before) < 0.1 * 0.001 + 1e-12);
      before = command[2];
    }
    DOUBLES_EQUAL(0.0, before, 1e-12);
  }
};

TEST(RobotFranka, LiftsAllTheWay) {
  CHECK_TRUE(lift(1.0));
  double metres = 0.0;
  for (const auto& command : robot.commands) metres += command[2] * 0.001;
  DOUBLES_EQUAL(0.02, metres, 0.0001);  // 20 mm/s for a second; the ramps up and down make up for each other
  check_smooth();
}

TEST(RobotFranka, SilenceStopsItAfter150Milliseconds) {
  silent_from_ms = 500;  // the last frame came at 480
  CHECK_FALSE(lift(10.0));
  DOUBLES_EQUAL(0.02, speed(629), 1e-12);
  CHECK_TRUE(speed(630) < 0.02);
  DOUBLES_EQUAL(0.0, speed(630 + 200), 1e-12);  // 20 mm/s at 100 mm/s^2
  check_smooth();
}

TEST(RobotFranka, ASlipStopsItAtOnceAndForGood) {
  slips_from_ms = 520;
  robot.before = [this, before = robot.before](std::uint64_t now_ms) {
    if (now_ms == 600) slips_from_ms = UINT64_MAX;  // the grip is fine again, but this lift has been given up
    before(now_ms);
  };
  CHECK_FALSE(lift(10.0));
  DOUBLES_EQUAL(0.02, speed(519), 1e-12);
  CHECK_TRUE(speed(520) < 0.02);
  const std::size_t steps = robot.commands.size() - 520;
  CHECK_TRUE(steps == 200 || steps == 201);  // 200 of 0.1 mm/s; one more where their sum is not 20 mm/s to the last bit
  check_smooth();
}
