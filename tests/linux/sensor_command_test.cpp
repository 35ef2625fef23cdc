// SPDX-License-Identifier: Apache-2.0
// holdfast-sensor as a user runs it, on folders laid out as /sys. A reset that reaches a device is left to the emulated
// machine: here no device of these folders exists, which the command has to say.
#include <string>
#include <string_view>

#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/sysfs_tree.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using test::Finished;
using test::UsbCamera;

TEST_GROUP(SensorCommand) {
  test::SysfsTree sys;
  UsbCamera sensor{.path = "1-1.2", .product = "GelSight Mini R0B 2BNN-4ZE7", .serial = "2BNN4ZE7", .first_node = 0};
  UsbCamera other{.path = "1-1.3", .product = "PC-LM1E \"Camera\"", .serial = "SN0001", .first_node = 2};

  Finished run(std::vector<std::string> words) {
    words.insert(words.begin(), holdfast::test::program("holdfast-sensor"));
    words.insert(words.end(), {"--sysfs", sys.root()});
    return test::run(words);
  }
  void check_has(const std::string& text, std::initializer_list<std::string_view> parts) {
    for (const std::string_view part : parts) {
      if (text.find(part) == std::string::npos) FAIL(("missing: " + std::string(part) + "\n" + text).c_str());
    }
  }
};

TEST(SensorCommand, OnlyTheSensorIsReset) {
  sys.plug(other);
  const Finished refused = run({"reset", "--any"});
  LONGS_EQUAL(1, refused.status);
  check_has(refused.err, {"no GelSight Mini", "PC-LM1E", "0c45:636d", ". Next: "});
  STRCMP_EQUAL("", refused.out.c_str());
  sys.plug(sensor);
  const Finished wrong = run({"reset", "28LG-GZD8"});
  LONGS_EQUAL(1, wrong.status);
  check_has(wrong.err, {"no GelSight Mini 28LG-GZD8", "there is 2BNN4ZE7"});
  // Bus 1, device 7 of the folder is no device of this machine, or none with the sensor's id.
  const Finished absent = run({"reset", "2BNN-4ZE7"});
  LONGS_EQUAL(1, absent.status);
  check_has(absent.err, {"GelSight Mini 2BNN4ZE7 at 1-1.2: not reset", ". Next: "});
}

TEST(SensorCommand, AWrongCommandLineIsToldWithTheRightOne) {
  for (const std::vector<std::string>& words : {std::vector<std::string>{},
                                                {"reset"},
                                                {"reset", "2BNN4ZE7", "--any"},
                                                {"explode", "--any"},
                                                {"reset", "--any", "--json"}}) {
    const Finished wrong = run(words);
    LONGS_EQUAL(2, wrong.status);
    check_has(wrong.err, {"usage: holdfast-sensor reset"});
  }
  const Finished help = test::run({holdfast::test::program("holdfast-sensor"), "--help"});
  LONGS_EQUAL(0, help.status);
  check_has(help.out, {"usage: ", "example: "});
}
