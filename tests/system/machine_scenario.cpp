// SPDX-License-Identifier: Apache-2.0
// The emulated machine by itself, without holdfastd: what the other scenarios stand on. A stock kernel and Debian's own
// tools look at the camera, the lines, the gripper's port and the watchdog, and see what is there.
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/host_process.hpp"
#include "tests/support/mjpg_file.hpp"
#include "tests/system/recode.hpp"
#include "tests/system/scenario.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

using test::Machine;

constexpr std::string_view kCard = "GelSight Mini R0B 2BNN-4ZE7: Ge";

// Of these bytes, by the same tool as in the machine.
std::string checksum(const std::string& bytes) {
  const test::TempDir dir;
  test::write_file(dir / "bytes", bytes);
  return test::run({"sha256sum", (dir / "bytes").string()}).out.substr(0, 64);
}

// As the camera shows a picture of the film in its frame `number`.
std::string shown(std::size_t picture, std::uint64_t number) {
  const test::Jpeg bytes = test::recoded(test::read_mjpg(test::film_path()).at(picture), number);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

TEST_GROUP(Machine) {
  Machine& machine = test::shared_machine("machine", {.words = "systemd.watchdog_sec=20"});

  // Ended, with nothing but this on stdout.
  std::string said(const std::string& command) {
    const Machine::Said answer = machine.run(command);
    LONGS_EQUAL_TEXT(0, answer.status, (command + ": " + answer.text).c_str());
    return answer.text;
  }
  void setup() override {
    CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
    said("systemctl stop holdfastd");  // the machine's start does not wait for it
  }
  void camera(const char* command) {
    STRCMP_CONTAINS("ok", machine.camera(command).c_str());
  }
  std::uint64_t frames_sent() {
    const std::string status = machine.camera("status");
    return std::strtoull(status.c_str() + status.find("frames=") + 7, nullptr, 10);
  }
  bool camera_there() {
    return machine.run_until("[[ -c /dev/video0 && -c /dev/video1 ]] && udevadm settle", 60s);
  }
};

TEST(Machine, StartsWithNothingFailed) {
  STRCMP_EQUAL("running", said("systemctl is-system-running --wait").c_str());
  STRCMP_EQUAL("", said("systemctl --failed --no-legend").c_str());
  STRCMP_CONTAINS("uid=989(holdfast) gid=989(holdfast)", said("id holdfast").c_str());
  for (const char* group : {"(video)", "(gpio)", "(dialout)", "(plugdev)"}) {
    STRCMP_CONTAINS(group, said("id holdfast").c_str());
  }
  // Nobody can log in: no getty runs, and no account has a password.
  STRCMP_EQUAL("", said("ps -e -o comm= | grep getty; true").c_str());
  STRCMP_EQUAL("", said("cut -d : -f 2 /etc/shadow | grep -v '^[*]$'; true").c_str());
  std::printf("\n%s\n", said("systemd-analyze | head -n 1").c_str());
}

TEST(Machine, HasTheSensorWithItsNameModeAndControls) {
  CHECK(camera_there());
  STRCMP_EQUAL(std::string(kCard).c_str(), said("cat /sys/class/video4linux/video0/name").c_str());
  STRCMP_EQUAL("2BNN4ZE7", said("cat /sys/class/video4linux/video0/device/../serial").c_str());
  const std::string all = said("v4l2-ctl -d /dev/video0 --all");
  STRCMP_CONTAINS("Size Image        : 16164429", all.c_str());
  STRCMP_CONTAINS("Device Caps      : 0x04200001", all.c_str());
  const std::string formats = said("v4l2-ctl -d /dev/video0 --list-formats-ext");
  STRCMP_CONTAINS("[0]: 'MJPG'", formats.c_str());
  STRCMP_CONTAINS("Size: Discrete 3280x2464", formats.c_str());
  STRCMP_CONTAINS("Interval: Discrete 0.040s (25.000 fps)", formats.c_str());
  CHECK(formats.find("[1]") == std::string::npos);
  STRCMP_CONTAINS("Metadata", said("v4l2-ctl -d /dev/video1 --info").c_str());
}

// As the vendor's script does, under the kernel's new names; and it arrives.
TEST(Machine, RemembersTheVendorsSettings) {
  CHECK(camera_there());
  said("v4l2-ctl -d /dev/video0 -c auto_exposure=1 -c white_balance_automatic=0");
  said(
      "v4l2-ctl -d /dev/video0 -c exposure_time_absolute=180 -c exposure_dynamic_framerate=0 -c gamma=140 -c gain=0 "
      "-c white_balance_temperature=4500 -c power_line_frequency=0 -c sharpness=3 -c backlight_compensation=0");
  const std::string status = machine.camera("status");
  for (const char* setting :
       {" exposure_auto=1 ", " exposure_absolute=180 ", " gamma=140 ", " white_balance_temperature_auto=0 ",
        " white_balance_temperature=4500 ", " power_line_frequency=0 ", " backlight_compensation=0 "}) {
    STRCMP_CONTAINS(setting, status.c_str());
  }
}

TEST(Machine, GetsThePicturesByteForByte) {
  CHECK(camera_there());
  camera("period 250");
  camera("play 0 82");
  const std::uint64_t sent = frames_sent();
  std::string expected;
  for (std::size_t k = 0; k < 12; ++k) expected += shown(k, sent + 1 + k);
  const std::string log = said("v4l2-ctl -d /dev/video0 --stream-mmap=8 --stream-count=12 --stream-to=/tmp/film 2>&1");
  STRCMP_EQUAL_TEXT(checksum(expected).c_str(), said("sha256sum </tmp/film").substr(0, 64).c_str(), log.c_str());
  camera("freeze on");
  said("v4l2-ctl -d /dev/video0 --stream-mmap=8 --stream-count=3 --stream-to=/tmp/film");
  said("split -n 3 /tmp/film /tmp/film. && [[ $(sha256sum /tmp/film.a? | cut -c -64 | uniq | wc -l) == 1 ]]");
  said("rm /tmp/film*");
  camera("freeze off");
}

// uvcvideo passes on a frame that ended early as a shorter one, and keeps frames with the error bit to itself (unless
// it is loaded with nodrop=1): what a reader sees of them is a gap in the sequence.
TEST(Machine, DamagedFramesAreShortOrMissing) {
  CHECK(camera_there());
  camera("period 250");
  camera("play 20 20");
  camera("truncate 1");
  const std::uint64_t sent = frames_sent();
  const std::string short_one =
      said("v4l2-ctl -d /dev/video0 --stream-mmap=8 --stream-count=2 --verbose 2>&1 | grep 'cap dqbuf'");
  STRCMP_CONTAINS(("bytesused: " + std::to_string((shown(20, sent + 1).size() + 1) / 2) + " ").c_str(),
                  short_one.c_str());
  STRCMP_CONTAINS(("bytesused: " + std::to_string(shown(20, sent + 2).size()) + " ").c_str(), short_one.c_str());
  camera("error 2");
  const std::string gap =
      said("v4l2-ctl -d /dev/video0 --stream-mmap=8 --stream-count=2 --verbose 2>&1 | grep 'cap dqbuf'");
  STRCMP_CONTAINS("seq:      2 ", gap.c_str());
  CHECK(gap.find("seq:      0 ") == std::string::npos);
}

TEST(Machine, LosesTheCameraAndGetsItBack) {
  CHECK(camera_there());
  for (int k = 0; k < 3; ++k) {
    camera("unplug");
    CHECK(machine.run_until("[[ ! -e /dev/video0 && ! -e /dev/video1 ]]", 60s));
    camera("plug");
    CHECK(camera_there());
    STRCMP_EQUAL(std::string(kCard).c_str(), said("cat /sys/class/video4linux/video0/name").c_str());
  }
  // Another one of the same maker, with the same id.
  camera("unplug");
  camera("as USB 2.0 Camera SN0001 0c45:636d");
  CHECK(machine.run_until("[[ ! -e /dev/video0 ]]", 60s));
  camera("plug");
  CHECK(camera_there());
  STRCMP_CONTAINS("USB 2.0 Camera", said("cat /sys/class/video4linux/video0/name").c_str());
  camera("unplug");
  camera("as GelSight Mini R0B 2BNN-4ZE7 2BNN4ZE7 0c45:636d");
  CHECK(machine.run_until("[[ ! -e /dev/video0 ]]", 60s));
  camera("plug");
  CHECK(camera_there());
}

// A stream that stands still gives nothing, and is well again when it goes on.
TEST(Machine, WaitsForAStalledStream) {
  CHECK(camera_there());
  camera("stall on");
  const Machine::Said nothing =
      machine.run("timeout 5 v4l2-ctl -d /dev/video0 --stream-mmap=4 --stream-count=1 --verbose 2>&1");
  LONGS_EQUAL_TEXT(124, nothing.status, nothing.text.c_str());
  CHECK(nothing.text.find("cap dqbuf") == std::string::npos);
  camera("stall off");
  STRCMP_CONTAINS("cap dqbuf", said("v4l2-ctl -d /dev/video0 --stream-mmap=4 --stream-count=1 --verbose 2>&1").c_str());
}

TEST(Machine, SetsLinesThatAreSeenOutside) {
  machine.forget_edges();
  for (const int line : {0, 1, 2, 4}) {
    const std::string number = std::to_string(line);
    said("gpioset --mode=signal gpiochip0 " + number + "=1 & echo $! >/tmp/gpioset");
    CHECK(machine.wait([&] { return machine.level(line); }, 60s));
    said("kill $(cat /tmp/gpioset)");
    // Not held by anybody: the next one takes it and says LOW.
    CHECK(machine.run_until("gpioset gpiochip0 " + number + "=0", 60s));
    CHECK(machine.wait([&] { return !machine.level(line); }, 60s));
  }
  LONGS_EQUAL(8, machine.edges().size());
}

TEST(Machine, SeesLinesThatAreDrivenOutside) {
  for (const int line : {5, 6, 7}) {
    const std::string number = std::to_string(line);
    STRCMP_EQUAL("0", said("gpioget gpiochip0 " + number).c_str());
    machine.drive(line, true);
    STRCMP_EQUAL("1", said("gpioget gpiochip0 " + number).c_str());
    said("gpiomon --line-buffered --num-events=2 gpiochip0 " + number + " >/tmp/gpiomon & true");
    CHECK(machine.run_until("gpioinfo gpiochip0 | grep -q '^\\s*line *" + number + ":.*gpiomon'", 60s));
    machine.drive(line, false);
    CHECK(machine.run_until("grep -q FALLING /tmp/gpiomon", 60s));
    machine.drive(line, true);
    said("wait");
    const std::string edges = said("cat /tmp/gpiomon");
    STRCMP_CONTAINS("FALLING", edges.c_str());
    STRCMP_CONTAINS("RISING", edges.c_str());
    machine.drive(line, false);
  }
}

// Function 3, the three registers of the status: the Hand-E answers with its CRC.
TEST(Machine, ReachesTheGripper) {
  const std::uint64_t before = machine.gripper().requests().size();
  const std::string answer = said(
      "stty -F /dev/ttyS0 raw -echo 115200 && exec 3<>/dev/ttyS0 && printf '\\x09\\x03\\x07\\xd0\\x00\\x03\\x04\\x0e' "
      ">&3 && timeout 60 head -c 11 <&3 | od -An -tx1; exec 3>&-");
  STRCMP_EQUAL(" 09 03 06 00 00 00 00 0d 00 42 25", answer.c_str());
  LONGS_EQUAL(before + 1, machine.gripper().requests().size());
}

TEST(Machine, WritesToTheDiagnosticsPort) {
  machine.diagnostics().clear();
  said("stty -F /dev/ttyS1 raw -echo 115200 && echo 'fine and well' >/dev/ttyS1");
  CHECK(machine.wait([&] { return machine.diagnostics() == "fine and well\n"; }, 60s));
}

// systemd holds the watchdog, and pets it: with half the time gone it is full again. A kernel that stands still pets
// nothing, so the machine starts anew by itself.
TEST(Machine, IsResetByItsWatchdogWhenTheKernelHangs) {
  CHECK(machine.run_until("[[ $(cat /sys/class/watchdog/watchdog0/state) == active ]]", 60s));
  STRCMP_EQUAL("i6300ESB timer", said("cat /sys/class/watchdog/watchdog0/identity").c_str());
  LONGS_EQUAL(0, machine.watchdog_bites());
  const int resets = machine.resets();
  (void)machine.run("echo 0 >/proc/sys/kernel/panic; echo c >/proc/sysrq-trigger", 1s);
  CHECK(machine.wait([&] { return machine.watchdog_bites() == 1; }, 3min));
  CHECK(machine.wait([&] { return machine.resets() > resets; }, 60s));
  CHECK(machine.boots());
  CHECK(camera_there());
}
