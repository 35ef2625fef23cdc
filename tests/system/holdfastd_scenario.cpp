// SPDX-License-Identifier: Apache-2.0
// holdfastd as its unit on the emulated machine, seen as the robot's controller sees it: by its lines, its gripper and
// its text. Times are those of board/virt, twenty times those of a board.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include <nlohmann/json.hpp>

#include "app/camera_keeper.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/system/scenario.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

using test::Machine;
using test::Moment;
using test::Span;

constexpr int kGripOk = 0, kAlive = 1;
constexpr std::size_t kRight = 1;  // of the machine's cameras
constexpr const char *kLeftSerial = "2BNN4ZE7", *kRightSerial = "28D3K2R9";
constexpr Span kRule = 20 * 150ms;  // the receiver's, at this board's time
constexpr Span kToOk = 3min;
// From where the film's object begins to slide. On the host the third of them is the one (replay of the same film), one
// more is in the sensor's hands, and two are this observer's.
constexpr long kToTellSlip = 6;

}  // namespace

TEST_GROUP(Holdfastd) {
  // The second sensor is plugged in by the tests that want it.
  Machine& machine = test::shared_machine("holdfastd", {.right_film = test::film_path()});

  void setup() override {
    CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
    camera("play 0 11");  // an empty gel
  }
  void camera(const std::string& command, std::size_t which = 0) {
    STRCMP_CONTAINS("ok", machine.camera(command, which).c_str());
  }
  void right(const std::string& command) {
    camera(command, kRight);
  }
  std::string said(const std::string& command) {
    const Machine::Said answer = machine.run(command);
    LONGS_EQUAL_TEXT(0, answer.status, (command + ": " + answer.text).c_str());
    return answer.text;
  }
  std::string journal() {
    return machine.run("journalctl -u holdfastd -o cat --no-pager | tail -n 20").text;
  }

  // GRIP_OK and the last edge of ALIVE younger than the rule allows.
  bool fine() {
    const auto& edges = machine.edges();
    const auto last = std::find_if(edges.rbegin(), edges.rend(), [](const auto& edge) { return edge.line == kAlive; });
    return machine.level(kGripOk) && last != edges.rend() && std::chrono::steady_clock::now() - last->at < kRule;
  }
  long sent(std::size_t which = 0) {
    const std::string status = machine.camera("status", which);
    return std::atol(status.substr(status.find("frames=") + 7).c_str());
  }
  // The camera shows it.
  void await_picture(int picture, std::size_t which = 0) {
    const std::string shown = " picture=" + std::to_string(picture) + " ";
    CHECK(machine.wait([&] { return machine.camera("status", which).find(shown) != std::string::npos; }, 2min));
  }
  // The camera sends so many frames more.
  void frames_pass(long frames) {
    const long until = sent() + frames;
    CHECK(machine.wait([&] { return sent() >= until; }, frames * 1s + 60s));
  }
  // Edges of ALIVE since forget_edges().
  long confirmed() {
    return std::count_if(machine.edges().begin(), machine.edges().end(),
                         [](const auto& edge) { return edge.line == kAlive; });
  }
  int restarts() {
    return std::atoi(said("systemctl show -P NRestarts holdfastd").c_str());
  }
  std::string pid() {
    return said("systemctl show -P MainPID holdfastd");
  }
  // Beside the unit's own lines, these; none: as it is shipped. Counts from the next start on.
  void change_unit(const std::string& lines) {
    const std::string folder = "/run/systemd/system/holdfastd.service.d";
    said("rm -rf " + folder + " && mkdir -p " + folder);
    if (!lines.empty()) said("printf '[Service]\\n" + lines + "' > " + folder + "/test.conf");
    said("systemctl daemon-reload");
  }
  // What the console says to a line, up to its `answer`.
  std::string asks(const std::string& line, const char* answer) {
    machine.diagnostics().clear();
    machine.type(line + "\r");
    CHECK_TEXT(machine.wait([&] { return machine.diagnostics().find(answer) != std::string::npos; }, 1min),
               machine.diagnostics().c_str());
    return machine.diagnostics();
  }
  nlohmann::json asks_json(const std::string& line) {
    const std::string said = asks(line + " json", "}\r\nOK\r\n");
    const std::size_t begin = said.find("\n{") + 1;
    nlohmann::json json = nlohmann::json::parse(said.substr(begin, said.find('\r', begin) - begin), nullptr, false);
    CHECK_TEXT(json.is_object(), said.c_str());
    return json;
  }
  // With these options in place of those of /etc/holdfast/holdfastd.conf; none: with those again.
  void restart_with(const std::string& options) {
    const std::string file = "/run/holdfastd-test.conf";
    if (!options.empty()) said("echo 'HOLDFASTD_OPTIONS=" + options + "' > " + file);
    change_unit(options.empty() ? "" : "EnvironmentFile=" + file + "\\n");
    machine.diagnostics().clear();
    said("systemctl restart holdfastd");
    machine.forget_edges();
  }
  void restart_as_hand(const std::string& left_serial, const std::string& right_serial) {
    // As `devices` numbers them.
    const auto number = [](std::string_view serial) { return std::to_string(camera_keeper::number_of(serial)); };
    restart_with("--sensor " + left_serial + " --right " + right_serial + " --host /dev/ttyS1 --set left_sensor=" +
                 number(kLeftSerial) + " --set right_sensor=" + number(kRightSerial));
  }
  void use_libcamera(const std::string& options) {
    change_unit("ExecStart=\\nExecStart=/usr/bin/holdfastd --backend libcamera " + options + " $HOLDFASTD_OPTIONS\\n");
    said("cp /usr/share/holdfast/libcamera.conf /run/systemd/system/holdfastd.service.d/ && systemctl daemon-reload");
    said("systemctl restart holdfastd");
  }
  // Nothing that the receiver may call fine, as soon as the rule demands.
  void stop_being_fine() {
    const Moment since = std::chrono::steady_clock::now();
    CHECK(machine.wait([this] { return !fine(); }, kRule + 1s));
    std::printf(" not fine after %.1f s;", seconds_since(since));
  }
  static double seconds_since(Moment since) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
  }
  void become_fine() {
    const Moment since = std::chrono::steady_clock::now();
    const bool is = machine.wait([this] { return fine(); }, kToOk);
    CHECK_TEXT(is, is ? "" : journal().c_str());
    std::printf(" fine after %.1f s;", seconds_since(since));
  }
};

// Calls of libc's allocator by holdfastd's threads while the camera sends so many frames: probes of the kernel in the
// library, so the process is the one that is shipped.
long heap_calls(Machine& machine, const std::string& pid, long frames) {
  const auto said = [&](const std::string& command) {
    const Machine::Said answer = machine.run(command);
    LONGS_EQUAL_TEXT(0, answer.status, (command + ": " + answer.text).c_str());
    return answer.text;
  };
  const std::string libc = holdfast::test::source("build/sysroot-aarch64/lib/aarch64-linux-gnu/libc.so.6");
  const std::string symbols = test::run({"aarch64-linux-gnu-readelf", "--dyn-syms", "-W", libc}).out;
  said("mountpoint -q /sys/kernel/tracing || mount -t tracefs none /sys/kernel/tracing");
  said("cd /sys/kernel/tracing && echo 0 > tracing_on && echo > uprobe_events && echo > trace");
  for (const std::string name : {"malloc", "calloc", "realloc", "memalign", "aligned_alloc", "posix_memalign"}) {
    std::string symbol = " ";
    symbol += name;
    const std::size_t at = symbols.find(symbol += "@@");
    CHECK_TEXT(at != std::string::npos, name.c_str());
    const std::size_t line = symbols.rfind('\n', at);
    std::string probe = "echo 'p:heap/";
    probe += name;
    probe += " /usr/lib/aarch64-linux-gnu/libc.so.6:0x";
    probe += symbols.substr(symbols.find(": ", line) + 2, 16);
    said(probe += "' >> /sys/kernel/tracing/uprobe_events");
  }
  said("f=; for t in /proc/" + pid +
       "/task/*; do f=\"$f${f:+ || }common_pid == ${t##*/}\"; done; cd /sys/kernel/tracing; echo \"$f\" > "
       "events/heap/filter && echo 1 > events/heap/enable && echo 1 > tracing_on");
  const auto sent = [&] {
    const std::string status = machine.camera("status");
    return std::atol(status.substr(status.find("frames=") + 7).c_str());
  };
  const long until = sent() + frames;
  CHECK(machine.wait([&] { return sent() >= until; }, frames * 1s + 60s));
  const long calls = std::atol(said("cd /sys/kernel/tracing; echo 0 > tracing_on; grep -cv '^#' trace; true").c_str());
  said("cd /sys/kernel/tracing; echo 0 > events/heap/enable; echo > uprobe_events");
  return calls;
}

TEST(Holdfastd, StartsAndBecomesFineOnAnEmptyGel) {
  become_fine();
  STRCMP_EQUAL("active", said("systemctl is-active holdfastd").c_str());
  STRCMP_CONTAINS(" s after the kernel started",
                  said("journalctl -u holdfastd -o cat | grep 'first frame fine '").c_str());
  // As the vendor's script sets them.
  const std::string settings = machine.camera("status");
  STRCMP_CONTAINS(" exposure_auto=1 exposure_absolute=180 ", settings.c_str());
}

// Empty, pressed and held: fine all the time. Then it slides: LOW.
TEST(Holdfastd, ASlipIsAnEdge) {
  become_fine();
  camera("play 12 37 then 36 37");
  await_picture(37);
  CHECK_TEXT(fine(), journal().c_str());
  machine.forget_edges();
  const long before = sent();
  camera("play 38 82 then 0 11");
  const auto low = [this] {
    return std::any_of(machine.edges().begin(), machine.edges().end(),
                       [](const auto& edge) { return edge.line == kGripOk && !edge.high; });
  };
  CHECK_TEXT(machine.wait(low, 1min), journal().c_str());
  const long pictures = sent() - before;
  std::printf(" LOW %ld pictures after the slide began;", pictures);
  CHECK(pictures <= kToTellSlip);
  await_picture(5);
  become_fine();
}

TEST(Holdfastd, GoesOnAfterAReplug) {
  become_fine();
  const int before = restarts();
  camera("unplug");
  stop_being_fine();
  camera("plug");
  become_fine();
  LONGS_EQUAL(before, restarts());
}

// From within a sandbox of its own, which leaves it that port alone.
TEST(Holdfastd, GoesOnAfterItsPortWasReset) {
  become_fine();
  const int before = restarts();
  said("dmesg --clear && systemctl start holdfast-sensor");
  STRCMP_CONTAINS("reset", said("dmesg | grep -i usb").c_str());
  become_fine();
  LONGS_EQUAL(before, restarts());
}

// Single frames that lost data are skipped, without an edge; while nothing else comes there is nothing to confirm.
TEST(Holdfastd, SkipsDamagedFrames) {
  become_fine();
  const int before = restarts();
  machine.forget_edges();
  const long first = sent();
  camera("truncate 2");
  frames_pass(8);
  CHECK_TEXT(fine(), journal().c_str());
  CHECK(confirmed() <= sent() - first - 2);
  camera("truncate 30");
  stop_being_fine();
  machine.forget_edges();
  frames_pass(5);
  LONGS_EQUAL(0, confirmed());
  become_fine();
  camera("error 2");
  frames_pass(8);
  become_fine();
  LONGS_EQUAL(before, restarts());
}

// The worst of a camera's faults: it goes on, and nothing is new.
TEST(Holdfastd, IsNotFooledByAFrozenPicture) {
  become_fine();
  const int before = restarts();
  camera("freeze on");
  stop_being_fine();
  machine.forget_edges();
  frames_pass(8);
  LONGS_EQUAL(0, confirmed());
  CHECK(machine.diagnostics().find("frame_frozen") != std::string::npos);
  camera("freeze off");
  become_fine();
  LONGS_EQUAL(before, restarts());
}

TEST(Holdfastd, GoesOnAfterAStall) {
  become_fine();
  const int before = restarts();
  machine.diagnostics().clear();
  camera("stall on");
  stop_being_fine();
  machine.forget_edges();
  CHECK(machine.wait([this] { return machine.diagnostics().find("FAULT no_frame") != std::string::npos; }, 2min));
  LONGS_EQUAL(0, confirmed());
  camera("stall off");
  become_fine();
  LONGS_EQUAL(before, restarts());
}

TEST(Holdfastd, DoesNotTakeAnotherCamera) {
  become_fine();
  camera("unplug");
  stop_being_fine();
  camera("as USB 2.0 Camera SN0001 0c45:636d");
  camera("plug");
  CHECK(machine.run_until("[[ -e /dev/video0 ]]", 60s));
  CHECK(machine.run_until("journalctl -u holdfastd -o cat | grep -q 'USB 2.0 Camera'", 60s));
  CHECK(!fine());
  camera("unplug");
  CHECK(machine.run_until("[[ ! -e /dev/video0 ]]", 60s));
  camera("as GelSight Mini R0B 2BNN-4ZE7 2BNN4ZE7 0c45:636d");
  camera("plug");
  become_fine();
}

TEST(Holdfastd, IsBackAfterAKill) {
  become_fine();
  const std::string killed = pid();
  said("kill -KILL " + killed);
  stop_being_fine();
  become_fine();
  CHECK(killed != pid());
}

// Without a successor that would take the lines: they are lowered all the same. (This chip keeps its levels.)
TEST(Holdfastd, LeavesNoLineHighWhenItIsKilled) {
  change_unit("Restart=no\\n");
  const auto low = [this] { return !machine.level(kGripOk) && !machine.level(kAlive); };
  for (int tries = 0; tries < 2; ++tries) {
    become_fine();
    said("kill -KILL " + pid());
    const Moment since = std::chrono::steady_clock::now();
    CHECK_TEXT(machine.wait(low, 1min), journal().c_str());
    std::printf(" LOW after %.1f s;", seconds_since(since));
    CHECK(machine.run_until("[[ $(systemctl show -P ActiveState holdfastd) == failed ]]", 60s));
    CHECK(low());
    said("systemctl start holdfastd");
  }
  change_unit("");
  become_fine();
  // What lives keeps its lines.
  STRCMP_CONTAINS("is used by 'holdfastd:GRIP_OK'", said("holdfastd --lower --set nonsense 2>&1").c_str());
  CHECK(fine());
}

// Only systemd can see it: its watchdog kills it, and it starts anew.
TEST(Holdfastd, IsKilledAndBackWhenItHangs) {
  become_fine();
  const std::string hung = pid();
  said("kill -STOP " + hung);
  stop_being_fine();
  CHECK(machine.run_until("[[ $(systemctl show -P MainPID holdfastd) != @(0|" + hung + ") ]]", 3min));
  become_fine();
}

TEST(Holdfastd, SaysWhenTheGripperIsSilent) {
  become_fine();
  machine.diagnostics().clear();
  machine.gripper().trouble(sim::LineTrouble::kMute);
  CHECK(machine.wait([this] { return machine.diagnostics().find("gripper_silent") != std::string::npos; }, 2min));
  machine.gripper().trouble(sim::LineTrouble::kNone);
  become_fine();
}

// What a process holds of the kernel: descriptors, maps, threads, and kB of address space.
struct Holdings {
  long files = 0, maps = 0, threads = 0, kilobytes = 0;
};

Holdings holdings(Machine& machine, const std::string& pid) {
  const std::string proc = "/proc/" + pid;
  const Machine::Said said = machine.run("ls " + proc + "/fd | wc -l; wc -l <" + proc + "/maps; ls " + proc +
                                         "/task | wc -l; awk '/^VmSize/ { print $2 }' " + proc + "/status");
  Holdings held;
  LONGS_EQUAL_TEXT(
      4, std::sscanf(said.text.c_str(), "%ld %ld %ld %ld", &held.files, &held.maps, &held.threads, &held.kilobytes),
      said.text.c_str());
  return held;
}

// Not maps, which are one process's alone: the kernel puts anonymous ones at random places, and neighbours become one.
// 24 fresh processes on a PC had the same kB and threads, and 1323 to 1334 maps.
void check_same(const Holdings& before, const Holdings& after) {
  LONGS_EQUAL(before.files, after.files);
  LONGS_EQUAL(before.threads, after.threads);
  LONGS_EQUAL(before.kilobytes, after.kilobytes);
}

int cycles() {
  const char* const asked = std::getenv("HOLDFAST_CYCLES");
  return asked != nullptr ? std::atoi(asked) : 2;
}

// One process through all of it; the first round is what it measures the others by.
TEST(Holdfastd, LeaksNothingThroughReplugs) {
  become_fine();
  const std::string process = pid();
  Holdings first;
  for (int k = 0; k <= cycles(); ++k) {
    camera("unplug");
    stop_being_fine();
    camera("plug");
    become_fine();
    if (k == 0) first = holdings(machine, process);
  }
  const Holdings last = holdings(machine, process);
  check_same(first, last);
  LONGS_EQUAL(first.maps, last.maps);
  STRCMP_EQUAL(process.c_str(), pid().c_str());
  std::printf(" %d replugs, %ld descriptors, %ld maps;", cycles(), first.files, first.maps);
}

// Each process finds what the one before it found, whatever that left behind.
TEST(Holdfastd, LeaksNothingThroughKills) {
  become_fine();
  const int before = restarts();
  Holdings first;
  std::string left;
  for (int k = 0; k <= cycles(); ++k) {
    said("kill -KILL " + pid());
    stop_being_fine();
    become_fine();
    if (k > 0) continue;
    first = holdings(machine, pid());
    left = said("ls -la /run/holdfast | wc -l; ls /tmp /dev/shm | wc -l");
  }
  check_same(first, holdings(machine, pid()));
  STRCMP_EQUAL(left.c_str(), said("ls -la /run/holdfast | wc -l; ls /tmp /dev/shm | wc -l").c_str());
  LONGS_EQUAL(before + cycles() + 1, restarts());
  std::printf(" %d kills;", cycles());
}

// The console on the machine's second serial port, as somebody at its other end has it.
TEST(Holdfastd, AnswersOnItsConsole) {
  become_fine();
  asks("\x03", "holdfast> ");
  asks("version json", R"("board":"virt")");
  asks("status json", R"({"state":"OK")");
  asks("tasks json", R"({"first_frame_ms":)");
  asks("set raise_frames 3", "ERR 10 locked");
  asks("devi\t", "2BNN4ZE7");
  asks("log frames json", "]}\r\nOK\r\n");
  become_fine();
}

// Two sensors on one board, each known by its stored serial: what one of them sees or suffers, the lines say for both.
TEST(Holdfastd, ServesTwoSensors) {
  right("play 0 11");
  right("plug");
  restart_as_hand(kLeftSerial, kRightSerial);
  become_fine();
  const int before = restarts();
  asks("\x03", "holdfast> ");
  nlohmann::json status = asks_json("status");
  for (const char* const finger : {"left", "right"}) {
    STRCMP_EQUAL("OK", status[finger]["state"].get<std::string>().c_str());
    LONGS_EQUAL(63, status[finger]["markers"].get<int>());
  }

  // An edge for each frame of the slower one.
  right("period 1200");
  frames_pass(4);
  machine.forget_edges();
  const long left_before = sent(), right_before = sent(kRight);
  frames_pass(15);
  const long edges = confirmed(), left_sent = sent() - left_before, right_sent = sent(kRight) - right_before;
  std::printf(" %ld edges for %ld and %ld frames;", edges, left_sent, right_sent);
  CHECK(left_sent >= 15 && edges >= right_sent - 2 && edges <= right_sent + 1);
  CHECK_TEXT(fine(), journal().c_str());
  right("period 800");

  // Both hold the object; it slides over the left one alone.
  camera("play 12 37 then 36 37");
  right("play 12 37 then 36 37");
  await_picture(37);
  await_picture(37, kRight);
  CHECK_TEXT(fine(), journal().c_str());
  const long pictures = sent();
  camera("play 38 82 then 0 11");
  CHECK_TEXT(machine.wait([this] { return !machine.level(kGripOk); }, 1min), journal().c_str());
  std::printf(" LOW %ld pictures after the slide began;", sent() - pictures);
  CHECK(sent() - pictures <= kToTellSlip);
  CHECK(machine.wait([this] { return machine.diagnostics().find("* SLIP ") != std::string::npos; }, 1min));
  right("play 60 82 then 0 11");  // both let go
  await_picture(5, kRight);
  become_fine();

  // One is pulled out: the other's frames go on, and it is the hand that is not fine.
  const auto told = [this](const std::string& what) {
    return std::atoi(said("journalctl -u holdfastd -o cat | grep -c '" + what + "'; true").c_str());
  };
  const int of_left = told("left finger: "), right_is_back = told("right finger: the camera is there");
  right("unplug");
  stop_being_fine();
  machine.forget_edges();
  frames_pass(10);
  LONGS_EQUAL(0, confirmed());
  status = asks_json("status");
  STRCMP_EQUAL("FAULT", status["state"].get<std::string>().c_str());
  STRCMP_EQUAL("camera_gone", status["reason"].get<std::string>().c_str());
  STRCMP_EQUAL("OK", status["left"]["state"].get<std::string>().c_str());
  CHECK(status["left"]["age_ms"].get<double>() < 150);
  CHECK(status["right"]["age_ms"].get<double>() > 150);
  right("plug");
  become_fine();
  LONGS_EQUAL(of_left, told("left finger: "));
  LONGS_EQUAL(right_is_back + 1, told("right finger: the camera is there"));
  LONGS_EQUAL(before, restarts());

  // In each other's place.
  restart_as_hand(kRightSerial, kLeftSerial);
  CHECK(machine.wait([this] { return machine.diagnostics().find("* FAULT camera_wrong") != std::string::npos; }, 2min));
  CHECK(!fine());
  const nlohmann::json devices = asks_json("devices")["devices"];
  STRCMP_CONTAINS("the other finger's sensor", devices[0]["more"].get<std::string>().c_str());
  STRCMP_CONTAINS("the other finger's sensor", devices[1]["more"].get<std::string>().c_str());

  right("unplug");
  restart_with("");
  become_fine();
}

// How old frames are when the lines have changed by them, in this board's time. Beside it `watch on` and a busy
// process. The periods differ, so that each finger's frame meets the other's decoding at every point of it.
TEST(Holdfastd, ReportsAgesOfTwoSensorsUnderLoad) {
  const char* const asked = std::getenv("HOLDFAST_PAIRS");
  const long pairs = asked != nullptr ? std::atol(asked) : 40;
  right("play 0 11");
  right("plug");
  right("period 810");
  restart_as_hand(kLeftSerial, kRightSerial);
  become_fine();
  const std::string busy = said("setsid sh -c 'while :; do :; done' >/dev/null 2>&1 & echo $!");
  asks("\x03", "holdfast> ");
  const long left_before = sent(), right_before = sent(kRight);
  asks("tasks clear", "OK\r\n");
  asks("watch on", "OK\r\n");
  machine.forget_edges();
  CHECK(machine.wait(
      [&] {
        machine.diagnostics().clear();
        return confirmed() >= pairs;
      },
      pairs * 2s + 60s));
  asks("watch off", "OK\r\n");
  const nlohmann::json tasks = asks_json("tasks")["tasks"];
  const std::array<long, 2> frames{sent() - left_before, sent(kRight) - right_before};  // and what the answers took
  said("kill " + busy);
  std::array<long, 2> accepted{}, most{}, tail{};
  for (const auto& row : tasks) {
    if (row["task"] != "age") continue;
    const std::size_t finger = row["finger"] == "left" ? 0 : 1;
    const auto ms = [&row](const char* key) { return std::lround(row[key].get<double>() / 1000); };
    accepted[finger] = row["count"].get<long>();
    most[finger] = ms("max_us");
    tail[finger] = ms("p99_9_us");
    CHECK(accepted[finger] >= pairs && accepted[finger] <= frames[finger] + 1);
    CHECK(most[finger] <= 150);  // what is older is none that was accepted
  }
  std::printf(" p99.9 of age %ld and %ld ms, most %ld and %ld, of %ld and %ld frames, %ld and %ld sent;", tail[0],
              tail[1], most[0], most[1], accepted[0], accepted[1], frames[0], frames[1]);
  right("unplug");
  right("period 800");
  restart_with("");
  become_fine();
}

// The same tests as on the host, on the kernel's own camera and lines.
TEST(Holdfastd, LeavesItsDevicesToTheContract) {
  become_fine();
  said("systemctl stop holdfastd");
  camera("play 0 11");
  camera("period 250");
  const std::string log = said("HOLDFAST_REAL_DEVICES=virt /usr/lib/holdfast/firmware_tests -v -sg HalContract 2>&1");
  STRCMP_CONTAINS("OK (", log.c_str());
  camera("period 800");
  said("systemctl start holdfastd");
  become_fine();
}

// As through V4L2, and again after a replug.
TEST(Holdfastd, SeesThroughLibcameraAsWell) {
  become_fine();
  use_libcamera("--keep /run/holdfast/reference");
  stop_being_fine();
  become_fine();
  camera("unplug");
  stop_being_fine();
  camera("plug");
  become_fine();
  change_unit("");
  said("systemctl restart holdfastd");
  stop_being_fine();
  become_fine();
}

// A replug included: the kernel's buffers come and go, the heap stays as it is. libcamera takes memory for every frame,
// which shows that the probes see calls.
TEST(Holdfastd, TakesNoMemoryOnceItRuns) {
  const char* const asked = std::getenv("HOLDFAST_HEAP_FRAMES");
  const long frames = asked != nullptr ? std::atol(asked) : 100;
  become_fine();
  camera("period 100");
  const long taken = heap_calls(machine, pid(), frames);
  std::printf(" V4L2: %ld calls in %ld frames;", taken, frames);
  LONGS_EQUAL(0, taken);
  use_libcamera("");
  camera("period 800");
  stop_being_fine();
  become_fine();
  camera("period 200");
  const long calls = heap_calls(machine, pid(), 50);
  std::printf(" libcamera: %ld calls in 50 frames;", calls);
  CHECK(calls > 0);
  camera("period 800");
  change_unit("");
  said("systemctl restart holdfastd");
  stop_being_fine();
  become_fine();
}

// The process as it runs, and what its sandbox refuses: a shell in a copy of its unit, and a shell of root's in its
// group, to whom files' modes are no hindrance.
TEST(Holdfastd, MayDoNoMoreThanItNeeds) {
  become_fine();
  const std::string proc = "/proc/" + pid();
  const std::string status = said("cat " + proc + "/status");
  const auto value = [&](const char* name) {
    const std::size_t at = status.find(name);
    CHECK_TEXT(at != std::string::npos, name);
    return status.substr(status.find_first_not_of(" \t", at + std::string_view(name).size()), 16);
  };
  STRCMP_CONTAINS("0000000000000000", value("\nCapEff:").c_str());
  STRCMP_CONTAINS("0000000000000000", value("\nCapBnd:").c_str());
  CHECK(value("\nNoNewPrivs:").starts_with('1'));
  CHECK(value("\nSeccomp:").starts_with('2'));
  // All of it stays in memory, beyond what a process may lock without LimitMEMLOCK.
  const long locked = std::atol(value("\nVmLck:").c_str()), resident = std::atol(value("\nVmRSS:").c_str());
  std::printf(" %ld kB locked, %ld resident;", locked, resident);
  CHECK(locked > 8 * 1024);
  STRCMP_CONTAINS("unlimited", said("grep 'Max locked memory' " + proc + "/limits").c_str());
  // FIFO (1), all threads. (Fields 40 and 41 of stat: priority and policy.)
  STRCMP_EQUAL("50 1", said("cut -d ' ' -f 40,41 " + proc + "/task/*/stat | sort -u").c_str());
  STRCMP_EQUAL("apart",
               said("[[ $(readlink " + proc + "/ns/net) != $(readlink /proc/1/ns/net) ]] && echo apart").c_str());

  const auto says = [this](const std::string& shell, const char* what, const char* why) {
    const std::string told = machine.run(shell + " '" + what + "' 2>&1").text;
    CHECK_TEXT(told.find(why) != std::string::npos, (std::string(what) + ": " + told).c_str());
  };
  said("mkdir -p /run/systemd/system/holdfast-probe.service.d /run/probe && chmod 755 /run/probe");
  said("cp /lib/systemd/system/holdfastd.service /run/systemd/system/holdfast-probe.service");
  said(
      "printf '[Service]\\nType=oneshot\\nRestart=no\\nWatchdogSec=0\\nExecStopPost=\\nExecStart=\\n"
      "ExecStart=-/bin/bash /run/probe/script\\nStandardOutput=truncate:/run/probe/out\\nStandardError=inherit\\n' > "
      "/run/systemd/system/holdfast-probe.service.d/probe.conf");
  said(
      "printf 'echo \"$1\" >/run/probe/script && systemctl start holdfast-probe && cat /run/probe/out' "
      ">/run/probe/inside");
  said(
      "printf 'echo $$ >/sys/fs/cgroup/system.slice/holdfastd.service/cgroup.procs && eval \"$1\"' "
      ">/run/probe/group");
  said("systemctl daemon-reload");
  const std::string outside = "bash -c", inside = "bash /run/probe/inside", group = "bash /run/probe/group";

  says(outside, "exec 3<>/dev/tcp/127.0.0.1/1", "Connection refused");
  says(inside, "exec 3<>/dev/tcp/127.0.0.1/1", "Address family not supported");
  says(inside, "echo >/var/lib/other", "Read-only file system");
  says(inside, "ls /proc/1", "No such file");
  says(inside, "cat /proc/kallsyms", "No such file");
  says(inside, "cat /dev/vda", "denied");
  says(inside, "chrt -f 60 true", "Operation not permitted");
  says(inside, "unshare -U true", "Operation not permitted");
  for (const char* const device : {"</dev/vda", "</dev/mem", "</dev/kmsg", "</dev/hwrng"}) {
    says(outside, (std::string(": ") + device + " && echo opened").c_str(), "opened");
    says(group, (std::string(": ") + device + " && echo opened").c_str(), "Operation not permitted");
  }
  for (const char* const device : {"</dev/gpiochip0", "</dev/video0", "</dev/ttyS0", "</dev/null"}) {
    says(group, (std::string(": ") + device + " && echo opened").c_str(), "opened");
  }
  said("rm -r /run/probe /run/systemd/system/holdfast-probe.service* && systemctl daemon-reload");
  become_fine();
}

// A process that waits in the kernel for a disk that stands still cannot be killed: not its own watchdog, the machine's
// reset is what is left. Its own machine: it ends with another kernel.
TEST_GROUP(Stuck) {
  Machine& machine = test::shared_machine("stuck", {});
};

TEST(Stuck, AProcessThatCannotBeKilledResetsTheMachine) {
  CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
  const auto said = [&](const std::string& command) {
    const Machine::Said answer = machine.run(command);
    LONGS_EQUAL_TEXT(0, answer.status, (command + ": " + answer.text).c_str());
  };
  const auto level = [&] { return machine.level(kGripOk); };
  // A cold start needs one process, not several that each find a device missing.
  CHECK(machine.wait(level, kToOk));
  STRCMP_EQUAL("0", machine.run("systemctl show -P NRestarts holdfastd").text.c_str());
  said("cp /usr/lib/holdfast/disk.ext4 /run/ && mkdir /run/disk && mount -o loop /run/disk.ext4 /run/disk");
  said("chown holdfast /run/disk && mkdir -p /run/systemd/system/holdfastd.service.d");
  said(
      "printf '[Service]\\nReadWritePaths=/run/disk\\nExecStart=\\nExecStart=/usr/bin/holdfastd --keep "
      "/run/disk/reference $HOLDFASTD_OPTIONS\\n' > /run/systemd/system/holdfastd.service.d/disk.conf");
  said("systemctl daemon-reload && systemctl restart holdfastd");
  CHECK(machine.wait(level, kToOk));
  const int resets = machine.resets();
  said("fsfreeze --freeze /run/disk");
  CHECK(machine.wait([&] { return !level(); }, kToOk));
  CHECK(machine.wait([&] { return machine.resets() > resets; }, 6min));
  CHECK(machine.boots());
  CHECK(machine.wait(level, kToOk));
  STRCMP_EQUAL("0", machine.run("systemctl show -P NRestarts holdfastd").text.c_str());
}
