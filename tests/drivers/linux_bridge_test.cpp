// SPDX-License-Identifier: Apache-2.0
// The MCP2221A as GPIO lines, on a model of the chip: what a voltmeter at its pins would show.
#include <algorithm>
#include <atomic>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "drivers/linux/bridge_mcp2221.hpp"
#include "tests/support/mcp2221_model.hpp"
// last: it redefines new
#include "tests/support/allocations.hpp"
#include "tests/support/error_line.hpp"

using namespace holdfast;
using test::check_says;
using namespace std::chrono_literals;
using drivers::Mcp2221Gpio;
using drivers::Wiring;
using hal::Input;
using hal::Level;
using hal::Line;
using test::Mcp2221Model;

namespace {

constexpr std::size_t kGrip = 0, kAlive = 1, kTare = 3;

// By name, and by label and offset, as a row for the kernel's own driver has it.
std::vector<Wiring> table(bool active_low = false) {
  return {{.role = Line::kGripOk, .line = "GP0", .chip = {}, .active_low = active_low},
          {.role = Line::kAlive, .line = {}, .chip = "mcp2221_gpio", .offset = 1, .active_low = active_low},
          {.role = Input::kTare, .line = "GP3", .chip = {}, .active_low = active_low}};
}

// The report with this number (from 1), out or in, fails as the system lets it: not sent, none came, or the device is
// gone.
class Failing final : public drivers::HidPort {
 public:
  enum class How { kNotSent, kNothing, kGone };
  explicit Failing(drivers::HidPort& inside) : inside_(inside) {}
  int asked = 0, fails_at = 0;
  How how = How::kNotSent;

 private:
  [[nodiscard]] bool do_send(const Report& report) override {
    return (++asked != fails_at || how == How::kNothing) && inside_.send(report);
  }
  [[nodiscard]] Got do_receive(Report& report, std::chrono::milliseconds at_most) override {
    if (++asked != fails_at || how == How::kNotSent) return inside_.receive(report, at_most);
    return how == How::kGone ? Got::kGone : Got::kNothing;
  }
  drivers::HidPort& inside_;
};

}  // namespace

TEST_GROUP(LinuxBridge) {
  Mcp2221Model chip;
  Mcp2221Gpio gpio{chip};

  std::string open(const std::vector<Wiring>& wiring) {
    return gpio.open({.wiring = wiring, .patience = 20ms});
  }
  void open_well(bool active_low = false) {
    STRCMP_EQUAL("", open(table(active_low)).c_str());
  }
};

TEST(LinuxBridge, PinsBecomeLinesWithoutShowingAnythingElse) {
  for (const bool active_low : {false, true}) {
    Mcp2221Model fresh;
    for (Mcp2221Model::Pin& pin : fresh.pins) pin.latch = true;  // as somebody left it
    Mcp2221Gpio on(fresh);
    const std::vector<Wiring> wiring = table(active_low);
    STRCMP_EQUAL("", on.open({.wiring = wiring}).c_str());
    for (const std::size_t pin : {kGrip, kAlive}) {
      CHECK_TRUE(fresh.pins[pin].use == 0 && !fresh.pins[pin].input);
      CHECK_TRUE((fresh.pins[pin].shown == std::vector<bool>{active_low}));
    }
    CHECK_TRUE(fresh.pins[kTare].use == 0 && fresh.pins[kTare].input);
    LONGS_EQUAL(1, fresh.pins[2].use);  // GP2 is nobody's, and stays what it was
    CHECK_TRUE(fresh.pins[2].latch);
  }
}

TEST(LinuxBridge, PolarityIsAppliedOnceInBothDirections) {
  for (const bool active_low : {false, true}) {
    open_well(active_low);
    for (const Level level : {Level::kHigh, Level::kLow, Level::kHigh, Level::kHigh, Level::kLow}) {
      CHECK_TRUE(gpio.set(Line::kGripOk, level));
      CHECK_EQUAL((level == Level::kHigh) != active_low, chip.wire(kGrip));
      CHECK_EQUAL(active_low, chip.wire(kAlive));
    }
    for (const bool high : {true, false, true}) {
      chip.pins[kTare].outside = high;
      CHECK_TRUE(gpio.read(Input::kTare) == (high != active_low ? Level::kHigh : Level::kLow));
    }
  }
}

TEST(LinuxBridge, WhatAPinDoesNotShowIsToldEachTime) {
  open_well();
  chip.pins[kGrip].stuck = true;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kLow));
  chip.pins[kGrip].stuck = false;
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  chip.pins[kAlive].input = true;  // another program turned it round: it shows LOW, and drives nothing
  CHECK_FALSE(gpio.set(Line::kAlive, Level::kLow));
  chip.pins[kAlive].input = false;
  chip.pins[kGrip].use = 1;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  chip.pins[kTare].use = 2;
  CHECK_FALSE(gpio.read(Input::kTare).has_value());
}

TEST(LinuxBridge, ADesksTableFits) {
  STRCMP_EQUAL("", gpio.open({.wiring = drivers::kMcp2221Desk}).c_str());
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh) && chip.wire(kGrip));
  CHECK_TRUE(gpio.set(Line::kAlive, Level::kHigh) && chip.wire(kAlive));
  chip.pins[kTare].outside = true;
  CHECK_TRUE(gpio.read(Input::kTare) == Level::kHigh);
}

TEST(LinuxBridge, ALineWithoutAPinTakesNothing) {
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));  // not opened yet
  open_well();
  CHECK_FALSE(gpio.set(Line::kIncrease, Level::kLow));
  CHECK_FALSE(gpio.read(Input::kArm).has_value());
}

TEST(LinuxBridge, AnAnswerBelongsToItsCommand) {
  open_well();
  // Late: the command counts as failed; its answer comes before the next one's and must not be taken for it.
  chip.late = 1;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kLow));
  CHECK_FALSE(chip.wire(kGrip));
  chip.pins[kTare].outside = true;
  CHECK_TRUE(gpio.read(Input::kTare) == Level::kHigh);
  // The same with two answers of one command, the older of which shows another level.
  chip.late = 1;
  CHECK_FALSE(gpio.read(Input::kTare).has_value());
  chip.pins[kTare].outside = false;
  CHECK_TRUE(gpio.read(Input::kTare) == Level::kLow);
  // And with what another program asked for, before or in between.
  chip.foreign = 1;
  CHECK_TRUE(gpio.read(Input::kTare) == Level::kLow);
  chip.foreign = 2;
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  for (int i = 0; i < 3; ++i) chip.inject({0x10, 0x00});
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  for (int i = 0; i < 100; ++i) chip.inject({0x10, 0x00});  // a flood is not waited for
  const int before = chip.commands;
  (void)gpio.set(Line::kGripOk, Level::kLow);
  CHECK_TRUE(chip.commands <= before + 2);
}

TEST(LinuxBridge, SilenceAndRefusalsPassAnUnpluggedChipDoesNot) {
  open_well();
  chip.silent = 1;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  chip.refusing = 1;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  chip.refusing = 1;
  CHECK_FALSE(gpio.read(Input::kTare).has_value());
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_TRUE(chip.asked_to_wait <= 20ms);
  chip.gone = true;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  chip.gone = false;  // plugged in again: its pins are the factory's
  const int before = chip.commands;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  CHECK_FALSE(gpio.read(Input::kTare).has_value());
  LONGS_EQUAL(before, chip.commands);
  open_well();
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
}

TEST(LinuxBridge, WhatCannotBeSetUpIsToldAndLeftAlone) {
  chip.silent = 1;
  check_says(open(table()), {"MCP2221A: no answer", "another program"});
  chip.refusing = 1;
  check_says(open(table()), {"MCP2221A: no answer"});
  chip.pins[kAlive].stuck = chip.pins[kAlive].outside = true;
  check_says(open(table()), {"GP1 was made an output and told LOW", "shorted"});
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  chip.pins[kAlive].stuck = false;
  std::vector<Wiring> wiring = table();
  wiring[2].line = "GP4";
  check_says(open(wiring), {"TARE", "no such line", "nearest names: 'GP0'"});
  wiring[2] = {.role = Line::kAlive, .line = "GP2", .chip = {}};
  check_says(open(wiring), {"ALIVE has two rows"});
  chip.gone = true;
  check_says(open(table()), {"no answer"});
}

TEST(LinuxBridge, AnEndLeavesEveryOutputLow) {
  for (const bool active_low : {false, true}) {
    open_well(active_low);
    CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh) && gpio.set(Line::kAlive, Level::kHigh));
    gpio.close();
    CHECK_EQUAL(active_low, chip.wire(kGrip));
    CHECK_EQUAL(active_low, chip.wire(kAlive));
    CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  }
}

TEST(LinuxBridge, TwoThreadsDoNotTakeEachOthersAnswers) {
  const std::vector<Wiring> wiring = table();
  STRCMP_EQUAL("", gpio.open({.wiring = wiring, .patience = 10s}).c_str());  // the machine may be busy
  std::atomic<int> refused{0};
  std::atomic<bool> begin{false};
  const auto work = [&](Line line) {
    while (!begin.load()) std::this_thread::yield();
    for (int i = 0; i < 2000; ++i) {
      if (!gpio.set(line, i % 2 == 0 ? Level::kHigh : Level::kLow)) ++refused;
    }
  };
  std::thread a(work, Line::kGripOk);
  std::thread b(work, Line::kAlive);
  begin = true;
  a.join();
  b.join();
  LONGS_EQUAL(0, refused.load());
  LONGS_EQUAL(0, chip.overlaps);
  LONGS_EQUAL(2001, chip.pins[kGrip].shown.size());
  LONGS_EQUAL(2001, chip.pins[kAlive].shown.size());
}

TEST(LinuxBridge, AThreadThatHangsInTheKernelHoldsTheOtherOneOffForAWhileOnly) {
  const std::vector<Wiring> wiring = table();
  STRCMP_EQUAL("", gpio.open({.wiring = wiring, .patience = 1ms}).c_str());
  chip.hangs = true;
  std::thread hanging([&] { (void)gpio.set(Line::kAlive, Level::kHigh); });
  while (!chip.hanging) std::this_thread::yield();
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));  // it comes back, and says that nothing was done
  CHECK_FALSE(gpio.read(Input::kTare).has_value());
  chip.hangs = false;
  hanging.join();
  STRCMP_EQUAL("", gpio.open({.wiring = wiring, .patience = 10s}).c_str());
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
}

TEST(LinuxBridge, AfterTheStartTheDriverTakesNoHeap) {
  // The model takes some for its queues: as much with the driver as without.
  open_well();
  const auto cost_of = [&](auto&& action) {
    const unsigned before = test::allocations();
    for (int i = 0; i < 1000; ++i) action();
    return test::allocations() - before;
  };
  const unsigned asked = cost_of([&] { (void)gpio.read(Input::kTare); });
  const unsigned alone = cost_of([&] {
    drivers::HidPort::Report report{0x51};
    (void)chip.send(report);
    (void)chip.receive(report, 0ms);
  });
  const unsigned told = cost_of([&] { (void)gpio.set(Line::kGripOk, Level::kHigh); });
  CHECK_TRUE(asked <= alone + 2);
  CHECK_TRUE(told <= 2 * alone + 20);  // two reports, and the model's list of levels
  CHECK_TRUE(alone < 1000);            // so one allocation a call would show
}

// Each report fails once: what a pin does not do is told, and it goes on - or, with a device that is gone, takes
// nothing more until it is opened again.
TEST(LinuxBridge, WhicheverReportFailsNothingIsTakenForDone) {
  Failing port(chip);
  Mcp2221Gpio through(port);
  const std::vector<Wiring> wiring = table();
  int most = 0;
  for (const Failing::How how : {Failing::How::kNotSent, Failing::How::kNothing, Failing::How::kGone}) {
    bool all = false;
    for (int at = 1; !all; ++at) {
      port.asked = 0, port.fails_at = at, port.how = how;
      chip.pins[kTare].outside = true;
      if (const std::string said = through.open({.wiring = wiring, .patience = 20ms}); !said.empty()) {
        check_says(said, {"MCP2221A: "});
        CHECK_FALSE(through.set(Line::kGripOk, Level::kLow));
        STRCMP_EQUAL("", through.open({.wiring = wiring, .patience = 20ms}).c_str());
      }
      int refused = 0;
      for (const Level level : {Level::kHigh, Level::kLow, Level::kHigh}) {
        const bool taken = through.set(Line::kGripOk, level);
        if (taken) CHECK_EQUAL(level == Level::kHigh, chip.wire(kGrip));
        const std::optional<Level> asked = through.read(Input::kTare);
        if (asked) CHECK_TRUE(*asked == Level::kHigh);
        refused += (taken ? 0 : 1) + (asked ? 0 : 1);
      }
      CHECK_TRUE(how == Failing::How::kNothing ? refused <= 1 : refused <= 6);
      all = port.asked < at;
      most = std::max(most, port.asked);
      if (how != Failing::How::kNothing) STRCMP_EQUAL("", through.open({.wiring = wiring, .patience = 20ms}).c_str());
      CHECK_TRUE(through.set(Line::kGripOk, Level::kHigh));
    }
  }
  CHECK_TRUE(most > 30);
}
