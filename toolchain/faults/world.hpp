// SPDX-License-Identifier: Apache-2.0
// The whole appliance in virtual time, with everything around it that can fail: camera, clock, lines, link, gripper,
// kept memory, stored settings and model, the board, the process itself. Somebody sits at the console: saves, and
// stores anew what was lost. What fails, and when, is a list of windows; what the truth was, the tape is told.
//
// Modelled: faults as the firmware meets them at the HAL, at times, not frames; a second thread that watches the
// outputs (app/watchdog.hpp) every 10 ms of virtual time; a process that is killed and started again, or stopped. Not
// modelled: the operating system's part of a fault (drivers/linux has its own tests); the time that code takes.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "base/units.hpp"
#include "drivers/sim/tape.hpp"

namespace holdfast::faults {

enum class Trouble : std::uint8_t {
  // camera
  kCameraOff,           // sends nothing
  kCameraGone,          // unplugged, and plugged in again when the window ends
  kCameraRefused,       // gone, and refuses to start for as long
  kCameraHangs,         // the call that waits for a frame does not return
  kCameraStuck,         // the same bytes with new stamps and numbers
  kCameraRing2,         // the last 2 pictures in turn, with new stamps and numbers
  kCameraRing3,         // the last 3
  kCameraRing32,        // the last 32, as many as V4L2 has buffers
  kCameraComment,       // the same picture, its bytes differ in a comment: JPEG only
  kCameraGarbage,       // random bytes
  kCameraBad,           // the driver reports a damaged transfer
  kCameraTorn,          // the lower half is of the picture before
  kCameraTruncated,     // half of the bytes: JPEG only
  kCameraOther,         // another sensor's serial number, after a replug
  kCameraNoGel,         // a picture without markers
  kCameraSlow,          // 5 fps
  kCameraHalfRate,      // 9 fps
  kCameraLate,          // 60 ms late, stamped truly: decided after the deadline
  kCameraStale,         // 200 ms late, stamped truly
  kCameraComesAndGoes,  // 200 ms on, 300 ms off
  kCameraTwoOfThree,    // two of three transfers damaged
  kStampsBack,
  kStampsAhead,
  kStampsEqual,
  kDark,
  kBright,
  kFewMarkers,   // 10 of 63 hidden
  kLostMarkers,  // 25 of 63 hidden
  // clock
  kClockStuck,
  kClockAhead,  // 10 s
  kClockBack,   // 10 s
  kClockSlow,   // half as fast
  kClockJumps,  // between now and 1 s ahead, every 100 ms
  // lines
  kLinesRefuse,
  kLinesStuck,
  kLinesRandom,
  kLinesSlow,        // a call takes 30 ms
  kLinesDelayed,     // a level comes 50 ms after the call
  kLinesNowAndThen,  // every third call refused
  // link
  kLinkOff,
  kLinkFull,   // nobody reads
  kLinkFlood,  // random bytes, as many as fit
  kLinkText,   // lines of text
  kLinkSlow,   // a command, one byte every 50 ms
  kLinkNowAndThen,
  // gripper
  kGripperPortOff,
  kGripperSilent,
  kGripperDeaf,
  kGripperGarbage,
  kGripperWrongCrc,
  kGripperWrongSlave,
  kGripperLate,          // by 60 ms
  kGripperSlow,          // replies 15 ms late: slow, and in time
  kGripperNowAndThen,    // every second reply is missing
  kGripperMajorFault,    // gFLT 0xE
  kGripperHot,           // gFLT 8
  kGripperUndervoltage,  // gFLT 0xA
  kObjectLost,
  // kept memory, met by the process that is started in the middle of the window
  kKeepOff,
  kKeepStuck,  // what is written is not kept
  kKeepGarbage,
  kKeepWrong,  // of another sensor
  kKeepTorn,   // half of the newest slot is the older one's
  // the process
  kKilled,   // for the length of the window, then started anew
  kStopped,  // SIGSTOP
  // what is stored on the card
  kDiskFull,        // `save` finds no room; behind the window it does
  kCardTorn,        // `save` is written by half; the process that starts in the middle of the window meets it
  kModelDamaged,    // met by the process that is started in the middle
  kRecordsDamaged,  // likewise: settings and model
  // the board
  kSupplyLow,        // under-voltage, which its kernel measures once a second
  kChipsRenumbered,  // of the lines, met by the process that is started in the middle
  kUsbDead,          // the controller: camera and the gripper's adapter are gone
};

struct Window {
  Trouble trouble = Trouble::kCameraOff;
  Micros from{};
  Micros to{};
  int finger = kEveryFinger;  // whose camera
  static constexpr int kEveryFinger = -1;
};

enum class Component : std::uint8_t { kCamera, kGpio, kSerial, kGripper, kClock, kStorage, kModel, kProcess, kBoard };
inline constexpr std::array<std::string_view, 9> kComponentNames{"camera",  "gpio",  "serial",  "gripper", "clock",
                                                                 "storage", "model", "process", "board"};

struct TroubleInfo {
  Trouble trouble;
  Component component;
  std::string_view name;
  // While it lasts "fine" is untrue. False: the grasp is watched as well as before (a link that nobody reads), or
  // frames are still fresh and true (few markers, a low rate), and no more is asked than that nothing is stale.
  bool unsafe;
  // For so long what came last is still true: the frame that was under way, the clock that is not off by more than a
  // frame, the edge that is delayed. The truth turns unsafe then.
  Micros honest{};
};
[[nodiscard]] const TroubleInfo& info(Trouble trouble);
inline constexpr int kTroubles = static_cast<int>(Trouble::kUsbDead) + 1;

struct Setup {
  bool hand = false;    // two fingers; the right one's pictures come 17 ms behind the left one's
  bool held = true;     // an object is between the fingers from 1.2 s on; false: the gel stays empty
  Micros falls_at{};    // and falls then; 0: it stays
  bool gripper = true;  // a Hand-E holds it
  bool jpeg = false;    // pictures come as JPEG (slower), not as luma
  Micros period{40'000};
  int drop_every = 0;  // every so many frames one is lost on the way; 0: none
  Micros end{9'000'000};
  std::uint64_t seed = 1;
  std::vector<Window> windows;  // in the order of their beginnings
};

// Facts for a report, beside what the tape tells.
struct Outcome {
  std::uint64_t frames = 0;   // accepted
  std::uint32_t resumed = 0;  // processes that went on with a kept reference
  std::uint32_t loaded = 0;   // and that decided by a stored model
  std::uint32_t saves = 0, saves_failed = 0;
  long growth_kb = 0;  // of the resident set, from the first second on
  int open_files = 0;  // more than at the start
};

// Films the gel once; a child process inherits it.
void prepare();

class World {
 public:
  // `tape` records lines and states; the truth is written to it when the run begins. Both outlive the world.
  World(Setup setup, sim::Tape& tape);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;
  World(World&&) = delete;
  World& operator=(World&&) = delete;

  Outcome run();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace holdfast::faults
