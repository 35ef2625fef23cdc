// SPDX-License-Identifier: Apache-2.0
// The card as it is flashed, on the emulated machine: U-Boot chooses a slot, dm-verity checks its root, holdfastd runs
// as its unit; updates come on a USB stick. Only the board's own drivers and the first stages differ on a Pi.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include "tests/system/scenario.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

using test::Machine;
using test::Span;

constexpr int kGripOk = 0, kAlive = 1;
constexpr Span kToOk = 3min;
constexpr Span kToInstall = 4min;  // 75 MB, checked block by block by an emulated processor

// Made by prepare.sh.
std::filesystem::path stick(const char* name) {
  return test::image_path() / "sticks" / (std::string(name) + ".img");
}

// HOLDFAST_CUTS=50 for the long run.
int cuts_wanted() {
  const char* const asked = std::getenv("HOLDFAST_CUTS");
  return asked != nullptr ? std::atoi(asked) : 3;
}

}  // namespace

TEST_GROUP(Card) {
  Machine& machine = test::shared_machine("card", {.card = test::image_path() / "holdfast-virt.img"});

  void setup() override {
    CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
    STRCMP_CONTAINS("ok", machine.camera("play 0 11").c_str());  // an empty gel
  }
  std::string said(const std::string& command) {
    const Machine::Said answer = machine.run(command);
    LONGS_EQUAL_TEXT(0, answer.status, (command + ": " + answer.text).c_str());
    return answer.text;
  }
  std::string journal(const std::string& unit, const std::string& more = {}) {
    return machine.run("journalctl -u " + unit + " -o cat --no-pager " + more + " | tail -n 20").text;
  }
  void comes_up() {
    machine.await_boot();
    CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
  }
  // As the robot's controller sees it.
  void become_fine() {
    machine.forget_edges();
    const auto fine = [this] {
      return machine.level(kGripOk) && std::count_if(machine.edges().begin(), machine.edges().end(),
                                                     [](const auto& edge) { return edge.line == kAlive; }) >= 3;
    };
    CHECK_TEXT(machine.wait(fine, kToOk), journal("holdfastd").c_str());
  }
  void kept() {
    CHECK_TEXT(machine.run_until("[[ $(systemctl show -P ActiveState holdfast-good) == active ]]", kToOk),
               journal("holdfast-good").c_str());
  }
  char slot() {
    return said("sed 's/.*rauc.slot=//' /proc/cmdline").front();
  }
  std::string word(const std::string& name) {
    return machine.run("fw_printenv -n " + name + " 2>/dev/null").text;
  }
  std::string release() {
    return said("sed -n 's/^release=//p' /usr/lib/holdfast/release");
  }
  // What somebody at the console reads.
  void console_says(const std::string& text) {
    machine.diagnostics().clear();
    machine.type("\x03\rversion json\r");
    const auto answered = [&] { return machine.diagnostics().find("}\r\nOK\r\n") != std::string::npos; };
    CHECK_TEXT(machine.wait(answered, 1min), machine.diagnostics().c_str());
    STRCMP_CONTAINS(text.c_str(), machine.diagnostics().c_str());
  }
  // An update that differs from what runs.
  const char* other_release() {
    return release() == "1" ? "good" : "again";
  }
  // Plugs the stick and waits until what it brought was dealt with; what was said of it.
  std::string offer(const char* name, const char* end) {
    const std::string since = "--since @" + said("rm -f /run/holdfast-notes/update; date +%s");
    machine.plug_stick(stick(name));
    const std::string look = "systemctl list-units --all --plain --no-legend 'holdfast-stick@*' | grep -q ";
    const bool over =
        end == std::string("failed")
            ? machine.run_until(look + "failed", kToInstall)
            : machine.run_until("journalctl -u 'holdfast-stick@*' " + since + " | grep -q '" + std::string(end) + "'",
                                kToInstall);
    std::string text = journal("'holdfast-stick@*'", since);
    CHECK_TEXT(over, text.c_str());
    machine.unplug_stick();
    CHECK(machine.run_until("[[ ! -e /dev/sda && ! -e /dev/sdb ]]", 1min));
    (void)machine.run("systemctl reset-failed");  // or whoever uses the machine next would take it for his
    return text;
  }
};

TEST(Card, StartsByUBootAndBecomesFine) {
  become_fine();
  kept();
  STRCMP_EQUAL("3", word(std::string("BOOT_") + slot() + "_LEFT").c_str());
  // The root is what was built, and nobody can change it.
  STRCMP_EQUAL("/dev/dm-0 squashfs", said("findmnt -n -o SOURCE,FSTYPE --raw /").c_str());
  STRCMP_CONTAINS(" V ", (" " + said("dmsetup status root | cut -d ' ' -f 4") + " ").c_str());
  CHECK(machine.run("touch /usr/bin/x").status != 0);
  STRCMP_EQUAL("ext4", said("findmnt -n -o FSTYPE /data").c_str());
  LONGS_EQUAL(0, std::atoi(said("systemctl --failed --no-legend | wc -l").c_str()));
  STRCMP_CONTAINS("first frame fine", journal("holdfastd").c_str());
  std::printf(" %s;", said("journalctl -u holdfastd -o cat --no-pager | grep 'first frame fine' | tail -n 1").c_str());
}

// None of them is taken, none disturbs what runs.
TEST(Card, RefusesWhatItsOwnerDidNotSign) {
  become_fine();
  kept();
  const struct {
    const char* stick;
    const char* why;
  } cases[] = {{"wrong_key", "unable to get local issuer certificate"},
               {"revoked", "certificate revoked"},
               {"bad_signature", "signature"},
               {"truncated", "not installed"},
               {"damaged", "the file is damaged"},
               {"other_board", "it is for another board than virt"},
               {"older", "is below"}};
  const auto slots = [this] { return word("BOOT_ORDER") + ", " + word("BOOT_A_LEFT") + ", " + word("BOOT_B_LEFT"); };
  const std::string before = slots();
  for (const auto& offered : cases) {
    machine.forget_edges();
    STRCMP_CONTAINS(offered.why, offer(offered.stick, "failed").c_str());
    console_says(R"("last_update":"error: holdfast-virt-0.10.0.raucb was not installed: )");
    STRCMP_CONTAINS(offered.why, machine.diagnostics().c_str());
    STRCMP_EQUAL(before.c_str(), slots().c_str());  // the spare one, too
    CHECK(machine.level(kGripOk));
    CHECK(!machine.edges().empty());
  }
}

TEST(Card, TakesTheNewestUpdateAndKeepsItOnceItsFramesAreOk) {
  become_fine();
  kept();
  const char before = slot();
  const char after = before == 'A' ? 'B' : 'A';
  (void)offer(other_release(), "installed holdfast");
  STRCMP_EQUAL(std::string(1, after).c_str(), word("BOOT_TRIAL").c_str());
  console_says(R"("last_update":"installed holdfast-virt-0.10.0.raucb. Next: start the machine anew)");
  STRCMP_CONTAINS("ok", machine.camera("stall on").c_str());
  (void)machine.run("(sleep 1; systemctl reboot) >/dev/null 2>&1 &");
  comes_up();
  BYTES_EQUAL(after, slot());
  STRCMP_EQUAL("2", release().c_str());
  // Not kept before it has seen frames.
  STRCMP_EQUAL("2", word(std::string("BOOT_") + after + "_LEFT").c_str());
  // A stick that stays in comes up again now, and must not take the slot to fall back to.
  const std::string spare = std::string("BOOT_") + before + "_LEFT", attempts = word(spare);
  STRCMP_CONTAINS("release 2 runs already", offer("good", "failed").c_str());
  STRCMP_EQUAL(attempts.c_str(), word(spare).c_str());
  // Frames that come too fast: each is accepted, and the state is DEGRADED once their rate is known, after 16. More are
  // accepted than --ok-frames in tests/system/root, 20, and fewer are OK.
  machine.forget_edges();
  STRCMP_CONTAINS("ok", machine.camera("period 250").c_str());
  STRCMP_CONTAINS("ok", machine.camera("stall off").c_str());
  const auto accepted = [this] {
    return std::count_if(machine.edges().begin(), machine.edges().end(),
                         [](const auto& edge) { return edge.line == kAlive; }) >= 40;
  };
  CHECK_TEXT(machine.wait(accepted, kToOk), journal("holdfastd").c_str());
  said("[[ ! -e /run/holdfast/ok ]]");
  STRCMP_EQUAL(std::string(1, after).c_str(), word("BOOT_TRIAL").c_str());
  STRCMP_CONTAINS("ok", machine.camera("period 800").c_str());
  become_fine();
  kept();
  STRCMP_EQUAL("3", word(std::string("BOOT_") + after + "_LEFT").c_str());
  STRCMP_EQUAL("", word("BOOT_TRIAL").c_str());
  // What was said before the new start is on the card.
  CHECK(machine.run_until(
      "grep -q 'installed holdfast-virt-0.10.0.raucb' /data/log/log && grep -q 'first frame fine' /data/log/log",
      1min));
  console_says(R"--("release":"2 (0.10.0)","slot":")--" + std::string(1, after) + R"(, kept",)");
  // The release before is the owner's, too, and a hole that was mended in this one.
  STRCMP_CONTAINS("release 1 (0.9.0) is older than 2 (0.10.0), which runs", offer("back", "failed").c_str());
  console_says("is older than 2 (0.10.0)");
}

// Its camera is gone: the new release never accepts a frame, and after three trials the one before runs again.
TEST(Card, FallsBackFromAReleaseThatSeesNoFrames) {
  become_fine();
  kept();
  const char before = slot();
  (void)offer(other_release(), "installed holdfast");
  STRCMP_CONTAINS("ok", machine.camera("unplug").c_str());
  (void)machine.run("(sleep 1; systemctl reboot) >/dev/null 2>&1 &");
  for (int trial = 0; trial < 3; ++trial) {
    comes_up();
    CHECK(slot() != before);
    if (trial == 0) STRCMP_CONTAINS("is on trial", offer("again", "failed").c_str());
  }
  comes_up();
  BYTES_EQUAL(before, slot());
  STRCMP_CONTAINS("ok", machine.camera("plug").c_str());
  become_fine();
  kept();
  console_says(R"("last_update":"the last update, in slot )" + std::string(1, before == 'A' ? 'B' : 'A') +
               ", was not kept: the release before it runs");
}

// Wherever the power goes, from the first look at the stick to a little after the end: a whole system comes up, and the
// update can be had afterwards.
TEST(Card, OutlivesPowerCutsWhileItInstalls) {
  become_fine();
  kept();
  const auto began = std::chrono::steady_clock::now();
  (void)offer(other_release(), "installed holdfast");
  const auto whole = std::chrono::duration_cast<Span>(std::chrono::steady_clock::now() - began);
  std::mt19937 random(11);
  int fresh = 0;
  for (int cut = 0; cut < cuts_wanted(); ++cut) {
    const char before = slot();
    machine.plug_stick(stick(other_release()));
    (void)machine.wait([] { return false; }, Span(static_cast<long>(random() % 1200) * whole.count() / 1000));
    machine.cut_power();
    machine.unplug_stick();
    comes_up();
    fresh += slot() != before ? 1 : 0;
    // All of the root can be read: every block is as it was signed.
    said("cat /dev/dm-0 >/dev/null");
    STRCMP_CONTAINS(release().c_str(), "1 2");
    become_fine();
    kept();
  }
  std::printf(" %d cuts within %.0f s, after %d of them the new slot ran;", cuts_wanted(),
              std::chrono::duration<double>(whole).count() * 1.2, fresh);
  (void)offer(other_release(), "installed holdfast");
}
