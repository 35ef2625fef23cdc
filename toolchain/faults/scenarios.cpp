// SPDX-License-Identifier: Apache-2.0
#include "toolchain/faults/scenarios.hpp"

#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <utility>

#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::faults {
namespace {

using namespace std::chrono_literals;

constexpr Micros kFaultAt = 4017ms;  // between two frames
constexpr Micros kFaultFor = 2s;
constexpr Micros kSecondAfter = 413ms;
constexpr Micros kCalmAfter = 6s;  // a gripper that is activated anew and then asked to grip takes 4 s of it

// What takes a person, or time of its own, to end.
bool leaves_traces(Trouble trouble) {
  return trouble == Trouble::kCameraLate || trouble == Trouble::kLinesSlow;  // late frames count for 10 s
}

const char* situation_name(bool held) {
  return held ? ", held" : ", empty";
}

bool needs_jpeg(Trouble trouble) {
  return trouble == Trouble::kCameraTruncated || trouble == Trouble::kCameraComment;
}

// What dies for good does so the last time that it fails.
Setup finished(Setup setup) {
  setup.jpeg = std::any_of(setup.windows.begin(), setup.windows.end(),
                           [](const Window& window) { return needs_jpeg(window.trouble); });
  Window& last = setup.windows.back();
  setup.end = last.to + kCalmAfter;
  Window* const dead = last.trouble == Trouble::kUsbDead ? &last : &setup.windows.front();
  if (dead->trouble == Trouble::kUsbDead) dead->to = setup.end;
  return setup;
}

}  // namespace

const std::array<Cell, 49>& cells() {
  using C = Component;
  using T = Type;
  using B = Trouble;
  // clang-format off
  static const std::array<Cell, 49> all{{
      {C::kCamera, T::kOff, B::kCameraOff, ""},
      {C::kCamera, T::kStuck, B::kCameraStuck, ""},
      {C::kCamera, T::kGarbage, B::kCameraGarbage, ""},
      {C::kCamera, T::kWrong, B::kCameraOther, ""},
      {C::kCamera, T::kSlow, B::kCameraSlow, ""},
      {C::kCamera, T::kDelayed, B::kCameraStale, ""},
      {C::kCamera, T::kIntermittent, B::kCameraComesAndGoes, ""},
      {C::kGpio, T::kOff, B::kLinesRefuse, ""},
      {C::kGpio, T::kStuck, B::kLinesStuck, ""},
      {C::kGpio, T::kGarbage, B::kLinesRandom, ""},
      {C::kGpio, T::kWrong, {}, "a line of another name is refused at the start (tests/drivers/gpio_wiring_test.cpp); "
                                "two wires swapped outside the board cannot be seen from it"},
      {C::kGpio, T::kSlow, B::kLinesSlow, ""},
      {C::kGpio, T::kDelayed, B::kLinesDelayed, ""},
      {C::kGpio, T::kIntermittent, B::kLinesNowAndThen, ""},
      {C::kSerial, T::kOff, B::kLinkOff, ""},
      {C::kSerial, T::kStuck, B::kLinkFull, ""},
      {C::kSerial, T::kGarbage, B::kLinkFlood, ""},
      {C::kSerial, T::kWrong, B::kLinkText, ""},
      {C::kSerial, T::kSlow, B::kLinkSlow, ""},
      {C::kSerial, T::kDelayed, {}, "frames carry their age, and a receiver keeps the rule by its own clock "
                                    "(toolchain/robot/holdfast_link.h); the firmware cannot see it"},
      {C::kSerial, T::kIntermittent, B::kLinkNowAndThen, ""},
      {C::kGripper, T::kOff, B::kGripperSilent, ""},
      {C::kGripper, T::kStuck, {}, "a gripper that answers with the same status for ever looks like one that holds "
                                   "still; a command that it does not echo is silence (gripper/off)"},
      {C::kGripper, T::kGarbage, B::kGripperGarbage, ""},
      {C::kGripper, T::kWrong, B::kGripperWrongSlave, ""},
      {C::kGripper, T::kSlow, B::kGripperSlow, ""},
      {C::kGripper, T::kDelayed, B::kGripperLate, ""},
      {C::kGripper, T::kIntermittent, B::kGripperNowAndThen, ""},
      {C::kClock, T::kOff, {}, "the kernel's monotonic clock is a read of a register; without it nothing runs"},
      {C::kClock, T::kStuck, B::kClockStuck, ""},
      {C::kClock, T::kGarbage, B::kClockJumps, ""},
      {C::kClock, T::kWrong, B::kClockAhead, ""},
      {C::kClock, T::kSlow, B::kClockSlow, ""},
      {C::kClock, T::kDelayed, B::kClockBack, ""},
      {C::kClock, T::kIntermittent, B::kClockJumps, ""},
      {C::kStorage, T::kOff, B::kKeepOff, ""},
      {C::kStorage, T::kStuck, B::kKeepStuck, ""},
      {C::kStorage, T::kGarbage, B::kKeepGarbage, ""},
      {C::kStorage, T::kWrong, B::kKeepWrong, ""},
      {C::kStorage, T::kSlow, {}, "a file under /run, which is memory: no medium to wait for (drivers/common/file_keep.hpp)"},
      {C::kStorage, T::kDelayed, {}, "a file under /run, which is memory: what is written is there"},
      {C::kStorage, T::kIntermittent, B::kKeepTorn, ""},
      {C::kModel, T::kOff, {}, "without a file the compiled tree decides; it is code"},
      {C::kModel, T::kStuck, {}, "a tree is read-only; its features are the camera's to be stuck"},
      {C::kModel, T::kGarbage, B::kModelDamaged, ""},
      {C::kModel, T::kWrong, {}, "refused when it is loaded: version, set, features, formats (model_file_test.cpp)"},
      {C::kModel, T::kSlow, {}, "at most kMaxDepth comparisons, whatever the tree (model_file_test.cpp)"},
      {C::kModel, T::kDelayed, {}, "it is loaded before the start, and never again"},
      {C::kModel, T::kIntermittent, {}, "it is loaded before the start, and never again"},
  }};
  // clang-format on
  return all;
}

const std::array<Row, 26>& rows() {
  using B = Trouble;
  // clang-format off
  static const std::array<Row, 26> all{{
      {1, "USB unplugged and plugged in again", B::kCameraGone, ""},
      {2, "the driver's call never returns", B::kCameraHangs, ""},
      {3, "the stream stalls without an error", B::kCameraOff, ""},
      {4, "the same picture again and again", B::kCameraStuck, ""},
      {5, "truncated JPEG", B::kCameraTruncated, ""},
      {6, "damaged transfer, reported by the driver", B::kCameraBad, ""},
      {7, "another camera in its place", B::kCameraOther, ""},
      {8, "no USB bandwidth when the stream starts", B::kCameraRefused, ""},
      {9, "timestamps run backwards", B::kStampsBack, ""},
      {10, "automatic exposure halves the rate", B::kCameraHalfRate, ""},
      {11, "light off", B::kDark, ""},
      {12, "markers missing or dirty", B::kLostMarkers, ""},
      {13, "under-voltage of the board", B::kSupplyLow, ""},
      {14, "thermal throttling: frames are decided late", B::kCameraLate, ""},
      {15, "SD card worn or cut off from power", B::kCardTorn, ""},
      {16, "disk full when settings are saved", B::kDiskFull, ""},
      {17, "the clock jumps", B::kClockAhead, ""},
      {18, "flood of bytes on a port", B::kLinkFlood, ""},
      {19, "serial adaptor unplugged", B::kGripperPortOff, ""},
      {20, "the gripper's replies are damaged", B::kGripperWrongCrc, ""},
      {21, "chips of GPIO lines are renumbered", B::kChipsRenumbered, ""},
      {22, "an output line refuses or is stolen", B::kLinesRefuse, ""},
      {23, "the process is killed and started again", B::kKilled, ""},
      {24, "model or settings damaged", B::kRecordsDamaged, ""},
      {25, "the USB controller dies for good", B::kUsbDead, ""},
      {26, "two faults at once, or one twice", {}, "all pairs of the 25 others: --pairs"},
  }};
  // clang-format on
  return all;
}

Setup setup_of(Trouble trouble, bool held) {
  Setup setup;
  setup.held = held;
  setup.windows = {{trouble, kFaultAt, kFaultAt + kFaultFor}};
  return finished(std::move(setup));
}

Setup setup_of(Trouble first, Trouble second, bool held) {
  Setup setup = setup_of(first, held);
  setup.windows[0].to = kFaultAt + kFaultFor;
  const Micros from = (first == second ? setup.windows[0].to : kFaultAt) + kSecondAfter;
  setup.windows.push_back({second, from, from + kFaultFor});
  return finished(std::move(setup));
}

Setup on_hand(Setup setup, int finger, int second_finger) {
  setup.hand = true;
  for (std::size_t k = 0; k < setup.windows.size(); ++k) {
    if (is_camera(setup.windows[k].trouble)) setup.windows[k].finger = k == 0 ? finger : second_finger;
  }
  return setup;
}

Setup soak_setup(std::uint64_t frames, std::uint64_t seed) {
  Setup setup;
  setup.seed = seed;
  setup.end = Micros{40'000} * static_cast<std::int64_t>(frames);
  scene::Random random(seed);
  const auto below = [&](std::uint64_t limit) { return random.next() % limit; };
  // 10 to 30 s apart: 500 frames in the mean; 0.2 to 3 s long.
  for (Micros at = 10s; at < setup.end - 10s; at += Micros{10'000'000 + static_cast<std::int64_t>(below(20'000'000))}) {
    const Trouble trouble = static_cast<Trouble>(below(kTroubles));
    if (needs_jpeg(trouble)) continue;
    setup.windows.push_back({trouble, at, at + Micros{200'000 + static_cast<std::int64_t>(below(2'800'000))}});
  }
  return setup;
}

bool Run::passed() const {
  if (crashed || !judgement.ended || judgement.unsafe_fine > Micros{0}) return false;
  if (expect_fine) return judgement.faults == 0;
  const bool for_good = std::any_of(setup.windows.begin(), setup.windows.end(),
                                    [&](const Window& window) { return window.to >= setup.end; });
  if (for_good) return judgement.last_state == DeviceState::kFault;
  const bool traces = std::any_of(setup.windows.begin(), setup.windows.end(),
                                  [](const Window& window) { return leaves_traces(window.trouble); });
  return (judgement.last_state == DeviceState::kOk && judgement.fine_at_end) ||
         (traces && judgement.last_state == DeviceState::kDegraded);
}

int false_faults(const Run& run) {
  const auto explained = [&](Micros at) {
    return std::any_of(run.setup.windows.begin(), run.setup.windows.end(),
                       [&](const Window& window) { return window.from <= at && at <= window.to + kCalmAfter; });
  };
  const std::vector<Micros>& all = run.judgement.fault_at;
  return static_cast<int>(std::count_if(all.begin(), all.end(), [&](Micros at) { return !explained(at); }));
}

Run play(std::string name, Setup setup, bool expect_fine) {
  Run run;
  run.name = std::move(name);
  run.setup = setup;
  run.expect_fine = expect_fine;
  prepare();
  auto tape = sim::Tape::anonymous(sim::Tape::Full::kWait);
  void* const memory = ::mmap(nullptr, sizeof(Outcome), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  run.crashed = true;
  if (!tape || memory == MAP_FAILED) return run;
  auto* const outcome = new (memory) Outcome;
  (void)std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    // Ends with its observer, and with Ctrl-C at once: it would wait for a reader of its tape for ever.
    (void)::prctl(PR_SET_PDEATHSIG, SIGKILL);
    (void)std::signal(SIGINT, SIG_DFL);
    World world(std::move(setup), *tape);
    *outcome = world.run();
    ::_exit(0);
  }
  // Reads while the child plays: a long run does not fit on the tape.
  Judge judge;
  int status = 0;
  for (bool lives = child > 0; lives;) {
    lives = ::waitpid(child, &status, WNOHANG) == 0;
    bool any = false;
    while (const auto event = tape->read()) {
      judge.take(*event);
      any = true;
    }
    if (lives && !any) ::usleep(500);
  }
  run.crashed = child <= 0 || !WIFEXITED(status) || WEXITSTATUS(status) != 0;
  run.judgement = judge.finish();
  run.outcome = *outcome;
  ::munmap(memory, sizeof(Outcome));
  return run;
}

bool must_stay_fine(Trouble trouble) {
  return info(trouble).component == Component::kSerial || trouble == Trouble::kGripperSlow ||
         trouble == Trouble::kDiskFull;
}

Run play(Trouble trouble, bool held) {
  return play(std::string(info(trouble).name) + situation_name(held), setup_of(trouble, held), must_stay_fine(trouble));
}

Run play(Trouble first, Trouble second, bool held) {
  return play(std::string(info(first).name) + " + " + std::string(info(second).name) + situation_name(held),
              setup_of(first, second, held));
}

namespace {

std::string name_on(Trouble trouble, int finger) {
  return std::string(info(trouble).name) + (!is_camera(trouble) ? "" : finger == 0 ? " left" : " right");
}

}  // namespace

Run play_hand(Trouble trouble, int finger, bool held) {
  return play("hand: " + name_on(trouble, finger) + situation_name(held), on_hand(setup_of(trouble, held), finger),
              must_stay_fine(trouble));
}

Run play_hand(Trouble first, Trouble second, bool held) {
  return play("hand: " + name_on(first, 0) + " + " + name_on(second, 1) + situation_name(held),
              on_hand(setup_of(first, second, held), 0, 1));
}

}  // namespace holdfast::faults
