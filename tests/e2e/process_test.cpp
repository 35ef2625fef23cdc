// SPDX-License-Identifier: Apache-2.0
// The firmware as a process, killed and stopped while somebody else looks at its lines: this test is the receiver, with
// its own clock and DESIGN.md's rule. HOLDFAST_KILLS=200 kills and stops as often, and says what it saw.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "app/daemon.hpp"
#include "drivers/common/monotonic_clock.hpp"
#include "drivers/sim/camera_paced.hpp"
#include "drivers/sim/film.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "drivers/sim/serial.hpp"
#include "drivers/sim/tape.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/skip.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/play/rig.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

using namespace std::chrono_literals;
using Moment = std::chrono::steady_clock::time_point;  // CLOCK_MONOTONIC, as the process's
using Span = std::chrono::microseconds;

constexpr Span kRule = 150ms;   // the receiver's
constexpr Span kPeriod = 40ms;  // of the frames
constexpr Span kLook = 500us;   // how often the receiver looks
constexpr Span kBlind = 20ms;   // a round with a longer pause between two looks shows nothing
constexpr Span kToRecover = 3s;
constexpr Span kWellAgain = 10s;  // more than anything takes on a machine that has time for it

Moment now() {
  return std::chrono::steady_clock::now();
}

// Looks at the lines as a robot controller does, and reads what was too short to be seen from the tape's events. An
// edge came between the look before and the one that sees it: what is `surely` fine is so wherever in between it was,
// what is `perhaps` fine for some such moment.
class Receiver {
 public:
  explicit Receiver(sim::Tape& tape) : tape_(tape) { look(); }

  void look() {
    const Moment at = now();
    const bool alive = tape_.level(hal::Line::kAlive);
    grip_ok_ = tape_.level(hal::Line::kGripOk);
    longest_pause_ = std::max(longest_pause_, std::chrono::duration_cast<Span>(at - looked_));
    if (alive != alive_) {
      edge_after_ = looked_;
      edge_before_ = at;
    }
    alive_ = alive;
    looked_ = at;
    while (const auto event = tape_.read()) take(*event);
  }
  void look_again() {
    std::this_thread::sleep_until(looked_ + kLook);
    look();
  }
  // Looks on until `condition` or `limit`; whether it was the condition.
  template <typename Condition>
  bool look_until(const Condition& condition, Moment limit) {
    while (!condition()) {
      if (looked_ >= limit) return false;
      look_again();
    }
    return true;
  }
  void look_until(Moment limit) {
    (void)look_until([] { return false; }, limit);
  }

  // The longest pause counts from now on.
  void begin() { longest_pause_ = {}; }
  // From now on no edge of ALIVE may confirm GRIP_OK before it has been LOW: it is of before.
  void doubt() {
    look();
    was_low_ = !told_high_;
    unearned_ = 0;
    confirmed_for_ = {};
  }

  [[nodiscard]] bool surely_fine() const { return grip_ok_ && looked_ - edge_after_ < kRule; }
  [[nodiscard]] bool perhaps_fine() const { return grip_ok_ && looked_ - edge_before_ < kRule; }
  [[nodiscard]] Moment looked() const { return looked_; }
  [[nodiscard]] Span longest_pause() const { return longest_pause_; }
  [[nodiscard]] bool blind() const { return longest_pause_ > kBlind; }
  [[nodiscard]] bool was_low() const { return was_low_; }
  [[nodiscard]] int unearned() const { return unearned_; }
  // From the first unearned edge to GRIP_OK LOW, as the process stamped them.
  [[nodiscard]] Span confirmed_for() const { return confirmed_for_; }

 private:
  void take(const sim::TapeEvent& event) {
    if (event.kind != sim::TapeKind::kLine) return;
    if (event.which == static_cast<std::uint8_t>(hal::Line::kGripOk)) {
      told_high_ = event.value != 0;
      if (!told_high_ && !was_low_ && unearned_ > 0) confirmed_for_ = Span(event.time_us - unearned_at_us_);
      was_low_ = was_low_ || !told_high_;
    } else if (event.which == static_cast<std::uint8_t>(hal::Line::kAlive) && told_high_ && !was_low_) {
      if (unearned_++ == 0) unearned_at_us_ = event.time_us;
    }
  }

  sim::Tape& tape_;
  Moment looked_ = now();
  Moment edge_after_{}, edge_before_{};
  bool alive_ = false;
  bool grip_ok_ = false;
  Span longest_pause_{};
  bool told_high_ = false;  // GRIP_OK, by the events
  bool was_low_ = false;
  int unearned_ = 0;
  std::int64_t unearned_at_us_ = 0;
  Span confirmed_for_{};
};

// What the rounds of one kind came to.
struct Figures {
  int rounds = 0;
  int repeated = 0;     // nobody could see
  int untrue = 0;       // looks at which "fine" was against the rule
  int unearned = 0;     // rounds in which ALIVE moved before GRIP_OK had been LOW
  int never_again = 0;  // not within kToRecover
  Span to_safe{};       // to the last look at which it was perhaps fine; the longest
  std::vector<Span> recoveries;
  std::string said;  // by the last process

  void print(const char* name) {
    std::sort(recoveries.begin(), recoveries.end());
    const auto ms = [](Span span) { return static_cast<double>(span.count()) * 1e-3; };
    std::printf(
        "\n%s: %d rounds, %d repeated, %d looks against the rule, %d rounds unearned; to safe at most %.1f ms, "
        "recovery p50 "
        "%.0f ms, most %.0f ms",
        name, rounds, repeated, untrue, unearned, ms(to_safe),
        recoveries.empty() ? 0 : ms(recoveries[recoveries.size() / 2]), recoveries.empty() ? 0 : ms(recoveries.back()));
  }
};

int rounds_wanted() {
  const char* const text = std::getenv("HOLDFAST_KILLS");
  return text != nullptr ? std::max(std::atoi(text), 1) : 12;
}

// Rounds in which the machine left this test no time are repeated; when it never has any, the test cannot tell.
int most_rounds(int wanted) {
  return 3 * wanted + 10;
}

std::string in_figures(const Figures& figures) {
  return std::to_string(figures.untrue) + " untrue, " + std::to_string(figures.unearned) + " unearned, " +
         std::to_string(figures.never_again) + " never again";
}

void check(const Figures& figures, int wanted) {
  const std::string text = in_figures(figures);
  LONGS_EQUAL_TEXT(wanted, figures.rounds, "the machine was too busy to see anything");
  LONGS_EQUAL_TEXT(0, figures.untrue, text.c_str());
  LONGS_EQUAL_TEXT(0, figures.unearned, text.c_str());
  LONGS_EQUAL_TEXT(0, figures.never_again, text.c_str());
  CHECK_TEXT(figures.to_safe > 100ms, figures.said.c_str());  // it was fine before, or this test sees nothing
}

}  // namespace

TEST_GROUP(Process) {
  test::TempDir dir;
  std::string error;
  std::optional<sim::Tape> tape = sim::Tape::file(dir / "tape", sim::Tape::Full::kDrop, true, error);
  scene::Random random{20261122};
  std::unique_ptr<test::HostProcess> process;

  void start(std::vector<std::string> more) {
    std::vector<std::string> command{test::kFirmware, "--real-time", "--tape", (dir / "tape").string()};
    command.insert(command.end(), more.begin(), more.end());
    process = std::make_unique<test::HostProcess>(command);
  }
  std::vector<std::string> kept(const char* what) {
    return {"--keep", (dir / "keep").string(), what};
  }

  // A process that learns the empty gel, keeps what it learned and ends in order.
  void learn(Receiver & receiver) {
    start(kept("--empty"));
    CHECK(receiver.look_until([&] { return receiver.surely_fine(); }, now() + kWellAgain));
    process->send(SIGHUP);  // in order, as SIGTERM
    const test::Finished learned = process->finish();
    LONGS_EQUAL(0, learned.status);
    STRCMP_CONTAINS("REFERENCE", learned.out.c_str());  // those who come after it must not say so
    CHECK(!tape->level(hal::Line::kGripOk));
  }

  // A moment of the frame period that nobody can foresee.
  Moment some_moment() {
    return now() + 2 * kPeriod +
           Span(static_cast<std::int64_t>(random.next() % static_cast<std::uint64_t>(kPeriod.count())));
  }

  // From the moment at which the process was `asked` to end or to stand still, which was `done` soon after.
  void look_for_untruth(Receiver & receiver, Moment asked, Moment done, Moment until, Figures & figures) {
    while (receiver.looked() < until) {
      receiver.look_again();
      if (receiver.perhaps_fine()) {
        figures.to_safe = std::max(figures.to_safe, std::chrono::duration_cast<Span>(receiver.looked() - asked));
      }
      if (receiver.surely_fine() && receiver.looked() > done + kRule) ++figures.untrue;
    }
  }

  // Whether it was fine again in time, GRIP_OK having been LOW meanwhile.
  void look_for_recovery(Receiver & receiver, Moment since, Figures & figures) {
    const bool fine = receiver.look_until([&] { return receiver.surely_fine(); }, since + kWellAgain);
    const Span took = std::chrono::duration_cast<Span>(receiver.looked() - since);
    if (receiver.unearned() > 0 || !receiver.was_low()) ++figures.unearned;
    if (!fine || took > kToRecover) ++figures.never_again;
    figures.recoveries.push_back(took);
  }
};

// The gripper holds: whoever comes after a killed process goes on with what it knew, and does not learn the pressed
// gel.
TEST(Process, AKilledProcessIsNeverFineAndTheNextOneResumes) {
  CHECK_TEXT(tape.has_value(), error.c_str());
  const int wanted = rounds_wanted();
  Receiver receiver(*tape);
  learn(receiver);
  Figures held, empty;
  for (int k = 0; k < most_rounds(2 * wanted) && held.rounds + empty.rounds < 2 * wanted; ++k) {
    Figures& figures = k % 2 == 0 ? held : empty;
    if (figures.rounds == wanted) continue;
    Figures round = figures;
    receiver.doubt();
    receiver.begin();
    const Moment started = now();
    start(kept(k % 2 == 0 ? "--held" : "--empty"));
    look_for_recovery(receiver, started, round);
    receiver.look_until(some_moment());
    const Moment asked = now();
    process->send(SIGKILL);
    look_for_untruth(receiver, asked, now(), asked + kRule + 100ms, round);
    const test::Finished finished = process->finish();
    LONGS_EQUAL(128 + SIGKILL, finished.status);
    STRCMP_CONTAINS("OK", finished.out.c_str());
    CHECK_TEXT(finished.out.find("REFERENCE") == std::string::npos, finished.out.c_str());
    if (receiver.blind()) {
      ++figures.repeated;
      continue;
    }
    figures = round;
    ++figures.rounds;
  }
  held.print("killed, object held");
  empty.print("killed, empty gel");
  check(held, wanted);
  check(empty, wanted);
}

// A checkpoint that cannot be kept is a line in the log; every start died of it (SIGBUS) when the file was mapped.
TEST(Process, AFullFileSystemKeepsNothingAndEverythingElseGoesOn) {
  if (test::run({"unshare", "-Urm", "true"}).status != 0) {
    return test::skip("no name spaces for a file system of its own");
  }
  std::filesystem::create_directory(dir / "full");
  const test::Finished finished =
      test::run({"unshare", "-Urm", "sh", "-c",
                 R"(mount -t tmpfs -o size=4k full "$1" && exec "$2" --real-time --empty --seconds 3 --keep "$1/keep")",
                 "sh", (dir / "full").string(), test::kFirmware});
  LONGS_EQUAL(0, finished.status);
  STRCMP_CONTAINS("OK", finished.out.c_str());
  for (const char* words :
       {"full/keep: No space left on device", "Likely cause: the file system is full", "Next: free"}) {
    STRCMP_CONTAINS(words, finished.err.c_str());
  }
  LONGS_EQUAL(1, std::ranges::count(finished.err, '\n'));
}

TEST(Process, ANumberThatIsNoneIsRefused) {
  const std::string nan = "nan";
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"--seconds", nan}, {"--real-time", "--seconds", "1", "--fps", nan}}) {
    std::vector<std::string> command{test::kFirmware};
    command.insert(command.end(), words.begin(), words.end());
    const test::Finished finished = test::run(command);
    CHECK(finished.status != 0);
    STRCMP_CONTAINS("'nan' is no number from ", finished.err.c_str());
  }
}

// What was true before SIGSTOP is not said after SIGCONT, however the process was caught.
TEST(Process, AStoppedProcessIsNeverFineAndHasToEarnItAnew) {
  CHECK_TEXT(tape.has_value(), error.c_str());
  const int wanted = rounds_wanted();
  Receiver receiver(*tape);
  learn(receiver);
  Figures figures;
  for (int k = 0; k < most_rounds(wanted) && figures.rounds < wanted; ++k) {
    Figures round = figures;
    // Each time another one: frames that were buffered come late, and three of those in ten seconds are a DEGRADED.
    receiver.look();  // what it saw last was the process before
    start(kept(k % 2 == 0 ? "--held" : "--empty"));
    CHECK(receiver.look_until([&] { return receiver.surely_fine(); }, now() + kWellAgain));
    receiver.look_until(some_moment());
    receiver.begin();
    const Moment asked = now();
    process->send(SIGSTOP);
    const Moment done = now();
    const Moment goes_on = asked + kRule + 10ms + Span(static_cast<std::int64_t>(random.next() % 300'000));
    look_for_untruth(receiver, asked, done, goes_on, round);
    receiver.doubt();
    const Moment again = now();
    process->send(SIGCONT);
    look_for_recovery(receiver, again, round);
    process->send(SIGTERM);
    const test::Finished finished = process->finish();
    LONGS_EQUAL(0, finished.status);
    round.said = finished.out;
    CHECK(!tape->level(hal::Line::kGripOk));
    if (receiver.blind()) {
      ++figures.repeated;
      continue;
    }
    figures = round;
    ++figures.rounds;
  }
  figures.print("stopped");
  check(figures, wanted);
}

namespace {

// Lines of a process that stops itself in the narrowest place: its frame was fresh a moment ago, and ALIVE is about to
// move.
class StopsBeforeAlive final : public hal::Gpio {
 public:
  StopsBeforeAlive(sim::Tape& tape, const hal::Clock& clock) : gpio_(clock) { gpio_.record(tape); }

 private:
  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override {
    if (line == hal::Line::kAlive && gpio_.level(hal::Line::kGripOk) == hal::Level::kHigh && ++well_ % 10 == 0) {
      (void)std::raise(SIGSTOP);
    }
    return gpio_.set(line, level);
  }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input) override { return std::nullopt; }

  sim::Gpio gpio_;
  int well_ = 0;
};

}  // namespace

// No check can come so late that nothing fits in behind it. Here a stale frame does confirm - until the next look at
// the clock, right behind the edge, takes it back.
TEST(Process, StoppedBetweenTheLookAtTheClockAndTheEdgeItVouchesForAMomentOnly) {
  CHECK_TEXT(tape.has_value(), error.c_str());
  const sim::Film film = sim::shoot(hal::PixelFormat::kLuma8, 4);
  const pid_t pid = ::fork();
  CHECK(pid >= 0);
  if (pid == 0) {
    drivers::MonotonicClock clock;
    sim::PacedCamera::Config config;
    config.touch = Span::max();
    sim::PacedCamera camera(film, clock, config);
    StopsBeforeAlive gpio(*tape, clock);
    sim::Serial link, gripper;
    hal::NoKeep keep;
    tool::OneThreadDecoder jpeg(Params{});
    const auto daemon =
        std::make_unique<Daemon>(Devices{camera, gpio, link, clock, jpeg.get()}, Periphery{gripper, keep});
    if (!daemon->start(Params{}).ok()) ::_exit(1);
    while (true) daemon->poll();
  }
  Receiver receiver(*tape);
  const auto stopped = [&] {
    int status = 0;
    return ::waitpid(pid, &status, WNOHANG | WUNTRACED) == pid && WIFSTOPPED(status);
  };
  constexpr int kTries = 3;
  Span shortest = Span::max(), longest{};
  for (int round = 0; round < kTries; ++round) {
    CHECK(receiver.look_until(stopped, now() + kWellAgain));
    receiver.look_until(now() + 2 * kRule);
    CHECK(!receiver.perhaps_fine());
    receiver.doubt();
    ::kill(pid, SIGCONT);
    CHECK(receiver.look_until([&] { return receiver.was_low(); }, now() + kWellAgain));
    shortest = std::min(shortest, receiver.confirmed_for());
    longest = std::max(longest, receiver.confirmed_for());
    LONGS_EQUAL(1, receiver.unearned());
  }
  ::kill(pid, SIGKILL);
  ::waitpid(pid, nullptr, 0);
  std::printf("\nstopped just before ALIVE's edge: it confirms %lld to %lld us",
              static_cast<long long>(shortest.count()), static_cast<long long>(longest.count()));
  CHECK(shortest < std::chrono::milliseconds(1));  // the longest is this machine's, which has other work
}
