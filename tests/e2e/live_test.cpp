// SPDX-License-Identifier: Apache-2.0
// The sensor on a PC without a sensor: `holdfast live`, `holdfast record` and `holdfastd --play` as processes, over
// scenes. (The page in a browser: tests/npm/check_live.mjs.)
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/deadline.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

#include "tests/support/error_line.hpp"

namespace {

using namespace holdfast;
using holdfast::test::kFirmware;
using holdfast::test::kTool;
using test::Finished;
using test::HostProcess;
using test::read_file;
using test::until;
using Words = std::vector<std::string>;

const std::string kSlip = holdfast::test::source("tests/scenes/sphere_slip.json");

}  // namespace

TEST_GROUP(LiveTool) {
  test::TempDir dir;
  [[nodiscard]] std::string in(const std::string& name) const {
    return (dir / name).string();
  }
  static Finished tool(const Words& words) {
    Words command{kTool};
    command.insert(command.end(), words.begin(), words.end());
    return test::run(command);
  }
  static void refuses(const Words& words, const char* what, int status = 1) {
    const Finished done = tool(words);
    LONGS_EQUAL(status, done.status);
    test::check_says(done.err.substr(0, done.err.find_last_not_of('\n') + 1), {what});
  }
};

// The recording is what the run saw and decided: the same pictures, in the firmware again, decide the same lattice.
TEST(LiveTool, RecordsWhatItSeesAndDecides) {
  const Finished made = tool({"record", in("a.mcap"), "--play", kSlip, "--seconds", "2.4"});
  CHECK_TEXT(made.status == 0, made.err.c_str());
  STRCMP_CONTAINS("SLIP (slip)  by ", made.out.c_str());
  STRCMP_CONTAINS("recorded  ", made.out.c_str());
  STRCMP_EQUAL("", made.err.c_str());
  const Finished info = tool({"log", "info", in("a.mcap"), "--json"});
  CHECK_TEXT(info.status == 0, info.err.c_str());
  const auto log = nlohmann::json::parse(info.out);
  for (const auto& channel : log["channels"]) CHECK(channel["messages"].get<int>() > 40);
  LONGS_EQUAL(4, log["channels"].size());                                    // slip, markers, camera, annotations
  CHECK(log["first_ns"].get<std::uint64_t>() > 1'700'000'000'000'000'000U);  // the wall clock: after 2023
  CHECK_TEXT(tool({"log", "export", in("a.mcap"), "--csv", in("a.csv")}).status == 0, "export");
  const std::string csv = read_file(dir / "a.csv");
  STRCMP_CONTAINS("\n0.000000,", csv.c_str());  // a table counts from its first frame
  CHECK(read_file(dir / "a.mcap").find("sphere_slip.json") != std::string::npos);  // what it is of
  const Finished again = tool({"replay", in("a.mcap"), "--reference", "first", "--json"});
  CHECK_TEXT(again.status == 0, again.err.c_str());
  CHECK(nlohmann::json::parse(again.out)["frames"].get<int>() > 40);
}

TEST(LiveTool, EndsInOrderAndPutsTheRecordingInItsPlace) {
  for (const int signal : {SIGINT, SIGHUP}) {  // the second: its terminal is closed
    HostProcess running({kTool, "record", in("b.mcap"), "--play", kSlip});
    CHECK(until([&] { return read_file(dir / ("b.mcap.tmp-" + std::to_string(running.pid()))).size() > 8; }));
    running.send(signal);
    const Finished done = running.finish();
    LONGS_EQUAL(0, done.status);
    CHECK_TEXT(tool({"log", "info", in("b.mcap")}).status == 0, "a whole file");
    std::filesystem::remove(dir / "b.mcap");
  }
}

// A file that may not grow is to a program what a full disk is: said at once, and what came before is a whole file.
TEST(LiveTool, KeepsWhatADiskTookAndSaysSoAtOnce) {
  const auto limited = [&](const Words& words) {
    Words command{"sh", "-c", "ulimit -f 4000; exec \"$@\"", "sh", kTool};  // dash: 2 MB
    command.insert(command.end(), words.begin(), words.end());
    return command;
  };
  const auto kept = [&](const std::string& err, const std::string& name) {
    STRCMP_CONTAINS((name + ": the recording ended early, because a write failed; its first ").c_str(), err.c_str());
    STRCMP_CONTAINS("Likely cause: the disk is full", err.c_str());
    STRCMP_CONTAINS("Next: free some space", err.c_str());
    const Finished info = tool({"log", "info", in(name), "--json"});
    LONGS_EQUAL_TEXT(0, info.status, info.err.c_str());
    long frames = 0;
    const auto log = nlohmann::json::parse(info.out);
    for (const auto& channel : log["channels"]) {
      if (channel["topic"] == "/holdfast/slip") frames = channel["messages"].get<long>();
    }
    CHECK(frames > 0);
    STRCMP_CONTAINS(("first " + std::to_string(frames) + " frames are kept").c_str(), err.c_str());
    CHECK(read_file(dir / name).find("sphere_slip.json") != std::string::npos);  // what it is of
    CHECK(std::filesystem::file_size(dir / name) <= 4000 * 512);
  };
  const Finished cut = HostProcess(limited({"record", in("a.mcap"), "--play", kSlip})).finish();
  LONGS_EQUAL(1, cut.status);  // by itself
  kept(cut.err, "a.mcap");

  HostProcess page(limited({"live", "--record", in("b.mcap"), "--play", kSlip, "--port", "0"}));
  CHECK(page.err_says("b.mcap: the recording ended early"));
  page.send(SIGINT);
  const Finished looked = page.finish();
  LONGS_EQUAL(1, looked.status);
  kept(looked.err, "b.mcap");
}

TEST(LiveTool, SaysWhatItCannotDo) {
  STRCMP_CONTAINS("absent.avi: ", tool({"live", "--play", in("absent.avi")}).err.c_str());
  STRCMP_CONTAINS("none/a.mcap: cannot be written",
                  tool({"record", in("none/a.mcap"), "--play", kSlip, "--seconds", "1"}).err.c_str());
  refuses({"live", "--play", kSlip, "--grid", "auto"}, "--grid auto");
  test::write_file(dir / "in.mcap", "mine");
  for (const char* const option : {"--play", "--model"}) {
    refuses({"record", in("in.mcap"), option, in("none/../in.mcap")}, "would change an input");
    refuses({"live", "--record", in("in.mcap"), option, in("in.mcap"), "--seconds", "1"}, "would change an input");
  }
  STRCMP_EQUAL("mine", read_file(dir / "in.mcap").c_str());
  for (const Words& own : {Words{"--play", kSlip}, Words{"--mode", "fast"}, Words{"--record", in("r.mcap")}}) {
    refuses({"live", "--board", in("tty"), own[0], own[1]}, "--board");
  }
  refuses({"live", "--board", in("tty")}, "tty");
  refuses({"record", in("a.mcap"), "--sensor", "0000-0000", "--seconds", "1"}, "GelSight Mini");
  // A port that another one has: this test.
  const int taken = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in here{};
  here.sin_family = AF_INET;
  here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(here);
  auto* const address = reinterpret_cast<sockaddr*>(&here);
  CHECK(::bind(taken, address, size) == 0 && ::listen(taken, 1) == 0 && ::getsockname(taken, address, &size) == 0);
  const std::string port = std::to_string(ntohs(here.sin_port));
  refuses({"live", "--play", kSlip, "--port", port, "--seconds", "1"}, "of 127.0.0.1 cannot be had");
  ::close(taken);
}

// A file of somebody else's that was given for one of the firmware's stays as it is, and so does a link.
TEST(LiveTool, TheFirmwareAsAProcessTakesNoFileThatIsNotItsOwn) {
  test::write_file(dir / "mine", "RIFF of somebody's");
  std::filesystem::create_symlink("mine", dir / "link");
  for (const auto& [option, name] : {std::pair{"--models", "mine"},
                                     {"--settings", "mine"},
                                     {"--keep", "mine"},
                                     {"--host", "link"},
                                     {"--link", "link"},
                                     {"--gripper", "link"}}) {
    const Finished done = test::run({kFirmware, "--real-time", "--empty", "--seconds", "0.2", option, in(name)});
    LONGS_EQUAL_TEXT(option == std::string("--keep") ? 0 : 1, done.status, option);  // without it nothing is kept
    STRCMP_CONTAINS(in(name).c_str(), done.err.c_str());
    STRCMP_CONTAINS(". Next: give", done.err.c_str());
    STRCMP_EQUAL("RIFF of somebody's", read_file(dir / "mine").c_str());
    STRCMP_EQUAL("mine", std::filesystem::read_symlink(dir / "link").c_str());
  }
  // The link of a run that was killed.
  std::filesystem::create_symlink("/dev/pts/none", dir / "port");
  const Finished anew = test::run({kFirmware, "--real-time", "--empty", "--seconds", "0.2", "--host", in("port")});
  CHECK_TEXT(anew.status == 0, anew.err.c_str());
}

TEST(LiveTool, TheFirmwareAsAProcessPlaysASceneToo) {
  const Finished done = test::run({kFirmware, "--play", kSlip, "--seconds", "2.4"});
  CHECK_TEXT(done.status == 0, done.err.c_str());
  STRCMP_CONTAINS("SLIP slip", done.out.c_str());
  const Finished absent = test::run({kFirmware, "--play", in("absent.avi")});
  LONGS_EQUAL(2, absent.status);
}
