// SPDX-License-Identifier: Apache-2.0
// A board that takes its updates from the owner's server: the card with board/pull, curl, openssl and a network over it
// (prepare.sh pull), by its own units and RAUC, from U-Boot's first start to its trial of what was fetched. The server
// is that of tests/e2e/update_pull.sh, which tries more of what may be offered, with less of the board.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "tests/support/deadline.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"
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
constexpr Span kFrame = 800ms;      // from edge to edge of ALIVE, at this board's time
constexpr Span kLate = 20 * 100ms;  // after 150 ms of that time it is no longer fine
constexpr Span kToOk = 3min;
constexpr Span kToFetch = 5min;    // 56 MB by an emulated processor
constexpr Span kToInstall = 5min;  // the same, checked block by block

std::filesystem::path made(const std::string& name) {
  return test::image_path() / "pull" / name;
}

class Server {
 public:
  Server() {
    std::filesystem::create_directory(www_);
    process_.start({"python3", test::source("tests/e2e/https_server.py"), www_, made("tls/server.cert.pem"),
                    made("tls/server.key.pem"), control_.path()},
                   -1, control_ / "errors");
    (void)test::until([this] { return port() != 0; });
  }
  [[nodiscard]] int port() const { return std::atoi(test::read_file(control_ / "port").c_str()); }
  // Gives out a file as prepare.sh made it, or with every bit of byte `changed` from its end turned.
  void offer(const std::string& name, const std::string& as, long changed = 0) {
    std::string bytes = test::read_file(made("www/" + name));
    if (changed != 0) bytes[bytes.size() - static_cast<std::size_t>(changed)] ^= '\xff';
    test::write_file(www_ / as, bytes);
  }
  // Closes the connection after so many bytes of the next bundle.
  void cut(long bytes) { test::write_file(control_ / "cut", std::to_string(bytes)); }
  // What it was asked for but channels: a line each, with the first byte.
  [[nodiscard]] std::string asked() const {
    std::string log = test::read_file(control_ / "log");
    for (std::size_t at = 0; (at = log.find("/channel 0\n")) != std::string::npos;) log.erase(at, 11);
    return log;
  }

 private:
  test::TempDir control_;
  std::filesystem::path www_ = control_ / "www";
  test::Child process_;
};

}  // namespace

TEST_GROUP(Pull) {
  Server server;
  int answers = 0, lows = 0;
  Span longest{0};
  Machine& machine =
      test::shared_machine("pull", {.image = made("."), .card = made("holdfast-virt.img"), .server = server.port()});

  void setup() override {
    CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
    STRCMP_CONTAINS("ok", machine.camera("play 0 11").c_str());  // an empty gel
  }
  std::string said(const std::string& command, Span deadline = Machine::kToAnswer) {
    const Machine::Said answer = machine.run(command, deadline);
    LONGS_EQUAL_TEXT(0, answer.status, (command + ": " + answer.text).c_str());
    return answer.text;
  }
  long alive() {
    return std::count_if(machine.edges().begin(), machine.edges().end(),
                         [](const auto& edge) { return edge.line == kAlive; });
  }
  void becomes_fine_and_is_kept() {
    machine.forget_edges();
    CHECK(machine.wait([this] { return machine.level(kGripOk) && alive() >= 3; }, kToOk));
    CHECK(machine.run_until("[[ $(systemctl show -P ActiveState holdfast-good) == active ]]", kToOk));
  }
  void mark(bool there) {
    CHECK(machine.run_until(std::string(there ? "" : "! ") + "[ -e /run/holdfast/empty ]", kToOk));
  }
  // Asks the server, by its unit or by what else starts that, until both steps are over. `wanted` is among what they
  // say; GRIP_OK stays and ALIVE goes on meanwhile.
  void asks(const std::string& wanted, const std::string& by = "systemctl start holdfast-pull") {
    const std::string after =
        " --after-cursor '" + said("journalctl -n 0 --show-cursor | sed -n 's/^-- cursor: //p'") + "'";
    machine.forget_edges();
    const Moment began = std::chrono::steady_clock::now();
    (void)machine.run(by, kToFetch);
    const Machine::Said over = machine.run(
        "grep -q 'install.service: \\(Deactivated successfully\\|Failed with\\)' < <(journalctl -f --no-tail -o cat"
        " -u holdfast-pull-install" +
            after + ")",
        kToInstall);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
    const std::string text = machine.run("journalctl -u holdfast-pull -u holdfast-pull-install -o cat" + after).text;
    LONGS_EQUAL_TEXT(0, over.status, text.c_str());
    STRCMP_CONTAINS(wanted.c_str(), text.c_str());
    // GRIP_OK goes only when the emulated machine itself stands still, beside other jobs.
    Moment last = began;
    for (const Machine::Edge& edge : machine.edges()) {
      const Span since = std::chrono::duration_cast<Span>(edge.at - last);
      if (edge.line == kGripOk && !edge.high) {
        CHECK_TEXT(since > kLate, text.c_str());
        ++lows;
      }
      if (edge.line != kAlive) continue;
      longest = std::max(longest, since);
      last = edge.at;
    }
    CHECK_TEXT(alive() * kFrame > took / 2, "holdfastd stood still");
    CHECK(machine.wait([this] { return machine.level(kGripOk); }, kToOk));
    ++answers;
    std::printf("\n   %3.0f s, ALIVE %2ld times: %s", took.count(), alive(), wanted.c_str());
    (void)machine.run("systemctl reset-failed");
  }
  std::string word(const std::string& name) {
    return machine.run("fw_printenv -n " + name + " 2>/dev/null").text;
  }
  char slot() {
    return said("sed 's/.*rauc.slot=//' /proc/cmdline").front();
  }
};

TEST(Pull, TakesWhatItsOwnerOffersAndNothingElse) {
  const std::string bundle = "holdfast-virt-0.10.0.raucb";
  const std::string fetched = "ls /run/holdfast-pull/ /run/holdfast-pull-install/ | grep -c 'bundle\\|raucb' || true";
  becomes_fine_and_is_kept();
  const char before = slot(), after = before == 'A' ? 'B' : 'A';

  // By the timer, which waits ten minutes and more, and after that an hour.
  server.offer("channel.closed", "channel");
  server.offer(bundle, bundle);
  STRCMP_EQUAL("active", said("systemctl is-active holdfast-pull.timer").c_str());
  const std::string sooner = "/run/systemd/system/holdfast-pull.timer.d";
  asks("of 100 boards, and this one is at place",
       "mkdir " + sooner + R"(; printf '[Timer]\nOnBootSec=\nOnBootSec=1\nRandomizedDelaySec=0\n' > )" + sooner +
           "/sooner.conf; systemctl daemon-reload; systemctl restart holdfast-pull.timer");
  said("systemctl stop holdfast-pull.timer");

  server.offer("channel", "channel", 1000);
  asks("the channel is not signed by this board's owner");

  server.offer("channel", "channel");
  said("fallocate -l $(($(df -B 1 --output=avail /run | tail -n 1) - 40000000)) /run/filler");
  asks("no room for the bundle: ");
  said("rm /run/filler");
  STRCMP_EQUAL("", server.asked().c_str());

  // Changed, and gone in the middle besides.
  server.offer(bundle, bundle, 10000000);
  server.cut(20000000);
  asks("error: update from the server: 20000000 of ");
  asks(bundle + " is not the file that the channel names");
  STRCMP_EQUAL(("/" + bundle + " 0\n/" + bundle + " 20000000\n").c_str(), server.asked().c_str());
  STRCMP_EQUAL("0", said(fetched).c_str());

  server.offer(bundle, bundle);
  STRCMP_CONTAINS("ok", machine.camera("play 12 39 then 38 39").c_str());
  mark(false);
  asks("release 2 waits until nothing is held for");
  STRCMP_EQUAL("1", said(fetched).c_str());
  STRCMP_EQUAL("", word("BOOT_TRIAL").c_str());

  STRCMP_CONTAINS("ok", machine.camera("play 40 82 then 0 11").c_str());
  mark(true);
  asks("installed " + bundle + ". Next: start the machine anew");
  STRCMP_EQUAL("0", said(fetched).c_str());
  STRCMP_EQUAL(std::string(1, after).c_str(), word("BOOT_TRIAL").c_str());
  asks("release 2 was installed by this before");

  (void)machine.run("(sleep 1; systemctl reboot) >/dev/null 2>&1 &");
  machine.await_boot();
  CHECK_TEXT(machine.problem().empty(), machine.problem().c_str());
  BYTES_EQUAL(after, slot());
  becomes_fine_and_is_kept();
  STRCMP_EQUAL("", word("BOOT_TRIAL").c_str());
  asks("release 2 runs already");
  STRCMP_EQUAL("number=2\nrelease=2", said("cat /data/holdfast-pull/number /data/holdfast-pull/tried").c_str());
  std::printf("\n   pull: %d answers, GRIP_OK LOW %d times, edges of ALIVE at most %.1f s apart;", answers, lows,
              std::chrono::duration<double>(longest).count());
}
