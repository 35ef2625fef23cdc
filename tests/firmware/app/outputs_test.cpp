// SPDX-License-Identifier: Apache-2.0
#include "app/outputs.hpp"

#include "app/watchdog.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using hal::Level;
using hal::Line;

}  // namespace

TEST_GROUP(Outputs) {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  OutputWatchdog watchdog;
  outputs::State state;
  Reason update(bool grip_ok, bool accepted) {
    return outputs::update(state, {}, gpio, clock, watchdog,
                           {.grip_ok = grip_ok, .accepted = accepted, .timestamp = clock.now()});
  }
  void setup() override {
    CHECK_TRUE(outputs::start(state, gpio));
  }
};

// Whoever asks for it has a mistake: a HIGH needs an edge of ALIVE of its own frame.
TEST(Outputs, NeverRiseWithoutAnAcceptedFrame) {
  CHECK_TRUE(update(true, false) == Reason::kGpioFailed);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
  LONGS_EQUAL(0, gpio.edges(Line::kAlive));
}

TEST(Outputs, StayHighWhileAFrameIsMissing) {
  CHECK_TRUE(update(true, true) == Reason::kNone);
  CHECK_TRUE(update(true, false) == Reason::kNone);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  LONGS_EQUAL(1, gpio.edges(Line::kAlive));
}
