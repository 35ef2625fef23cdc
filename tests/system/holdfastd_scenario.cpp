// SPDX-License-Identifier: Apache-2.0
// holdfastd as its unit on the emulated machine, seen as the robot's controller sees it: by its lines, its gripper and
// its text. Times are those of board/virt, twenty times those of a board.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>

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
constexpr Span kRule = 20 * 150ms;  // the receiver's, at this board's time
constexpr Span kToOk = 3min;

}  // namespace

TEST_GROUP(Holdfastd) {
  Machine& machine = test::shared_machine("holdfastd", {});

  void setup() override {
    CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
  }
  void camera(const char* command) {
    STRCMP_CONTAINS("ok", machine.camera(command).c_str());
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
  int restarts() {
    return std::atoi(said("systemctl show -P NRestarts holdfastd").c_str());
  }
  std::string pid() {
    return said("systemctl show -P MainPID holdfastd");
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
  const std::string libc = HOLDFAST_SOURCE_DIR "/build/sysroot-aarch64/lib/aarch64-linux-gnu/libc.so.6";
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
  camera("play 0 11");
  become_fine();
  STRCMP_EQUAL("active", said("systemctl is-active holdfastd").c_str());
  // As the vendor's script sets them.
  const std::string settings = machine.camera("status");
  STRCMP_CONTAINS(" exposure_auto=1 exposure_absolute=180 ", settings.c_str());
}

// Empty, pressed and held: fine all the time. Then it slides: LOW.
TEST(Holdfastd, ASlipIsAnEdge) {
  camera("play 0 11");
  become_fine();
  camera("play 12 37 then 36 37");
  CHECK(machine.wait([this] { return machine.camera("status").find(" picture=37 ") != std::string::npos; }, 2min));
  CHECK_TEXT(fine(), journal().c_str());
  machine.forget_edges();
  camera("play 38 82 then 0 11");
  const auto low = [this] {
    return std::any_of(machine.edges().begin(), machine.edges().end(),
                       [](const auto& edge) { return edge.line == kGripOk && !edge.high; });
  };
  CHECK_TEXT(machine.wait(low, 1min), journal().c_str());
  const std::string status = machine.camera("status");
  std::printf(" LOW at %s;", status.substr(status.find("picture="), 10).c_str());
  CHECK(machine.wait([this] { return machine.camera("status").find(" picture=5 ") != std::string::npos; }, 2min));
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
  said("mkdir -p /run/systemd/system/holdfastd.service.d");
  said(
      "printf '[Service]\\nExecStart=\\nExecStart=/usr/bin/holdfastd --backend libcamera --keep "
      "/run/holdfast/reference "
      "$HOLDFASTD_OPTIONS\\n' > /run/systemd/system/holdfastd.service.d/libcamera.conf");
  said("systemctl daemon-reload && systemctl restart holdfastd");
  stop_being_fine();
  become_fine();
  camera("unplug");
  stop_being_fine();
  camera("plug");
  become_fine();
  said("rm /run/systemd/system/holdfastd.service.d/libcamera.conf && systemctl daemon-reload");
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
  LONGS_EQUAL(0, heap_calls(machine, pid(), frames));
  said("mkdir -p /run/systemd/system/holdfastd.service.d");
  said(
      "printf '[Service]\\nExecStart=\\nExecStart=/usr/bin/holdfastd --backend libcamera $HOLDFASTD_OPTIONS\\n' > "
      "/run/systemd/system/holdfastd.service.d/libcamera.conf");
  said("systemctl daemon-reload && systemctl restart holdfastd");
  camera("period 800");
  stop_being_fine();
  become_fine();
  camera("period 200");
  const long calls = heap_calls(machine, pid(), 50);
  std::printf(" libcamera: %ld calls in 50 frames;", calls);
  CHECK(calls > 0);
  camera("period 800");
  said("rm /run/systemd/system/holdfastd.service.d/libcamera.conf && systemctl daemon-reload");
  said("systemctl restart holdfastd");
  stop_being_fine();
  become_fine();
}
