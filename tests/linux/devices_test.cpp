// SPDX-License-Identifier: Apache-2.0
// Drivers with their real libraries, on a machine that has none of the devices: what they say then. With devices they
// are tested in the emulated machine.
#include <filesystem>
#include <string>
#include <string_view>

#include "drivers/linux/bridge_mcp2221.hpp"
#include "drivers/linux/gpio_gpiod.hpp"
#include "drivers/linux/hid_hidapi.hpp"
#include "tests/support/skip.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>
// after it: its checks
#include "tests/support/error_line.hpp"

using namespace holdfast;
using drivers::Wiring;
using test::check_says;

namespace {

constexpr Wiring kGrip{.role = hal::Line::kGripOk, .line = "GPIO17", .chip = {}};

}  // namespace

TEST_GROUP(LinuxDevices){};

TEST(LinuxDevices, WithoutAChipTheTableCannotBeWired) {
  if (std::filesystem::exists("/dev/gpiochip0")) {
    test::skip("this machine has a GPIO chip");
    return;
  }
  drivers::GpiodGpio gpio;
  check_says(gpio.open({.wiring = {&kGrip, 1}}), {"GRIP_OK: line 'GPIO17'", "no GPIO chip"});
  CHECK_FALSE(gpio.set(hal::Line::kGripOk, hal::Level::kLow));
  CHECK_FALSE(gpio.read(hal::Input::kArm).has_value());
}

TEST(LinuxDevices, AFileThatIsNoChipIsToldAsSuch) {
  test::TempDir dir;
  test::write_file(dir / "gpiochip0", "not a chip");
  drivers::GpiodGpio gpio;
  check_says(gpio.open({.wiring = {&kGrip, 1}, .devices = dir.path().string()}),
             {"gpiochip0: ", "GRIP_OK", "this device file is no GPIO chip"});
}

TEST(LinuxDevices, WithoutABridgeThereIsNone) {
  drivers::HidapiPort port;
  const std::string error = port.open(drivers::kMcp2221Vendor, drivers::kMcp2221Product, "");
  if (error.empty()) {
    test::skip("this machine has an MCP2221A");
    return;
  }
  check_says(error, {"HID device 04D8:00DD: not there", "lsusb"});
  drivers::HidPort::Report report{};
  CHECK_FALSE(port.send(report));
  CHECK_TRUE(port.receive(report, std::chrono::milliseconds{0}) == drivers::HidPort::Got::kGone);
  drivers::Mcp2221Gpio gpio(port);
  const Wiring row{.role = hal::Line::kGripOk, .line = "GP0", .chip = {}};
  check_says(gpio.open({.wiring = {&row, 1}}), {"MCP2221A: no answer"});
}
