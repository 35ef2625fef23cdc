// SPDX-License-Identifier: Apache-2.0
// Finding the sensor among cameras, in folders laid out as /sys. The strings are those of real sensors and of cameras
// with the same chip, as their owners listed them.
#include <memory>
#include <string>
#include <string_view>

#include "drivers/linux/usb_sensor.hpp"
#include "tests/support/sysfs_tree.hpp"
// last: it redefines new
#include "tests/support/allocations.hpp"

using namespace holdfast;
using drivers::Search;
using drivers::SensorSearch;
using test::SysfsTree;
using test::UsbCamera;

namespace {

UsbCamera sensor(const std::string& serial, const std::string& path, int node) {
  std::string plain = serial;
  plain.erase(plain.find('-'), 1);
  return {.path = path, .product = "GelSight Mini R0B " + serial, .serial = plain, .first_node = node};
}

UsbCamera aukey(const std::string& path, int node) {
  return {.path = path, .product = "PC-LM1E Camera", .serial = "SN0001", .manufacturer = "Aukey", .first_node = node};
}

}  // namespace

TEST_GROUP(LinuxUsbSensor) {
  SysfsTree sys;
  std::unique_ptr<drivers::UsbCensus> census = std::make_unique<drivers::UsbCensus>();

  SensorSearch find(std::string_view serial = "") {
    drivers::take_census(sys.root().c_str(), *census);
    return drivers::find_sensor(*census, serial);
  }
  void check_found(const SensorSearch& search, const char* serial, const char* node) {
    CHECK_TRUE(search.result == Search::kFound);
    STRCMP_EQUAL(serial, search.serial.c_str());
    STRCMP_EQUAL(node, search.node.c_str());
    STRCMP_EQUAL("", search.message.c_str());
  }
  void check_refused(const SensorSearch& search, Search why, std::initializer_list<std::string_view> parts) {
    CHECK_TRUE(search.result == why);
    CHECK_TRUE(search.node.empty());
    check_says(search, parts);
  }
  void check_says(const SensorSearch& search, std::initializer_list<std::string_view> parts) {
    const std::string text(search.message.view());
    for (const std::string_view part : parts) {
      if (text.find(part) == std::string::npos)
        FAIL(("not in the message: " + std::string(part) + "\n" + text).c_str());
    }
    CHECK_TRUE(text.find(". Likely cause: ") != std::string::npos && text.find(". Next: ") != std::string::npos);
  }
};

TEST(LinuxUsbSensor, TheOnlySensorIsFoundWithItsPicture) {
  sys.plug(sensor("2BNN-4ZE7", "1-1.2", 0));
  check_found(find(), "2BNN4ZE7", "/dev/video0");
  for (const char* serial : {"2BNN4ZE7", "2BNN-4ZE7", "2bnn-4ze7"})
    check_found(find(serial), "2BNN4ZE7", "/dev/video0");
  const SensorSearch search = find();
  LONGS_EQUAL(0x0c45, search.device.vendor);
  LONGS_EQUAL(0x636d, search.device.product_id);
  LONGS_EQUAL(1, search.device.bus);
  LONGS_EQUAL(7, search.device.address);
  LONGS_EQUAL(480, search.device.speed_mbit);
  STRCMP_EQUAL("1-1.2", search.device.path.c_str());
  STRCMP_EQUAL("Arducam Technology Co., Ltd.", search.device.manufacturer.c_str());
}

TEST(LinuxUsbSensor, MetadataIsNeverThePictureWhateverTheNumbers) {
  // After a replug the kernel may give the metadata the lower number, or one listed first.
  for (int round = 0; round < 8; ++round) {
    SysfsTree tree;
    UsbCamera camera = sensor("28LG-GZD8", "1-1", 2 * round);
    tree.plug(camera);
    drivers::take_census(tree.root().c_str(), *census);
    const SensorSearch search = drivers::find_sensor(*census, "");
    check_found(search, "28LGGZD8", ("/dev/video" + std::to_string(2 * round)).c_str());
  }
  UsbCamera odd = sensor("28LG-GZD8", "1-1", 4);
  sys.plug(odd);
  // The picture is video4 and the metadata video5; exchange their indices.
  for (const auto& [node, index] : {std::pair("video4", "1\n"), {"video5", "0\n"}}) {
    test::write_file(sys.root() + "/class/video4linux/" + node + "/index", index);
  }
  check_found(find(), "28LGGZD8", "/dev/video5");
}

TEST(LinuxUsbSensor, ANameMakesASensorNotTheUsbId) {
  sys.plug(aukey("1-1.3", 0));
  sys.plug({.path = "1-1.4", .product = "USB 2.0 Camera", .serial = "", .first_node = 2});
  check_refused(find(), Search::kLookAlike,
                {"no GelSight Mini", "'PC-LM1E Camera' (0c45:636d) at 1-1.3", "'USB 2.0 Camera' (0c45:636d) at 1-1.4"});
  check_refused(find("SN0001"), Search::kLookAlike, {"'PC-LM1E Camera'"});  // its serial does not help it
  sys.plug(sensor("2BNN-4ZE7", "1-1.2", 4));
  check_found(find(), "2BNN4ZE7", "/dev/video4");
  check_refused(find("SN0001"), Search::kOther, {"no GelSight Mini SN0001", "there is 2BNN4ZE7 at 1-1.2"});
  // Nor the name alone: an id that nobody has seen on a sensor is not opened, and told.
  sys.unplug("1-1.2");
  sys.unplug("1-1.3");
  sys.unplug("1-1.4");
  for (const std::string id : {"046d:636d", "0c45:0825"}) {
    sys.plug({.path = "1-1.5", .id = id, .product = "GelSight Mini R9X AAAA-BBBB", .first_node = 0});
    const std::string told = "there is 'GelSight Mini R9X AAAA-BBBB' (" + id + ") at 1-1.5";
    check_refused(find(), Search::kNone, {"no GelSight Mini on USB", told});
  }
}

TEST(LinuxUsbSensor, OfSeveralOneHasToBeNamed) {
  sys.plug(sensor("2BNN-4ZE7", "1-1.2", 0));
  sys.plug(sensor("28LG-GZD8", "1-1.3", 2));
  check_refused(find(), Search::kSeveral, {"several", "2BNN4ZE7 at 1-1.2", "28LGGZD8 at 1-1.3"});
  check_found(find("28LG-GZD8"), "28LGGZD8", "/dev/video2");
  check_found(find("2BNN4ZE7"), "2BNN4ZE7", "/dev/video0");
  check_refused(find("2BNN4ZE8"), Search::kOther, {"no GelSight Mini 2BNN4ZE8", "2BNN4ZE7 at 1-1.2", "28LGGZD8"});
  sys.plug(sensor("2BNN-4ZE7", "1-1.4", 4));  // two with one serial number: not to be told apart
  check_refused(find("2BNN4ZE7"), Search::kSeveral, {"fit", "2BNN4ZE7 at 1-1.2", "2BNN4ZE7 at 1-1.4"});
}

TEST(LinuxUsbSensor, TheNumberOnTheCaseCountsAndTheDescriptorsWhereThereIsNone) {
  UsbCamera camera = sensor("2BNN-4ZE7", "1-1", 0);
  camera.serial = "SN0001";
  sys.plug(camera);
  check_found(find(), "2BNN4ZE7", "/dev/video0");
  check_found(find("2BNN-4ZE7"), "2BNN4ZE7", "/dev/video0");
  check_found(find("SN0001"), "2BNN4ZE7", "/dev/video0");
  sys.unplug("1-1");
  camera.product = "GelSight Mini";
  camera.serial = "2bnn4ze7";
  sys.plug(camera);
  check_found(find("2BNN-4ZE7"), "2BNN4ZE7", "/dev/video0");
}

TEST(LinuxUsbSensor, APortThatIsTooSlowIsToldAndUsed) {
  UsbCamera camera = sensor("2BNN-4ZE7", "1-1", 0);
  camera.speed = "12";
  sys.plug(camera);
  SensorSearch search = find();
  CHECK_TRUE(search.result == Search::kFound);
  STRCMP_EQUAL("/dev/video0", search.node.c_str());
  check_says(search, {"2BNN4ZE7 at 1-1", "12 Mb/s instead of 480", "hub"});
  camera.speed = "5000";
  sys.plug(camera);
  check_found(find(), "2BNN4ZE7", "/dev/video0");
}

TEST(LinuxUsbSensor, WithoutItsDriverItIsThereAndHasNoPicture) {
  sys.plug(sensor("2BNN-4ZE7", "1-1", -1));
  const SensorSearch search = find();
  check_refused(search, Search::kNoNode,
                {"2BNN4ZE7 at 1-1 has no video node", "uvcvideo", "holdfast-sensor reset 2BNN4ZE7"});
  STRCMP_EQUAL("1-1", search.device.path.c_str());
}

TEST(LinuxUsbSensor, AnEmptyMachineSaysSo) {
  check_refused(find(), Search::kNone, {"no GelSight Mini on USB; no camera at all", "micro-USB"});
  drivers::take_census("/nonexistent", *census);
  LONGS_EQUAL(0, census->device_count + census->node_count);
  check_refused(drivers::find_sensor(*census, "X"), Search::kNone, {"no camera at all"});
  sys.plug({.path = "2-1", .id = "046d:0825", .product = "HD Webcam C270", .serial = "", .first_node = 0});
  check_refused(find(), Search::kNone, {"there is 'HD Webcam C270' (046d:0825) at 2-1"});
}

TEST(LinuxUsbSensor, UnpluggedAndBackOnAnotherPortItIsTheSame) {
  sys.plug(sensor("2BNN-4ZE7", "1-1.2", 0));
  check_found(find("2BNN4ZE7"), "2BNN4ZE7", "/dev/video0");
  sys.unplug("1-1.2");
  check_refused(find("2BNN4ZE7"), Search::kNone, {"not plugged in"});
  sys.plug(sensor("2BNN-4ZE7", "1-1.4", 6));
  check_found(find("2BNN4ZE7"), "2BNN4ZE7", "/dev/video6");
}

TEST(LinuxUsbSensor, WordsOfADeviceCannotHurt) {
  const std::string evil = "Cam\x1b[31m\r\"\\" + std::string(300, 'x');
  sys.plug(
      {.path = "1-1", .product = evil, .serial = std::string(200, 'y'), .speed = "99999999999999", .first_node = 0});
  const SensorSearch search = find();
  check_refused(search, Search::kLookAlike, {"'Cam?[31m?\"\\xxx"});
  for (const char letter : search.message.view()) CHECK_TRUE(letter >= ' ' && letter <= '~');
}

TEST(LinuxUsbSensor, MoreThanFitsIsLeftOut) {
  for (int i = 0; i < 60; ++i) {
    sys.plug(
        {.path = "1-" + std::to_string(i + 1), .product = "USB 2.0 Camera", .serial = "", .first_node = 20 + 2 * i});
  }
  const SensorSearch search = find();
  LONGS_EQUAL(32, census->device_count);
  LONGS_EQUAL(64, census->node_count);
  check_refused(search, Search::kLookAlike, {", and more"});
}

TEST(LinuxUsbSensor, LookingTakesNoHeap) {
  sys.plug(sensor("2BNN-4ZE7", "1-1.2", 0));
  sys.plug(aukey("1-1.3", 2));
  const std::string root = sys.root();
  const unsigned before = test::allocations();
  drivers::take_census(root.c_str(), *census);
  const SensorSearch found = drivers::find_sensor(*census, "2BNN4ZE7");
  const SensorSearch refused = drivers::find_sensor(*census, "X");
  LONGS_EQUAL(before, test::allocations());
  check_found(found, "2BNN4ZE7", "/dev/video0");
  CHECK_TRUE(refused.result == Search::kOther);
}
