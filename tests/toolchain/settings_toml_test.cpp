// SPDX-License-Identifier: Apache-2.0
// Settings as TOML, what is wrong with them, and the owner's keys.
#include "toolchain/sealed/settings_toml.hpp"

#include <sys/stat.h>

#include <array>
#include <string>
#include <vector>

#include "drivers/common/ed25519.hpp"
#include "store/sealed.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/sealed/owner_key.hpp"

// behind all that defines new
#include <CppUTest/TestHarness.h>

#include "tests/support/error_line.hpp"

using namespace holdfast;
using test::check_says;
using tool::settings_of_toml;

TEST_GROUP(SettingsToml) {
  Params params;

  std::string error_of(const std::string& text) {
    params = {};
    std::string error = settings_of_toml(text, "robot.toml", params);
    if (!error.empty()) CHECK(params == Params{});
    return error;
  }
};

TEST(SettingsToml, AreWhatIsWritten) {
  STRCMP_EQUAL("", error_of("# a comment\nhold_ms = 300\nmode = \"precise\"  # a name\nlatch = 1\n").c_str());
  Params wanted;
  wanted.hold_ms = 300;
  wanted.mode = 2;
  wanted.latch = 1;
  CHECK(params == wanted);
  STRCMP_EQUAL("", error_of("").c_str());
  CHECK(params == Params{});
}

// At both ends of every range, and one beyond each.
TEST(SettingsToml, KeepTheRangesOfTheTable) {
  for (const ParamInfo& row : kParams) {
    for (const std::int64_t wrong : {std::int64_t{row.min} - 1, std::int64_t{row.max} + 1, std::int64_t{1} << 40}) {
      const std::string name(row.name);
      check_says(error_of("\n" + name + " = " + std::to_string(wrong)),
                 {"robot.toml:2: ", name, " is outside its range, ",
                  std::to_string(row.min) + " to " + std::to_string(row.max), row.unit});
    }
    Params edge;
    edge.*row.member = row.max;
    if (!validate(edge).ok()) continue;
    STRCMP_EQUAL("", error_of(std::string(row.name) + " = " + std::to_string(row.max)).c_str());
    CHECK(params == edge);
  }
}

TEST(SettingsToml, SayWhatIsWrongAndWhere) {
  check_says(error_of("hold_ms = 300\nhold_mss = 5"), {"robot.toml:2: there is no parameter 'hold_mss'", "hold_ms;"});
  check_says(error_of("raise_frame = 2"), {"the nearest name is raise_frames"});
  for (const char* const value : {"2.5", "\"3\"", "\"loud\"", "true", "[1]", "{ a = 1 }", "1979-05-27", "\"\""}) {
    check_says(error_of(std::string("hold_ms = ") + value),
               {"robot.toml:1: hold_ms is no whole number", "0 to 5000 ms"});
  }
  check_says(error_of("[grip]\nhold_ms = 3"), {"robot.toml:1: there is no parameter 'grip'"});
  check_says(error_of("hold_ms = \n"), {"robot.toml:1: is no TOML: "});
  check_says(error_of("hold_ms = 1\nhold_ms = 2\n"), {"robot.toml:2: is no TOML: "});
  check_says(error_of(std::string("a\0\xFF\x1B[31m = 1\n", 12)), {"robot.toml:1: is no TOML: "});
  check_says(error_of(R"("\u001B[31m" = 1)"), {"there is no parameter '?[31m'"});
  check_says(error_of("hold_ms = 5\nfault_markers_pct = 99"), {"robot.toml:2: fault_markers_pct is above degraded"});
  check_says(error_of("degraded_markers_pct = 50"), {"robot.toml:1: fault_markers_pct is above degraded"});
}

TEST(SettingsToml, ComeBackAsTheyWere) {
  Params wanted;
  for (const ParamInfo& row : kParams) wanted.*row.member = row.min;
  wanted.degraded_markers_pct = 50;
  CHECK(validate(wanted).ok());
  STRCMP_EQUAL("", error_of(tool::toml_of_settings(wanted)).c_str());
  CHECK(params == wanted);
  STRCMP_EQUAL("", tool::toml_of_settings({}).c_str());
}

TEST(SettingsToml, AreSignedByTheOwner) {
  const test::TempDir dir;
  const std::string keys = (dir / "keys").string();
  STRCMP_EQUAL("", tool::make_owner_keys(keys).c_str());
  struct stat about {};
  LONGS_EQUAL(0, ::stat((keys + "/owner.key").c_str(), &about));
  LONGS_EQUAL(0600, about.st_mode & 0777);
  const std::string before = test::read_file(keys + "/owner.key");
  LONGS_EQUAL(72, before.size());
  check_says(tool::make_owner_keys(keys), {"owner.key: is there already"});
  STRCMP_EQUAL(before.c_str(), test::read_file(keys + "/owner.key").c_str());
  check_says(tool::make_owner_keys((dir / "none" / "keys").string()), {"no keys could be written there"});

  drivers::Ed25519::Key key{};
  STRCMP_EQUAL("", drivers::read_public_key(keys + "/owner.pub", key).c_str());
  tool::OwnerKey owner;
  STRCMP_EQUAL("", owner.read(keys + "/owner.key").c_str());
  std::vector<std::uint8_t> record(sealed::kAround + 8);
  (void)sealed::write(sealed::Kind::kSettings, 3, std::vector<std::uint8_t>(8), record);
  owner.sign(record);
  const drivers::Ed25519 verifier(key);
  sealed::Record read;
  CHECK(sealed::read(record, sealed::Kind::kSettings, &verifier, read) == sealed::Refusal::kNone);

  for (const std::string& text : {std::string(), before.substr(1), before + before, "g" + before.substr(1)}) {
    test::write_file(dir / "wrong", text);
    check_says(owner.read((dir / "wrong").string()), {"is no key to sign with"});
  }
  check_says(owner.read((dir / "nothing").string()), {"cannot be read"});
  check_says(owner.read(keys + "/owner.pub"), {"is no key to sign with"});  // everybody has that one
}
