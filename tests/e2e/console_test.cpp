// SPDX-License-Identifier: Apache-2.0
// `holdfast console` against the firmware as a process, over its pseudo terminal.
#include <fcntl.h>
#include <poll.h>

#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "link/command_frame.hpp"
#include "slip/tree_io.hpp"
#include "tests/support/deadline.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/http.hpp"
#include "tests/support/pty.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/console/find.hpp"
#include "toolchain/console/record.hpp"
#include "toolchain/console/watching.hpp"
#include "toolchain/log/frame_reader.hpp"
#include "toolchain/log/mcap_reader.hpp"
// behind all that defines new
#include <CppUTest/TestHarness.h>

#include "tests/support/error_line.hpp"

namespace {

using namespace holdfast;
using namespace std::chrono_literals;
using holdfast::test::kFirmware;
using holdfast::test::kTool;
namespace fs = std::filesystem;
using console_tool::Device;
using console_tool::Port;
using console_tool::Signals;
using test::Finished;
using test::HostProcess;
using test::read_file;
using test::until;
using test::write_file;

}  // namespace

TEST_GROUP(ConsoleTool) {
  test::TempDir dir;
  std::unique_ptr<HostProcess> firmware;
  std::string owner_key;
  std::vector<std::string> more;  // of holdfastd's options

  void setup() override {
    ::setenv("XDG_STATE_HOME", dir.path().c_str(), 1);
    write_file(dir / "code", "desk\n");
    start("port");
  }
  void teardown() override {
    firmware.reset();
    ::unsetenv("XDG_STATE_HOME");
  }
  std::string at(const char* name) const {
    return (dir / name).string();
  }
  std::unique_ptr<HostProcess> device(const char* name) const {
    std::vector<std::string> words{kFirmware,
                                   "--real-time",
                                   "--held",
                                   "--host",
                                   at(name),
                                   "--settings",
                                   at((std::string(name) + ".settings").c_str()),
                                   "--models",
                                   at((std::string(name) + ".model").c_str())};
    if (!owner_key.empty()) words.insert(words.end(), {"--owner-key", owner_key});
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<HostProcess>(words);
  }
  void start(const char* name) {
    std::error_code ignored;
    fs::remove(at(name), ignored);
    firmware = device(name);
    CHECK(until([&] { return fs::exists(at(name)); }));
  }
  Finished tool(std::vector<std::string> words) const {
    words.insert(words.begin(), {kTool, "console", at("port")});
    return HostProcess(words).finish(60s);
  }
  Finished unlocked(std::vector<std::string> words) const {
    words.insert(words.end(), {"--code-file", at("code")});
    return tool(std::move(words));
  }
  // What a recorder has written so far is under another name: some 50 rows.
  bool rows_of(const std::string& name) const {
    const auto grows = [&](const fs::directory_entry& entry) {
      return entry.path().filename().string().starts_with(name + ".tmp") && entry.file_size() > 8'000;
    };
    return std::any_of(fs::directory_iterator(dir.path()), fs::directory_iterator(), grows);
  }
  // By the first column; fails unless time runs. The longest step.
  static double check_time_runs(const std::string& text, int least) {
    CHECK(text.starts_with("t_s,frame,state,"));
    CHECK(text.ends_with('\n'));
    double last = -1;
    double longest = 0;
    int rows = 0;
    for (std::size_t begin = text.find('\n') + 1; begin < text.size(); begin = text.find('\n', begin) + 1) {
      const double t = std::strtod(text.c_str() + begin, nullptr);
      CHECK(t > last);
      if (rows++ > 0) longest = std::max(longest, t - last);
      last = t;
    }
    CHECK(rows >= least);
    return longest;
  }
  static void check_fine(const Finished& finished) {
    STRCMP_EQUAL("", finished.err.c_str());
    LONGS_EQUAL(0, finished.status);
  }
};

TEST(ConsoleTool, PrintsAnswersAndNothingElse) {
  const Finished finished = tool({"--run", "version json", "--run", "status json", "--run", "# nothing"});
  check_fine(finished);
  const std::size_t end = finished.out.find('\n');
  const auto version = nlohmann::json::parse(finished.out.substr(0, end));
  STRCMP_CONTAINS("holdfastd ", version.at("firmware").get<std::string>().c_str());
  const auto status = nlohmann::json::parse(finished.out.substr(end + 1));
  LONGS_EQUAL(63, status.at("markers_expected").get<int>());
}

TEST(ConsoleTool, EndsAtTheFirstError) {
  const Finished finished = tool({"--run", "version", "--run", "set hold_ms 5", "--run", "status", "--run", "version"});
  LONGS_EQUAL(1, finished.status);
  STRCMP_CONTAINS("ERR 10 locked", finished.err.c_str());
  STRCMP_CONTAINS("2 more commands were not run", finished.err.c_str());
  STRCMP_CONTAINS("board ", finished.out.c_str());
  CHECK(finished.out.find("state ") == std::string::npos);
}

TEST(ConsoleTool, RunsTheLinesOfItsInput) {
  write_file(dir / "lines", "# a comment\r\n\r\nversion json\r\nget hold_ms");
  const std::string call = std::string(kTool) + " console " + at("port") + " < ";
  const Finished finished = test::run({"sh", "-c", call + at("lines")});
  check_fine(finished);
  STRCMP_CONTAINS("\"firmware\"", finished.out.c_str());
  STRCMP_CONTAINS("hold_ms ", finished.out.c_str());
  write_file(dir / "lines", "no_such\nversion\n");
  const Finished failed = test::run({"sh", "-c", call + at("lines")});
  LONGS_EQUAL(1, failed.status);
  STRCMP_CONTAINS("ERR 1 unknown_command", failed.err.c_str());
}

TEST(ConsoleTool, LocksAgainWhatItUnlocked) {
  const Finished finished = unlocked({"--run", "status json"});
  check_fine(finished);
  STRCMP_CONTAINS("\"unlocked\":true", finished.out.c_str());
  STRCMP_CONTAINS("\"unlocked\":false", tool({"--run", "status json"}).out.c_str());
  write_file(dir / "wrong", "another\n");
  const Finished wrong = tool({"--run", "version", "--code-file", at("wrong")});
  LONGS_EQUAL(1, wrong.status);
  STRCMP_CONTAINS("ERR 11 wrong_code", wrong.err.c_str());
  STRCMP_EQUAL("", wrong.out.c_str());
}

// The next program finds it locked, however soon it comes and whatever the one before did not say.
TEST(ConsoleTool, FindsItLockedAfterWhoeverLeft) {
  Signals signals;
  Port port;
  CHECK(port.open(at("port")) == Port::Opened::kYes);
  for (int round = 0; round < 20; ++round) {
    Device before(port, signals, 5000ms);
    CHECK(before.attach(5000ms));
    CHECK(before.say("unlock desk").ok());
    port.close();
    CHECK(port.open(at("port")) == Port::Opened::kYes);
    CHECK(port.write("set hold_ms 333\rtell opening 1\r"));
    Device after(port, signals, 5000ms);
    CHECK(after.attach(5000ms));
    CHECK_FALSE(after.unlocked());
    STRCMP_CONTAINS("\"value\":200,", after.say("get hold_ms json").lines.at(0).c_str());
    CHECK(after.say("log json").lines.at(0).find("OPENING") == std::string::npos);
  }
}

// Every command that a robot may send, sent as a frame to a console that nobody unlocked: of a device as it is started
// by default, and of one that was told to obey.
TEST(ConsoleTool, ObeysFramesOnlyWhenItWasToldTo) {
  for (const bool told : {false, true}) {
    if (told) more = {"--host-commands"};
    start("port");
    Signals signals;
    Port port;
    CHECK(port.open(at("port")) == Port::Opened::kYes);
    Device console(port, signals, 5000ms);
    CHECK(console.attach(5000ms));
    CHECK(until([&] { return console.say("status json").lines.at(0).find("\"state\":\"OK\"") != std::string::npos; }));
    std::uint16_t sequence = 0;
    for (const auto& [command, argument] : {std::pair{command_frame::Command::kTare, std::uint8_t{1}},
                                            {command_frame::Command::kOpening, std::uint8_t{1}},
                                            {command_frame::Command::kRelease, std::uint8_t{0}},
                                            {command_frame::Command::kArm, std::uint8_t{0}},
                                            {command_frame::Command::kGrip, std::uint8_t{1}}}) {
      std::array<std::uint8_t, command_frame::kCommandBytes> wire{};
      (void)command_frame::encode(command_frame::CommandFrame{++sequence, command, argument}, wire);
      CHECK(port.write(std::string(1, '\0').append(wire.begin(), wire.end())));
    }
    const std::string log = console.say("log json").lines.at(0);
    for (const char* const name : {"TARE", "OPENING", "RELEASE", "ARM", "GRIP"}) {
      const bool without = std::string_view(name) == "RELEASE" || std::string_view(name) == "GRIP";  // a gripper
      const std::string result = !told ? "locked" : without ? "state" : "done";
      STRCMP_CONTAINS((R"("event":"command","what":")" + std::string(name) + R"(","value":")" + result).c_str(),
                      log.c_str());
    }
    STRCMP_CONTAINS(told ? ", 0 commands refused" : ", 5 commands refused",
                    console.say("devices json").lines.at(0).c_str());
  }
}

// A card's console is on pins of its header: nothing that is shipped obeys whoever reaches them.
TEST(ConsoleTool, IsNotToldToByAnythingThatIsShipped) {
  int looked_at = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(holdfast::test::source("board"))) {
    const std::string kind = entry.path().extension().string();
    if (!entry.is_regular_file() || kind == ".cpp" || kind == ".md" || kind == ".svg") continue;
    ++looked_at;
    std::istringstream lines(read_file(entry.path().string()));
    for (std::string line; std::getline(lines, line);) {
      CHECK_TEXT(line.starts_with("#") || line.find("host-commands") == std::string::npos, entry.path().c_str());
    }
  }
  CHECK(looked_at > 30);
}

// From a pair of keys to a device that goes by what its owner signed, and by nothing else.
TEST(ConsoleTool, LoadsWhatTheOwnerSigned) {
  const auto settings = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {kTool, "settings"});
    return HostProcess(words).finish(60s);
  };
  check_fine(settings({"keygen", at("keys")}));
  LONGS_EQUAL(1, settings({"keygen", at("keys")}).status);
  write_file(dir / "robot.toml", "hold_ms = 444\n");
  check_fine(settings({"compile", at("robot.toml"), "-o", at("plain")}));
  write_file(dir / "robot.toml", "hold_ms = 555\n");
  check_fine(
      settings({"compile", at("robot.toml"), "-o", at("two"), "--sign", at("keys/owner.key"), "--sequence", "6"}));
  const Finished shown = settings({"show", at("two"), "--owner-key", at("keys/owner.pub")});
  check_fine(shown);
  STRCMP_CONTAINS("# number 6, signed by this owner\nhold_ms = 555", shown.out.c_str());
  STRCMP_CONTAINS("is not signed", settings({"show", at("plain"), "--owner-key", at("keys/owner.pub")}).err.c_str());
  STRCMP_CONTAINS("hold_ms\":444", settings({"show", at("plain"), "--json"}).out.c_str());

  firmware->send(SIGTERM);
  (void)firmware->finish();
  owner_key = at("keys/owner.pub");
  start("port");
  STRCMP_CONTAINS("what its owner signed", tool({"--run", "version"}).out.c_str());
  STRCMP_CONTAINS("is nothing that a device loads", unlocked({"--load", at("robot.toml")}).err.c_str());
  const Finished loaded = unlocked({"--load", at("two")});
  check_fine(loaded);
  STRCMP_CONTAINS("stored, number 6, signed", loaded.out.c_str());

  // A key that is gone opens nothing. (On the desk nothing starts; a board goes on with what is compiled in.)
  fs::remove(at("keys/owner.pub"));
  firmware->send(SIGKILL);
  (void)firmware->finish();
  firmware = device("port");
  const Finished refused = firmware->finish();
  CHECK(refused.status != 0);
  STRCMP_CONTAINS("cannot read the owner's key", refused.err.c_str());
}

// The card damages what the owner signed: the process holds FAULT, says why, and goes on only with what he signs anew.
TEST(ConsoleTool, LosesNoSettingsInSilence) {
  const auto damage = [&](std::streamoff at_byte) {
    std::fstream file(dir / "port.settings", std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(at_byte);
    file.put('\x55');
  };
  const auto anew = [&] {
    firmware->send(SIGKILL);
    std::string said = firmware->finish().err;
    start("port");
    return said;
  };
  // Held from the start on, or never: a busy machine may have faults of its own.
  const auto holds = [&] {
    const std::string status = tool({"--run", "status json"}).out;
    CHECK(!status.empty());
    return status.find(R"("state":"FAULT","reason":"config")") != std::string::npos;
  };
  const auto sign = [&](const char* name, const char* sequence) {
    write_file(dir / "robot.toml", "max_force = 90\n");
    check_fine(HostProcess({kTool, "settings", "compile", at("robot.toml"), "-o", at(name), "--sign",
                            at("keys/owner.key"), "--sequence", sequence})
                   .finish(60s));
  };
  check_fine(HostProcess({kTool, "settings", "keygen", at("keys")}).finish(60s));
  sign("one", "5");
  sign("two", "6");
  STRCMP_CONTAINS("not in range", HostProcess({kTool, "settings", "compile", at("robot.toml"), "-o", at("last"),
                                               "--sequence", "4294967295"})
                                      .finish(60s)
                                      .err.c_str());

  owner_key = at("keys/owner.pub");
  STRCMP_CONTAINS("the settings in force are defaults: none were ever stored\n", anew().c_str());
  CHECK_FALSE(holds());
  const Finished refused = unlocked({"--run", "set fault_markers_pct 1"});
  LONGS_EQUAL(1, refused.status);
  STRCMP_CONTAINS("ERR 38 owners_alone: fault_markers_pct: ", refused.err.c_str());
  check_fine(unlocked({"--run", "set force_step 5"}));
  check_fine(unlocked({"--load", at("one")}));
  check_fine(unlocked({"--load", at("two")}));
  (void)anew();
  CHECK_FALSE(holds());
  damage(4096 + 20);
  (void)anew();
  CHECK(holds());
  STRCMP_CONTAINS("\"value\":255", tool({"--run", "get max_force json"}).out.c_str());
  STRCMP_CONTAINS("ERR 38 owners_alone", unlocked({"--run", "stored accept"}).err.c_str());
  check_fine(unlocked({"--load", at("two")}));
  const std::string said = anew();
  STRCMP_CONTAINS("slot 2 of ", said.c_str());
  STRCMP_CONTAINS("the record's check sum is wrong\n", said.c_str());
  STRCMP_CONTAINS("the settings in force are defaults: what was stored is lost or damaged: FAULT is held. ",
                  said.c_str());
  CHECK_FALSE(holds());
  STRCMP_CONTAINS("\"value\":90", tool({"--run", "get max_force json"}).out.c_str());
}

// From a model's text to a device that decides by it, and back; and what is left when the card damages what was stored.
TEST(ConsoleTool, DecidesByTheModelThatTheOwnerSigned) {
  const auto ask = [&](std::vector<std::string> words) {
    words.insert(words.begin(), kTool);
    return HostProcess(words).finish(60s);
  };
  const auto model_of = [&](const std::string& name, const std::string& node) {
    const FeatureSet& set = *find_feature_set("velocity");
    std::string text = "format 1\nname " + name + "\nfeature_set velocity\n";
    for (int i = 0; i < set.size(); ++i) {
      text += "feature " + std::string(set[i].name) + " " + std::string(set[i].unit) + " Q" + std::to_string(set[i].q) +
              "\n";
    }
    write_file(dir / (name + ".tree"), text + "node 0: vy_um_s <= " + node);
    check_fine(ask({"compile", at((name + ".tree").c_str()), "--binary", at((name + ".model").c_str())}));
  };
  const auto seal = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"model", "seal"});
    const Finished sealed = ask(words);
    check_fine(sealed);
    return sealed.out;
  };
  const std::string largest = std::to_string((*find_feature_set("velocity"))[1].max - 1);
  model_of("always", largest + " ? 1 : 2\nleaf 1: slip\nleaf 2: hold\n");
  model_of("never", largest + " ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n");
  check_fine(ask({"settings", "keygen", at("keys")}));
  const std::string sign = at("keys/owner.key");
  STRCMP_CONTAINS("not signed: for development mode only", seal({at("always.model"), "-o", at("plain")}).c_str());
  (void)seal({at("always.model"), "-o", at("one"), "--sign", sign, "--sequence", "5"});
  (void)seal({at("never.model"), "-o", at("two"), "--sign", sign, "--sequence", "6"});
  const std::string none = seal({"--compiled-in", "-o", at("none"), "--sign", sign, "--sequence", "7", "--json"});
  STRCMP_CONTAINS(R"("sequence":7,"signed":true,"model":null})", none.c_str());

  const auto anew = [&] {
    firmware->send(SIGKILL);
    std::string said = firmware->finish().err;
    start("port");
    return said;
  };
  const auto decides = [&](const char* part) { STRCMP_CONTAINS(part, tool({"--run", "model json"}).out.c_str()); };
  owner_key = at("keys/owner.pub");
  (void)anew();
  decides(R"("from":"compiled in","sequence":null)");
  STRCMP_CONTAINS("ERR 10 locked", tool({"--load", at("one")}).err.c_str());
  STRCMP_CONTAINS("ERR 27 not_signed", unlocked({"--load", at("plain")}).err.c_str());
  STRCMP_CONTAINS("is nothing that a device loads", unlocked({"--load", at("always.model")}).err.c_str());
  const Finished loaded = unlocked({"--load", at("one")});
  check_fine(loaded);
  STRCMP_CONTAINS("stored, number 5, signed; counts at the next start: reboot", loaded.out.c_str());
  (void)anew();
  decides(R"({"name":"always","feature_set":"velocity","features":2,"nodes":3,"depth":1,)");
  decides(R"("from":"loaded","sequence":5,"next_start":"the same"})");
  CHECK(until([&] { return tool({"--run", "status json"}).out.find(R"("slip":true)") != std::string::npos; }));
  check_fine(unlocked({"--load", at("two")}));
  STRCMP_CONTAINS("ERR 29 too_old", unlocked({"--load", at("one")}).err.c_str());
  STRCMP_CONTAINS("the loaded model always decides, number 5", anew().c_str());
  decides(R"({"name":"never")");
  CHECK(until([&] {
    const std::string status = tool({"--run", "status json"}).out;
    return status.find(R"("grip_ok":true)") != std::string::npos && status.find(R"("slip":false)") != std::string::npos;
  }));

  // The card damages the newer slot: no other model decides in silence.
  std::fstream(dir / "port.model", std::ios::in | std::ios::out | std::ios::binary).seekp(8192 + 300).put('\x55');
  (void)anew();
  const std::string fell_back = anew();
  STRCMP_CONTAINS("slot 2 of ", fell_back.c_str());
  STRCMP_CONTAINS("the record's check sum is wrong. Likely cause: the power was cut", fell_back.c_str());
  STRCMP_CONTAINS("the model that is compiled in decides\n", fell_back.c_str());
  STRCMP_CONTAINS("a stored model is damaged: FAULT is held. ", fell_back.c_str());
  check_fine(unlocked({"--load", at("two")}));
  // And back.
  STRCMP_CONTAINS("ERR 27 not_signed", unlocked({"--run", "model default"}).err.c_str());
  check_fine(unlocked({"--load", at("none")}));
  (void)anew();
  decides(R"("from":"compiled in","sequence":7)");
}

TEST(ConsoleTool, SettingsAndModelsHaveAFileEach) {
  const Finished finished = HostProcess({kFirmware, "--settings", at("both"), "--models", at("both")}).finish(60s);
  LONGS_EQUAL(2, finished.status);
  STRCMP_CONTAINS("--models: names the file of --settings", finished.err.c_str());
  CHECK_FALSE(fs::exists(dir / "both"));
}

TEST(ConsoleTool, SealsAndShowsModels) {
  const auto ask = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {kTool, "model"});
    return HostProcess(words).finish(60s);
  };
  const auto refused = [&](std::vector<std::string> words, const char* said) {
    const Finished finished = ask(std::move(words));
    LONGS_EQUAL(1, finished.status);
    for (const char* const part : {said, ". Likely cause: ", ". Next: "}) STRCMP_CONTAINS(part, finished.err.c_str());
  };
  const std::string text = holdfast::test::source("toolchain/model/slip_v1.tree");
  check_fine(HostProcess({kTool, "compile", text, "--binary", at("m")}).finish(60s));
  check_fine(HostProcess({kTool, "settings", "keygen", at("keys")}).finish(60s));
  const std::string key = at("keys/owner.key"), pub = at("keys/owner.pub");
  const Finished sealed = ask({"seal", at("m"), "-o", at("s"), "--sign", key, "--sequence", "9", "--json"});
  check_fine(sealed);
  STRCMP_CONTAINS(R"("sequence":9,"signed":true,"model":{"name":"slip_v1","feature_set":"paper",)", sealed.out.c_str());
  LONGS_EQUAL(5380, fs::file_size(dir / "s"));
  const Finished shown = ask({"show", at("s"), "--owner-key", pub});
  check_fine(shown);
  STRCMP_CONTAINS("slip_v1, CRC-32 of its text ", shown.out.c_str());
  STRCMP_CONTAINS("; number 9, signed by this owner\n", shown.out.c_str());
  STRCMP_CONTAINS(R"({"sequence":9,"signed":true,"model":{"name":"slip_v1")",
                  ask({"show", at("s"), "--json"}).out.c_str());
  STRCMP_CONTAINS("number 9, signed\n", ask({"show", at("s")}).out.c_str());
  check_fine(ask({"seal", "--compiled-in", "-o", at("none")}));
  STRCMP_CONTAINS("the model that is compiled in; number ", ask({"show", at("none")}).out.c_str());
  STRCMP_CONTAINS(", not signed\n", ask({"show", at("none")}).out.c_str());
  STRCMP_CONTAINS(R"("signed":false,"model":null})", ask({"show", at("none"), "--json"}).out.c_str());

  refused({"show", at("none"), "--owner-key", pub}, "is not signed");
  refused({"show", at("none"), "--owner-key", key}, "owner.key");
  check_fine(HostProcess({kTool, "settings", "keygen", at("others")}).finish(60s));
  refused({"show", at("s"), "--owner-key", at("others/owner.pub")}, "is not signed by this owner");
  refused({"show", at("m")}, "holds no model");
  refused({"show", at("absent")}, "cannot be read");
  refused({"seal", text, "-o", at("x")}, "is no compiled model");
  refused({"seal", at("absent"), "-o", at("x")}, "cannot be read");
  refused({"seal", at("m"), "-o", at("x"), "--sign", pub}, "is no key to sign with");
  const std::string secret = read_file(key);
  refused({"seal", at("m"), "-o", at("keys/../keys/owner.key"), "--sign", key}, "-o would change an input");
  STRCMP_EQUAL(secret.c_str(), read_file(key).c_str());
  refused({"seal", at("m"), "--compiled-in", "-o", at("x")}, "either a compiled model or --compiled-in");
  refused({"seal", "-o", at("x")}, "either a compiled model or --compiled-in");
  // JSON is UTF-8, and a name need not be.
  const Finished odd = ask({"seal", at("m"), "-o", at("\xFF"), "--json"});
  check_fine(odd);
  CHECK_TRUE(nlohmann::json::parse(odd.out)["output"].get<std::string>().ends_with("\xEF\xBF\xBD"));
  STRCMP_CONTAINS("absent/x", ask({"seal", at("m"), "-o", at("absent/x")}).err.c_str());
  STRCMP_CONTAINS("-o would change an input", ask({"seal", at("m"), "-o", at("m")}).err.c_str());
  std::string whole = read_file(at("s"));
  whole[3000] = static_cast<char>(whole[3000] ^ 1);
  write_file(dir / "damaged", whole);
  refused({"show", at("damaged")}, "holds no model");
  write_file(dir / "large", std::string(100'000, 'x'));
  refused({"show", at("large")}, "is larger than any model");
  write_file(dir / "robot.toml", "hold_ms = 444\n");
  check_fine(HostProcess({kTool, "settings", "compile", at("robot.toml"), "-o", at("settings")}).finish(60s));
  refused({"show", at("settings")}, "a record of another kind");
  CHECK_FALSE(fs::exists(dir / "x"));
}

TEST(ConsoleTool, RecordsATable) {
  const Finished finished = tool({"--record", at("log.csv"), "--seconds", "1.5"});
  check_fine(finished);
  (void)check_time_runs(read_file(at("log.csv")), 20);
  STRCMP_CONTAINS("with markers", finished.out.c_str());
}

TEST(ConsoleTool, EndsARecordInOrder) {
  HostProcess recorder({kTool, "console", at("port"), "--record", at("log.csv")});
  CHECK(until([&] { return rows_of("log.csv"); }));
  {
    // The port is taken meanwhile.
    const Finished busy = tool({"--run", "version"});
    LONGS_EQUAL(1, busy.status);
    STRCMP_CONTAINS("is busy. Likely cause: ", busy.err.c_str());
  }
  recorder.send(SIGINT);
  check_fine(recorder.finish());
  (void)check_time_runs(read_file(at("log.csv")), 20);
  CHECK_FALSE(rows_of("log.csv"));
}

TEST(ConsoleTool, RecordsMarkers) {
  check_fine(tool({"--record", at("log.mcap"), "--seconds", "1.5"}));
  const std::string bytes = read_file(at("log.mcap"));
  double last = -1;
  int frames = 0;
  log::FrameVisit visit;
  visit.slip = [&](const log::FrameRecord& state) {
    const double t = state.header.stamp.sec + state.header.stamp.nanosec * 1e-9;
    CHECK(t > last);
    last = t;
    ++frames;
  };
  const log::McapFile file =
      log::read_frames({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, visit);
  CHECK(file.faults.empty());
  CHECK(frames >= 10);
  std::uint64_t markers = 0;
  for (const auto& [id, channel] : file.channels) {
    if (channel.topic == log::kMarkersTopic && file.told.contains(id)) markers = file.told.at(id).messages;
  }
  CHECK(markers >= 2);
  CHECK(markers <= static_cast<std::uint64_t>(frames) / 5 + 2);
}

// A file that may not grow is to a program what a full disk is.
TEST(ConsoleTool, KeepsTheRowsThatADiskTook) {
  // dash: in blocks of 512 bytes
  const Finished cut = HostProcess({"sh", "-c", "ulimit -f 8; exec \"$@\"", "sh", kTool, "console", at("port"),
                                    "--record", at("log.csv"), "--seconds", "50"})
                           .finish(30s);
  LONGS_EQUAL(1, cut.status);  // long before its time
  const std::string table = read_file(at("log.csv"));
  CHECK(table.size() <= 4096);
  (void)check_time_runs(table, 5);
  const std::string frames = std::to_string(std::ranges::count(table, '\n') - 1);
  STRCMP_CONTAINS(("log.csv: the recording ended early, because a write failed; its first " + frames +
                   " frames are kept. Likely cause: the disk is full")
                      .c_str(),
                  cut.err.c_str());
  STRCMP_CONTAINS(". Next: free some space", cut.err.c_str());
}

TEST(ConsoleTool, RefusesWhatCannotBeRecorded) {
  test::check_says(tool({"--record", at("log.txt")}).err.substr(0, tool({"--record", at("log.txt")}).err.size() - 1),
                   {"is neither .csv nor .mcap"});
  LONGS_EQUAL(1, tool({"--record", at("no/such/folder.csv")}).status);
  LONGS_EQUAL(1, tool({"--record", at("a.csv"), "--run", "version"}).status);
  LONGS_EQUAL(1, tool({"--seconds", "3", "--run", "version"}).status);
}

TEST(ConsoleTool, SaysWhyAPortIsNone) {
  const auto error_of = [](const std::string& port) {
    const Finished finished = HostProcess({kTool, "console", port, "--run", "version", "--timeout", "0.5"}).finish(60s);
    LONGS_EQUAL(1, finished.status);
    return finished.err.substr(0, finished.err.find('\n'));
  };
  test::check_says(error_of(at("nowhere")), {"cannot be opened"});
  test::check_says(error_of(at("code")), {"is no serial port"});
  const test::Pty mute;
  test::check_says(error_of(mute.path()), {"does not answer as a Holdfast"});
}

// The whole of what finding does, on ports that a tree of files names as the kernel would.
TEST(ConsoleTool, FindsTheOnePortThatAnswers) {
  devices::Places places;
  places.sys = at("sys");
  places.dev = at("dev");
  places.proc = at("proc");
  places.may_use = [](const std::string&) { return true; };
  const auto plug = [&](const std::string& name, const std::string& target) {
    fs::create_directories(dir / ("sys/class/tty/" + name + "/device"));
    fs::create_directories(dir / "dev");
    fs::create_symlink(target, dir / ("dev/" + name));
  };
  Signals signals;
  const auto find = [&] { return console_tool::find_device(places, signals, 700ms); };
  test::check_says(find().error, {"there is no serial port"});

  const test::Pty mute;
  plug("ttyUSB0", mute.path());
  test::check_says(find().error, {"no port answers as a Holdfast", "ttyUSB0 stay silent"});
  plug("ttyACM0", fs::read_symlink(dir / "port").string());
  plug("ttyS0", fs::read_symlink(dir / "port").string());  // a computer's own plug: not asked
  STRCMP_EQUAL("", find().error.c_str());
  STRCMP_EQUAL(at("dev/ttyACM0").c_str(), find().path.c_str());
  // By the name that stays.
  fs::create_directories(dir / "dev/serial/by-id");
  fs::create_symlink("../../ttyACM0", dir / "dev/serial/by-id/usb-holdfast");
  STRCMP_EQUAL(at("dev/serial/by-id/usb-holdfast").c_str(), find().path.c_str());

  const std::unique_ptr<HostProcess> other = device("other");
  CHECK(until([&] { return fs::exists(at("other")); }));
  plug("ttyACM1", fs::read_symlink(dir / "other").string());
  test::check_says(find().error, {"2 devices answer: ", "usb-holdfast", "ttyACM1"});

  Port held;
  CHECK(held.open(at("dev/ttyACM1")) == Port::Opened::kYes);
  STRCMP_EQUAL("", find().error.c_str());
  Port held_too;
  CHECK(held_too.open(at("dev/ttyACM0")) == Port::Opened::kYes);
  test::check_says(find().error, {"no free port answers as a Holdfast", "is busy"});
}

// Whatever stands there: half a line, a command that runs, a stream of frames.
TEST(ConsoleTool, AttachesInTheMiddleOfAnything) {
  Signals signals;
  for (const char* const left : {"stat", "watch on\r", "trace on\r", "log frames markers\r", "\x1B[", "unlock x\r",
                                 "version json\rversion json\rhelp\r"}) {
    Port port;
    CHECK(port.open(at("port")) == Port::Opened::kYes);
    CHECK(port.write(left));
    Device console(port, signals, 5000ms);
    CHECK_TEXT(console.attach(5000ms), left);
    for (int k = 0; k < 3; ++k) {
      const console_tool::Answer answer = console.say("get hold_ms json");
      CHECK_TEXT(answer.ok(), left);
      LONGS_EQUAL(1, answer.lines.size());
      CHECK_TEXT(answer.lines[0].starts_with("{\"parameters\":[{\"name\":\"hold_ms\""), answer.lines[0].c_str());
    }
  }
}

TEST(ConsoleTool, SendsOneLineAsOne) {
  Signals signals;
  Port port;
  CHECK(port.open(at("port")) == Port::Opened::kYes);
  Device console(port, signals, 5000ms);
  CHECK(console.attach(5000ms));
  CHECK(console.say("version\rreboot").kind == console_tool::Answer::Kind::kError);
  CHECK(console.say("get\thold_ms").ok());
  LONGS_EQUAL(2, console.say(std::string(300, 'x')).number());
  LONGS_EQUAL(3, console.say("version \xC3\xA4").number());
}

// The port goes while a table is recorded, and comes back under the same name.
TEST(ConsoleTool, GoesOnWhenThePortIsBack) {
  HostProcess recorder({kTool, "console", at("port"), "--record", at("log.csv")});
  CHECK(until([&] { return rows_of("log.csv"); }));
  firmware->send(SIGKILL);
  (void)firmware->finish();
  CHECK(recorder.err_says("has gone. Likely cause: "));
  start("port");
  CHECK(recorder.err_says("is back"));
  const auto bytes = [&] {
    std::uintmax_t sum = 0;
    for (const fs::directory_entry& entry : fs::directory_iterator(dir.path())) {
      if (entry.path().filename().string().starts_with("log.csv.tmp")) sum += entry.file_size();
    }
    return sum;
  };
  CHECK(until([&, before = bytes()] { return bytes() > before + 8'000; }));
  recorder.send(SIGINT);
  LONGS_EQUAL(0, recorder.finish().status);
  CHECK(check_time_runs(read_file(at("log.csv")), 50) > 0.1);  // the time it was away is in it
}

// The port stays and the firmware stands still: said, and no success at the end; what came is kept.
TEST(ConsoleTool, SaysThatADeviceStandsStillWhileItIsRecorded) {
  HostProcess recorder({kTool, "console", at("port"), "--record", at("log.csv")});
  CHECK(until([&] { return rows_of("log.csv"); }));
  firmware->send(SIGSTOP);
  CHECK(recorder.err_says("does not answer. Likely cause: the firmware hangs"));
  firmware->send(SIGCONT);
  CHECK(recorder.err_says("answers again"));
  firmware->send(SIGSTOP);
  recorder.send(SIGINT);
  const Finished ended = recorder.finish();
  LONGS_EQUAL(1, ended.status);
  STRCMP_CONTAINS("did not answer any more", ended.err.c_str());
  CHECK(fs::file_size(at("log.csv")) > 0);
}

// What answers need be no Holdfast: it moves no cursor, and its words are no numbers.
TEST(ConsoleTool, TakesNothingOnTrustThatADeviceSays) {
  const test::Pty pty;
  termios raw = pty.settings();
  ::cfmakeraw(&raw);
  CHECK(::tcsetattr(pty.master(), TCSANOW, &raw) == 0);
  std::atomic<bool> over{false};
  std::thread impostor([&] {
    std::string line;
    while (!over) {
      pollfd entry{pty.master(), POLLIN, 0};
      (void)::poll(&entry, 1, 20);
      for (const std::uint8_t byte : pty.take()) {
        if (byte != '\r') {
          if (byte >= ' ') line += static_cast<char>(byte);
          continue;
        }
        std::string answer;
        if (line == "version json") answer = R"({"firmware":1})";
        if (line == "version") answer = "\x1B]0;mine\x07";
        if (line == "reference json") answer = R"({"known":"yes","pitch_printed_um":[],"pitch_px":{}})";
        if (line.starts_with("get ")) answer = R"({"parameters":[{"value":"wide"}]})";
        if (!answer.empty()) answer.append("\r\n");
        if (line.starts_with("help anybody")) {
          answer.append("ERR 4 arguments: ").append(line, 5).append("\r\n");
        } else {
          answer.append("OK\r\n");
        }
        (void)pty.send({answer.begin(), answer.end()});
        line.clear();
      }
    }
  });
  const Finished run = HostProcess({kTool, "console", pty.path(), "--run", "version"}).finish(60s);
  const Finished recorded =
      HostProcess({kTool, "console", pty.path(), "--record", at("log.csv"), "--seconds", "0.3"}).finish(60s);
  over = true;
  impostor.join();
  STRCMP_EQUAL("?]0;mine?\n", run.out.c_str());
  CHECK_TEXT(recorded.err.find("exception") == std::string::npos, recorded.err.c_str());
  STRCMP_CONTAINS("no frame came", recorded.err.c_str());
}

// Half a line stands there, which a hang-up would have cleared: whoever only looks does not see the code.
TEST(ConsoleTool, APageOfABoardShowsNoCode) {
  const int other = ::open(at("port").c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  CHECK(other >= 0 && ::write(other, "sta", 3) == 3);
  HostProcess live(
      {"/bin/sh", "-c", R"(exec "$@" >"$0")", at("live.out"), kTool, "live", "--board", at("port"), "--port", "0"});
  std::string out;
  CHECK(until([&] { return (out = read_file(at("live.out"))).find("to look   http") != std::string::npos; }));
  const auto address = [&out](std::string_view name) {
    const std::size_t begin = out.find(name) + 10;
    return out.substr(begin, out.find('\n', begin) - begin);
  };
  test::Http looks(address("to look   "), "GET /stream");
  CHECK(looks.says("X-Holdfast-Controls: no"));
  for (const char* const line : {"unlock desk", "echo on", "unlock desk", "status json"}) {
    CHECK(test::Http(address("page      "), "POST /send", {}, line).says(" 204 "));
  }
  CHECK_TEXT(looks.says("\"unlocked\":true"), looks.said.c_str());
  CHECK(looks.said.find("desk") == std::string::npos);
  live.send(SIGINT);
  LONGS_EQUAL(0, live.finish().status);
  // Locked, and with an echo for people.
  check_fine(tool({"--run", "version"}));
  STRCMP_CONTAINS("\"unlocked\":false", tool({"--run", "status json"}).out.c_str());
  ::close(other);
}

// Whoever opens the port next, by whatever program, finds it as it was.
TEST(ConsoleTool, LeavesThePortAsItWas) {
  const test::Pty pty;
  termios before = pty.settings();
  before.c_lflag |= ECHO | ICANON;
  Signals signals;
  {
    Port port;
    CHECK(port.open(pty.path()) == Port::Opened::kYes);
    CHECK((pty.settings().c_lflag & (ECHO | ICANON | ISIG)) == 0);
    Port second;
    CHECK(second.open(pty.path()) == Port::Opened::kBusy);
  }
  LONGS_EQUAL(before.c_lflag & (ECHO | ICANON | ISIG), pty.settings().c_lflag & (ECHO | ICANON | ISIG));
}
