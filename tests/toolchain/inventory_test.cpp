// SPDX-License-Identifier: Apache-2.0
// What `holdfast devices` and `doctor` say of a computer, on trees of files that look like its sysfs.
#include "toolchain/devices/inventory.hpp"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/sysfs_tree.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using devices::Item;
using devices::Verdict;
namespace fs = std::filesystem;

}  // namespace

TEST_GROUP(Inventory) {
  test::TempDir folder;
  test::SysfsTree usb;  // of cameras; the other kinds have a tree in `folder`
  devices::Places places;
  std::set<std::string> forbidden;

  void setup() override {
    places.sys = (folder / "sys").string();
    places.dev = (folder / "dev").string();
    places.proc = (folder / "proc").string();
    places.chip = [this](const std::string& path) -> std::optional<devices::ChipName> {
      if (forbidden.contains(path)) return std::nullopt;
      return devices::ChipName{path.ends_with("0") ? "pinctrl-bcm2711" : "raspberrypi-exp-gpio", 58};
    };
    places.may_use = [this](const std::string& path) { return !forbidden.contains(path); };
    put("dev/null", "");
  }
  void put(const std::string& path, const std::string& text) {
    fs::create_directories((folder / path).parent_path());
    test::write_file(folder / path, text + "\n");
  }
  void plug(const test::UsbCamera& camera) {
    usb.plug(camera);
    places.sys = usb.root();
  }
  std::string dev(const std::string& name) const {
    return places.dev + "/" + name;
  }
};

TEST(Inventory, ASensorAndItsMetadata) {
  plug({.path = "1-2", .product = "GelSight Mini R0B 2BNN-4ZE7", .serial = "2BNN4ZE7", .first_node = 8});
  const auto items = devices::cameras(places);
  LONGS_EQUAL(3, items.size());                                // and the tree's codec, which is no camera of ours
  STRCMP_EQUAL(dev("video8").c_str(), items[0].path.c_str());  // by number
  CHECK_TRUE(items[0].verdict == Verdict::kGood);
  STRCMP_EQUAL("serial 2BNN4ZE7, 480 Mb/s", items[0].what.c_str());
  CHECK_TRUE(items[1].verdict == Verdict::kNote);
  STRCMP_CONTAINS("metadata", items[1].what.c_str());
  STRCMP_CONTAINS("another camera", items[2].what.c_str());
}

TEST(Inventory, WhatIsWrongWithCameras) {
  plug({.path = "1-1", .product = "USB 2.0 Camera", .serial = "SN1", .first_node = 0});
  auto items = devices::cameras(places);
  LONGS_EQUAL(4, items.size());
  CHECK_TRUE(items[0].verdict == Verdict::kWrong);
  STRCMP_CONTAINS("has a GelSight's USB id 0c45:636d, but is none", items[0].what.c_str());
  STRCMP_EQUAL("not there", items[3].what.c_str());
  plug({.path = "1-2", .product = "GelSight Mini R0B 28LG-GZD8", .serial = "28LGGZD8", .speed = "12", .first_node = 2});
  items = devices::cameras(places);
  STRCMP_CONTAINS("runs at 12 Mb/s", items[2].what.c_str());
  forbidden.insert(dev("video2"));
  items = devices::cameras(places);
  STRCMP_CONTAINS("no right to use it", items[2].what.c_str());
  STRCMP_CONTAINS("group video", items[2].fix.c_str());
}

TEST(Inventory, TwoSensorsHaveToBeTold) {
  plug({.path = "1-1", .product = "GelSight Mini R0B 2BNN-4ZE7", .serial = "2BNN4ZE7", .first_node = 0});
  plug({.path = "1-2", .product = "GelSight Mini R0B 28LG-GZD8", .serial = "28LGGZD8", .first_node = 2});
  const auto items = devices::cameras(places);
  STRCMP_CONTAINS("--sensor 2BNN4ZE7", items[0].fix.c_str());
  STRCMP_CONTAINS("--sensor 28LGGZD8", items[2].fix.c_str());
  STRCMP_CONTAINS("--sensor LEFT --right RIGHT", items[2].fix.c_str());
}

TEST(Inventory, ASensorWithoutItsDriver) {
  plug({.path = "1-3", .product = "GelSight Mini R0B 2BNN-4ZE7", .serial = "2BNN4ZE7"});
  const auto items = devices::cameras(places);
  STRCMP_CONTAINS("is on USB, but has no video node", items.back().what.c_str());
  STRCMP_CONTAINS("modprobe uvcvideo", items.back().fix.c_str());
}

TEST(Inventory, GpioChipsByTheirLabels) {
  auto items = devices::gpio_chips(places);
  LONGS_EQUAL(1, items.size());
  STRCMP_CONTAINS("there are none", items[0].what.c_str());
  for (const char* name : {"gpiochip0", "gpiochip1"}) put(std::string("dev/") + name, "");
  forbidden.insert(dev("gpiochip1"));
  items = devices::gpio_chips(places);
  LONGS_EQUAL(2, items.size());
  STRCMP_EQUAL("pinctrl-bcm2711", items[0].name.c_str());
  STRCMP_CONTAINS("the 40-pin header", items[0].what.c_str());
  CHECK_TRUE(items[1].verdict == Verdict::kWrong);
  STRCMP_CONTAINS("group gpio", items[1].fix.c_str());
}

TEST(Inventory, SerialPortsByTheirAdapters) {
  put("sys/class/tty/console/active", "tty0 ttyAMA0");
  for (const char* name : {"ttyUSB0", "ttyAMA0", "ttyS0", "ttyS1"}) {
    fs::create_directories(folder / ("sys/class/tty/" + std::string(name) + "/device"));
  }
  put("sys/class/tty/ttyUSB0/device/latency_timer", "16");
  put("sys/class/tty/ttyS0/type", "4");
  put("sys/class/tty/ttyS1/type", "0");                      // a place without a chip
  fs::create_directories(folder / "sys/class/tty/ttyUSB7");  // without a device
  fs::create_directories(folder / "dev/serial/by-id");
  fs::create_symlink("../../ttyUSB0", folder / "dev/serial/by-id/usb-FTDI_FT1234-if00-port0");
  const auto items = devices::serial_ports(places);
  LONGS_EQUAL(3, items.size());
  STRCMP_EQUAL((places.dev + "/serial/by-id/usb-FTDI_FT1234-if00-port0").c_str(), items[0].name.c_str());
  STRCMP_CONTAINS("collects input for 16 ms", items[0].what.c_str());
  CHECK_TRUE(items[0].verdict == Verdict::kGood);
  STRCMP_CONTAINS("the kernel's console writes to it", items[1].what.c_str());
  STRCMP_CONTAINS("console=ttyAMA0", items[1].fix.c_str());
  STRCMP_EQUAL(dev("ttyS0").c_str(), items[2].path.c_str());
}

TEST(Inventory, BridgesByTheirId) {
  put("sys/class/hidraw/hidraw0/device/uevent", "DRIVER=hid-generic\nHID_ID=0003:0000046D:0000C52B");
  put("sys/class/hidraw/hidraw1/device/uevent", "DRIVER=hid-generic\nHID_ID=0003:000004D8:000000DD");
  put("sys/class/hidraw/hidraw2/device/uevent", "DRIVER=mcp2221\nHID_ID=0003:000004D8:000000DD");
  const auto items = devices::bridges(places);
  LONGS_EQUAL(2, items.size());
  STRCMP_EQUAL(dev("hidraw1").c_str(), items[0].path.c_str());
  CHECK_TRUE(items[0].verdict == Verdict::kGood);
  STRCMP_CONTAINS("kernel's own driver", items[1].what.c_str());
}

TEST(Inventory, PowerAndMemory) {
  put("proc/meminfo", "MemTotal:  4000000 kB\nMemFree: 5 kB\nMemAvailable:    90000 kB");
  put("sys/devices/platform/soc/soc:firmware/get_throttled", "50005");
  const auto items = devices::system_state(places);
  STRCMP_EQUAL("memory", items[0].name.c_str());
  CHECK_TRUE(items[0].verdict == Verdict::kWrong);
  STRCMP_CONTAINS("87 MB", items[0].what.c_str());
  STRCMP_EQUAL("power", items[1].name.c_str());
  STRCMP_CONTAINS("under-voltage", items[1].what.c_str());
  put("sys/devices/platform/soc/soc:firmware/get_throttled", "0");
  put("proc/meminfo", "MemAvailable:    900000 kB");
  for (const Item& item : devices::system_state(places)) CHECK_TRUE(item.verdict != Verdict::kWrong);
}

// What a board's unit gives the firmware is nothing that a PC lacks.
TEST(Inventory, ABoardSaysItsNameAndAPcThatItIsNone) {
  put("proc/meminfo", "MemAvailable:    900000 kB");
  auto items = devices::system_state(places);
  LONGS_EQUAL(2, items.size());
  STRCMP_EQUAL("this computer", items[1].name.c_str());
  STRCMP_CONTAINS("holdfast live", items[1].what.c_str());
  put("proc/device-tree/model", std::string("Raspberry Pi 4 Model B Rev 1.4\0", 31));
  items = devices::system_state(places);
  LONGS_EQUAL(4, items.size());
  STRCMP_EQUAL("Raspberry Pi 4 Model B Rev 1.4", items[1].what.c_str());
  STRCMP_EQUAL("lock memory", items[2].name.c_str());
}

// This computer has no sensor: both commands say so and go on.
TEST(Inventory, CommandsSpeakToPeopleAndPrograms) {
  const test::Finished text = test::run({test::kTool, "devices"});
  LONGS_EQUAL(0, text.status);
  STRCMP_CONTAINS("camera", text.out.c_str());
  CHECK_TRUE(text.out.find('\x1b') == std::string::npos);
  const test::Finished json = test::run({test::kTool, "doctor", "--json"});
  const auto items = nlohmann::json::parse(json.out);
  const bool wrong = std::ranges::any_of(items, [](const auto& item) { return item["verdict"] == "wrong"; });
  LONGS_EQUAL(wrong ? 1 : 0, json.status);
}
