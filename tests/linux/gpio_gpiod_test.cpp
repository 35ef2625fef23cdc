// SPDX-License-Identifier: Apache-2.0
// The driver of GPIO chips on a kernel of the tests' own, through each of libgpiod's two interfaces. The oracle is the
// wire: what a voltmeter there would show.
#include <algorithm>
#include <cerrno>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/linux/gpio_gpiod.hpp"
#include "tests/linux/gpio_kernel.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include "tests/support/allocations.hpp"
#include "tests/support/error_line.hpp"

using namespace holdfast;
using drivers::GpiodGpio;
using drivers::Wiring;
using hal::Input;
using hal::Level;
using hal::Line;
using test::check_says;
using test::GpioKernel;
using test::Pull;
using test::Wire;

namespace {

constexpr std::size_t kGripPin = 17;
constexpr std::size_t kAlivePin = 27;
constexpr std::size_t kTarePin = 22;

std::vector<Wiring> table(bool active_low = false) {
  return {{.role = Line::kGripOk, .line = "GPIO17", .chip = {}, .active_low = active_low},
          {.role = Line::kAlive, .line = "GPIO27", .chip = {}, .active_low = active_low},
          {.role = Input::kTare, .line = "GPIO22", .chip = {}, .active_low = active_low}};
}

}  // namespace

TEST_GROUP(GpiodGpio) {
  test::TempDir dev;
  GpiodGpio gpio;

  void setup() override {
    GpioKernel::get() = {};
    add_chip("gpiochip1", "raspberrypi-exp-gpio", 8);
    test::Chip& chip = add_chip("gpiochip0", "pinctrl-bcm2711", 58);
    for (std::size_t i = 2; i < 28; ++i) chip.wires[i].name = "GPIO" + std::to_string(i);
  }
  void teardown() override {
    gpio.close();
    LONGS_EQUAL(0, GpioKernel::get().opened);
    GpioKernel::get() = {};
  }
  test::Chip& add_chip(const std::string& name, const std::string& label, std::size_t lines) {
    test::write_file(dev / name, "");
    test::Chip& chip = GpioKernel::get().chips[name];
    chip = {name, label, std::vector<Wire>(lines)};
    return chip;
  }
  static Wire& wire(std::size_t offset) {
    return GpioKernel::get().chips["gpiochip0"].wires[offset];
  }
  std::string open(const std::vector<Wiring>& wiring) {
    return gpio.open({.wiring = wiring, .consumer = "holdfastd", .devices = dev.path().string()});
  }
};

TEST(GpiodGpio, OutputsAreLowFromTheFirstMomentWhateverThePolarity) {
  for (const bool active_low : {false, true}) {
    wire(kGripPin).high = !active_low;  // what the pin showed before
    STRCMP_EQUAL("", open(table(active_low)).c_str());
    for (const std::size_t pin : {kGripPin, kAlivePin}) {
      CHECK_TRUE(wire(pin).output);
      CHECK_TRUE((wire(pin).levels == std::vector<bool>{active_low}));  // never, not even at first, anything else
    }
    CHECK_FALSE(wire(kTarePin).output);
    CHECK_TRUE(wire(kTarePin).levels.empty());
    gpio.close();
    wire(kGripPin).levels.clear();
    wire(kAlivePin).levels.clear();
  }
}

TEST(GpiodGpio, PolarityIsAppliedOnceInBothDirections) {
  for (const bool active_low : {false, true}) {
    STRCMP_EQUAL("", open(table(active_low)).c_str());
    for (const Level level : {Level::kHigh, Level::kLow, Level::kHigh, Level::kHigh, Level::kLow}) {
      CHECK_TRUE(gpio.set(Line::kGripOk, level));
      CHECK_EQUAL((level == Level::kHigh) != active_low, wire(kGripPin).high);
      CHECK_EQUAL(active_low, wire(kAlivePin).high);  // the other line stays
    }
    for (const bool high : {true, false, true}) {
      wire(kTarePin).high = high;
      CHECK_TRUE(gpio.read(Input::kTare) == (high != active_low ? Level::kHigh : Level::kLow));
    }
    gpio.close();
  }
}

TEST(GpiodGpio, AnInputWithNothingOnItsWireAsksForNothing) {
  STRCMP_EQUAL("", open(table(false)).c_str());
  CHECK_TRUE(wire(kTarePin).pull == Pull::kDown);
  CHECK_TRUE(wire(kGripPin).pull == Pull::kAsIs);
  STRCMP_EQUAL("", open(table(true)).c_str());  // 0 V asks: the resistor goes to the supply
  CHECK_TRUE(wire(kTarePin).pull == Pull::kUp);
}

TEST(GpiodGpio, AChipWithoutResistorsIsTakenWithout) {
  for (const int refusal : {EINVAL, ENOTSUP}) {
    wire(kTarePin).refuse_bias = refusal;
    STRCMP_EQUAL("", open(table()).c_str());
    CHECK_TRUE(wire(kTarePin).used && wire(kTarePin).pull == Pull::kAsIs);
  }
}

TEST(GpiodGpio, TheKernelKnowsWhoHoldsWhichLine) {
  STRCMP_EQUAL("", open(table()).c_str());
  STRCMP_EQUAL("holdfastd:GRIP_OK", wire(kGripPin).user.c_str());
  STRCMP_EQUAL("holdfastd:TARE", wire(kTarePin).user.c_str());
  GpiodGpio second;
  const std::vector<Wiring> wiring = table();
  check_says(second.open({.wiring = wiring, .consumer = "other", .devices = dev.path().string()}),
             {"GRIP_OK: line 'GPIO17'", "is used by 'holdfastd:GRIP_OK'"});
}

TEST(GpiodGpio, WhatTheWireDoesNotTakeIsToldEachTime) {
  STRCMP_EQUAL("", open(table()).c_str());
  wire(kGripPin).stuck = true;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kLow));
  wire(kGripPin).stuck = false;
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  wire(kGripPin).refuse_io = ENODEV;  // the chip is gone
  wire(kTarePin).refuse_io = ENODEV;
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  CHECK_FALSE(gpio.read(Input::kTare).has_value());
  wire(kGripPin).refuse_io = 0;
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kLow));
}

TEST(GpiodGpio, ALineWithoutAWireTakesNothing) {
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));  // not opened yet
  STRCMP_EQUAL("", open(table()).c_str());
  CHECK_FALSE(gpio.set(Line::kIncrease, Level::kLow));
  CHECK_FALSE(gpio.read(Input::kArm).has_value());
}

TEST(GpiodGpio, AnEndLeavesEveryOutputLowAndEveryLineFree) {
  for (const bool active_low : {false, true}) {
    STRCMP_EQUAL("", open(table(active_low)).c_str());
    CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh) && gpio.set(Line::kAlive, Level::kHigh));
    gpio.close();
    CHECK_EQUAL(active_low, wire(kGripPin).high);
    CHECK_EQUAL(active_low, wire(kAlivePin).high);
    for (const std::size_t pin : {kGripPin, kAlivePin, kTarePin}) CHECK_FALSE(wire(pin).used);
    CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  }
}

TEST(GpiodGpio, AllLinesOrNone) {
  wire(kTarePin).refuse = EIO;
  check_says(open(table()), {"TARE: line 22 of gpiochip0 (pinctrl-bcm2711)", "the kernel refused it", "gpioinfo"});
  for (const std::size_t pin : {kGripPin, kAlivePin, kTarePin}) CHECK_FALSE(wire(pin).used);
  LONGS_EQUAL(0, GpioKernel::get().opened);

  wire(kAlivePin).refuse = EBUSY;  // taken after the look
  check_says(open(table()), {"ALIVE: line 27", "taken by another process"});
  CHECK_FALSE(wire(kGripPin).used);

  wire(kAlivePin).stuck = wire(kAlivePin).high = true;
  check_says(open(table()), {"ALIVE: told LOW, and does not read LOW", "shorted"});
  CHECK_FALSE(wire(kGripPin).used);
  wire(kAlivePin).stuck = false;
  STRCMP_EQUAL("", open(table()).c_str());
}

// Left behind by a process that was killed: HIGH on the wire, and nobody's.
TEST(GpiodGpio, TheLinesOfAProcessThatIsGoneAreLowered) {
  for (const bool active_low : {false, true}) {
    const std::vector<Wiring> wiring = table(active_low);
    for (const std::size_t pin : {kGripPin, kAlivePin, kTarePin}) {
      wire(pin).high = !active_low;
      wire(pin).levels.clear();
    }
    const GpiodGpio::Lowered lowered = GpiodGpio::lower({.wiring = wiring, .devices = dev.path().string()});
    STRCMP_EQUAL("", lowered.problems.c_str());
    CHECK_TRUE(lowered.all);
    for (const std::size_t pin : {kGripPin, kAlivePin}) {
      CHECK_TRUE((wire(pin).levels == std::vector<bool>{active_low}));
      CHECK_FALSE(wire(pin).used);
    }
    CHECK_EQUAL(!active_low, wire(kTarePin).high);
    LONGS_EQUAL(0, GpioKernel::get().opened);
  }
}

TEST(GpiodGpio, LinesOfAProcessThatLivesAreNotLowered) {
  STRCMP_EQUAL("", open(table()).c_str());
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  const std::vector<Wiring> wiring = table();
  const GpiodGpio::Config config{.wiring = wiring, .devices = dev.path().string()};
  GpiodGpio::Lowered lowered = GpiodGpio::lower(config);
  CHECK_TRUE(lowered.all);  // of those that are nobody's: none
  STRCMP_CONTAINS("GRIP_OK: line 'GPIO17'", lowered.problems.c_str());
  STRCMP_CONTAINS("is used by 'holdfastd:ALIVE'", lowered.problems.c_str());
  CHECK_TRUE(wire(kGripPin).high && wire(kGripPin).used);
  gpio.close();

  wire(kGripPin).refuse = EBUSY;  // taken after the look
  wire(kAlivePin).high = true;
  lowered = GpiodGpio::lower(config);
  CHECK_TRUE(lowered.all);
  CHECK_FALSE(wire(kAlivePin).high);  // one that is refused keeps none of the others
}

TEST(GpiodGpio, ALineThatCannotBeLoweredIsTold) {
  const std::vector<Wiring> wiring = table();
  const GpiodGpio::Config config{.wiring = wiring, .devices = dev.path().string()};
  wire(kGripPin).stuck = wire(kGripPin).high = true;
  wire(kAlivePin).high = true;
  GpiodGpio::Lowered lowered = GpiodGpio::lower(config);
  CHECK_FALSE(lowered.all);
  check_says(lowered.problems.substr(0, lowered.problems.find('\n')), {"GRIP_OK: told LOW, and does not read LOW"});
  CHECK_FALSE(wire(kAlivePin).high);
  wire(kGripPin).stuck = false;
  wire(kGripPin).refuse = EIO;
  CHECK_FALSE(GpiodGpio::lower(config).all);
  lowered = GpiodGpio::lower({.wiring = wiring, .devices = "/nonexistent"});
  CHECK_FALSE(lowered.all);
  STRCMP_CONTAINS("no GPIO chip", lowered.problems.c_str());
}

TEST(GpiodGpio, WhatMayNotBeOpenedIsToldWithTheGroup) {
  GpioKernel::get().unopenable["gpiochip0"] = EACCES;
  check_says(open(table()), {"gpiochip0: Permission denied", "group gpio", "usermod -aG gpio", "GPIO17"});
  // A chip that is not wanted does not matter.
  GpioKernel::get().unopenable = {{"gpiochip1", EACCES}};
  STRCMP_EQUAL("", open(table()).c_str());
}

TEST(GpiodGpio, TablesThatCannotBeRightAreRefused) {
  std::vector<Wiring> wiring = table();
  wiring[1].line = "GPIO17";
  check_says(open(wiring), {"ALIVE", "the same line as GRIP_OK"});
  wiring[1] = {.role = Line::kGripOk, .line = "GPIO5", .chip = {}};
  check_says(open(wiring), {"GRIP_OK: two rows of the table"});
  LONGS_EQUAL(0, GpioKernel::get().opened);
  check_says(gpio.open({.wiring = wiring, .consumer = "x", .devices = "/nonexistent"}), {"no GPIO chip"});
}

TEST(GpiodGpio, NothingIsOpenedAndNoHeapTakenAfterTheStart) {
  STRCMP_EQUAL("", open(table()).c_str());
  wire(kGripPin).levels.reserve(1000);
  const unsigned allocations = test::allocations();
  const int calls = GpioKernel::get().calls;
  const std::size_t levels = wire(kGripPin).levels.size();
  for (int i = 0; i < 100; ++i) {
    CHECK_TRUE(gpio.set(Line::kGripOk, i % 2 == 0 ? Level::kHigh : Level::kLow));
    CHECK_TRUE(gpio.read(Input::kTare).has_value());
  }
  LONGS_EQUAL(allocations, test::allocations());
  LONGS_EQUAL(calls, GpioKernel::get().calls);
  LONGS_EQUAL(levels + 100, wire(kGripPin).levels.size());  // one write each
}

// Each call of libgpiod fails once: what is not done is told, nothing is held by halves, and the next one works.
TEST(GpiodGpio, WhicheverCallFailsNothingIsTakenForDone) {
  GpioKernel& kernel = GpioKernel::get();
  int most = 0;
  for (const int error : {EIO, ENODEV, ENOMEM, EBUSY, EINVAL}) {
    bool all = false;
    for (int at = 1; !all; ++at) {
      kernel.asked = 0, kernel.fails_at = at, kernel.error = error;
      wire(kTarePin).high = true;
      std::string said = open(table());
      if (!said.empty()) {
        check_says(said, {});
        LONGS_EQUAL(0, kernel.opened);
        for (const std::size_t pin : {kGripPin, kAlivePin, kTarePin}) CHECK_FALSE(wire(pin).used);
        CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
        STRCMP_EQUAL("", open(table()).c_str());
      }
      int refused = 0;
      for (const Level level : {Level::kHigh, Level::kLow, Level::kHigh}) {
        const bool taken = gpio.set(Line::kGripOk, level);
        if (taken) CHECK_EQUAL(level == Level::kHigh, wire(kGripPin).high);
        const std::optional<Level> asked = gpio.read(Input::kTare);
        if (asked) CHECK_TRUE(*asked == Level::kHigh);
        refused += (taken ? 0 : 1) + (asked ? 0 : 1);
      }
      CHECK_TRUE(refused <= 1);
      all = kernel.asked < at;
      most = std::max(most, kernel.asked);
      gpio.close();
      LONGS_EQUAL(0, kernel.opened);
    }
  }
  CHECK_TRUE(most > 60);
}
