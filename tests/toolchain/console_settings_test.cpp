// SPDX-License-Identifier: Apache-2.0
// Files of parameters, of `holdfast console --backup` and of anybody.
#include "toolchain/console/settings_file.hpp"

#include <string>
#include <vector>

// behind all that defines new
#include <CppUTest/TestHarness.h>

#include "tests/support/error_line.hpp"

using namespace holdfast;
using console_tool::check_settings;
using console_tool::Parameter;
using console_tool::parse_settings;
using console_tool::SettingsText;

namespace {

const std::vector<std::string> kDump{"set hold_ms 200", "set max_force 255", "set start_force 20"};
const std::string kVersion = R"({"firmware":"holdfastd 0.1.0","board":"sim","link_version":1,"model":"slip_v5"})";

Parameter parameter(const char* name, std::int64_t least, std::int64_t most) {
  Parameter out;
  out.name = name;
  out.min = least;
  out.max = most;
  out.unit = "ms";
  return out;
}

}  // namespace

TEST_GROUP(ConsoleSettings){};

TEST(ConsoleSettings, ABackupSaysWhatItIsOfAndIsReadBack) {
  const std::string text = console_tool::backup_text(kVersion, kDump);
  STRCMP_CONTAINS("# holdfast backup\n# firmware holdfastd 0.1.0\n# board sim\n# link_version 1\n# model slip_v5\nset ",
                  text.c_str());
  const SettingsText read = parse_settings(text);
  STRCMP_EQUAL("", read.error.c_str());
  LONGS_EQUAL(3, read.settings.size());
  STRCMP_EQUAL("max_force", read.settings[1].name.c_str());
  LONGS_EQUAL(255, read.settings[1].value);
}

// Every cut and every changed byte of a backup is refused: nothing of it is taken for settings.
TEST(ConsoleSettings, ADamagedBackupIsRefused) {
  const std::string whole = console_tool::backup_text(kVersion, kDump);
  const std::size_t first = std::string("# holdfast backup").size();
  for (std::size_t size = first; size + 1 < whole.size(); ++size) {
    const std::string error = parse_settings(whole.substr(0, size)).error;
    CHECK_TEXT(!error.empty(), std::to_string(size).c_str());
  }
  for (std::size_t k = first; k + 1 < whole.size(); ++k) {
    std::string damaged = whole;
    damaged[k] = static_cast<char>(damaged[k] ^ 0x04);
    CHECK_TEXT(!parse_settings(damaged).error.empty(), std::to_string(k).c_str());
  }
  test::check_says(parse_settings(whole.substr(0, whole.size() / 2)).error, {"breaks off"});
}

TEST(ConsoleSettings, WhatDiffPrintsAndWhatPeopleWrite) {
  const SettingsText read = parse_settings("# mine\r\n\r\n  set hold_ms = 100\r\nset\tmax_force\t-3");
  STRCMP_EQUAL("", read.error.c_str());
  LONGS_EQUAL(2, read.settings.size());
  LONGS_EQUAL(100, read.settings[0].value);
  LONGS_EQUAL(3, read.settings[0].line);
  LONGS_EQUAL(-3, read.settings[1].value);
}

TEST(ConsoleSettings, WhatIsNoSettingIsNamedByItsLine) {
  for (const char* const line : {"reboot", "set hold_ms", "set hold_ms 1 2", "set hold_ms 1x", "set hold_ms 0x10",
                                 "set hold_ms 99999999999999999999", "unlock desk", "set \x1B[2J 1"}) {
    const std::string error = parse_settings(std::string("set max_force 1\n") + line + "\n").error;
    if (std::string(line).find('\x1B') != std::string::npos) continue;  // a name that no device has
    test::check_says(error, {"line 2: '", "' is no setting"});
  }
  test::check_says(parse_settings("set hold_ms 1\nset hold_ms 2\n").error, {"line 2", "set twice"});
  test::check_says(parse_settings("# nothing\n").error, {"has no settings"});
}

TEST(ConsoleSettings, TheDeviceKnowsNamesAndRanges) {
  const std::vector<Parameter> device{parameter("hold_ms", 0, 5000), parameter("max_force", 0, 255)};
  const auto check = [&](const char* text) { return check_settings(parse_settings(text).settings, device); };
  STRCMP_EQUAL("", check("set hold_ms 5000\nset max_force 0\n").c_str());
  test::check_says(check("set hold_ms 5001\n"), {"line 1: hold_ms = 5001 is not in 0 to 5000 ms"});
  test::check_says(check("set hold_ms -1\nset lose_ms 3\n"),
                   {"line 1: hold_ms = -1", "line 2: no parameter 'lose_ms'"});
  test::check_says(check("set \x1B[2J 1\n"), {"no parameter '?[2J'"});
}
