// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/sysfs_supply.hpp"

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using State = hal::Supply::State;

TEST_GROUP(SysfsSupply) {
  test::TempDir dir;
  drivers::SysfsSupply supply{{.sys = dir.path().string()}};

  void put(const std::string& file, const std::string& text) {
    std::filesystem::create_directories((dir.path() / file).parent_path());
    std::ofstream(dir.path() / file, std::ios::binary) << text;
  }
  void check(State expected) {
    supply.look();
    LONGS_EQUAL(static_cast<int>(expected), static_cast<int>(supply.state()));
  }
};

// What a Raspberry Pi 4 has: the processor's temperature first, then the voltage, by a driver that may come later.
TEST(SysfsSupply, FindsTheSensorByItsNameAndSaysWhatItSaysNow) {
  const std::string alarm = "class/hwmon/hwmon1/in0_lcrit_alarm";
  put("class/hwmon/hwmon0/name", "cpu_thermal\n");
  put("class/hwmon/hwmon0/in0_lcrit_alarm", "1\n");
  check(State::kUnknown);
  check(State::kUnknown);
  LONGS_EQUAL(2, supply.missed());
  put("class/hwmon/hwmon1/name", "rpi_volt\n");
  for (const auto& [text, expected] :
       {std::pair{"0\n", State::kGood}, std::pair{"1\n", State::kLow}, std::pair{"", State::kUnknown},
        std::pair{"1x\n", State::kUnknown}, std::pair{"0\n", State::kGood}}) {
    put(alarm, text);
    check(expected);
  }
  LONGS_EQUAL(0, supply.missed());
  std::filesystem::rename(dir.path() / "class/hwmon/hwmon1", dir.path() / "class/hwmon/hwmon7");  // loaded anew
  put("class/hwmon/hwmon7/in0_lcrit_alarm", "1\n");
  check(State::kLow);
  std::filesystem::remove_all(dir.path() / "class");
  check(State::kUnknown);
}

// Bits as of vcgencmd get_throttled: 0 under-voltage now, 2 slowed down now, 16 and 18 the same since the start.
TEST(SysfsSupply, ReadsTheNumberOfRaspberryPisOwnKernel) {
  const std::string file = "devices/platform/soc/soc:firmware/get_throttled";
  for (const auto& [text, expected] : {std::pair{"0\n", State::kGood}, std::pair{"50005\n", State::kLow},
                                       std::pair{"50004\n", State::kGood}, std::pair{"", State::kUnknown}}) {
    put(file, text);
    check(expected);
  }
}

TEST(SysfsSupply, ReadsInAThreadOfItsOwnAndEndsAtOnce) {
  put("class/hwmon/hwmon0/name", "rpi_volt\n");
  put("class/hwmon/hwmon0/in0_lcrit_alarm", "1\n");
  const auto begun = std::chrono::steady_clock::now();
  {
    drivers::SysfsSupply started({.sys = dir.path().string()});
    started.start();
    while (started.state() == State::kUnknown && std::chrono::steady_clock::now() - begun < std::chrono::seconds(60)) {
      std::this_thread::yield();
    }
    CHECK_TRUE(started.state() == State::kLow);
  }
}
