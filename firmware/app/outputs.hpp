// SPDX-License-Identifier: Apache-2.0
// The two output lines, and the one order in which they may change.
//
// ALIVE confirms GRIP_OK, so it moves only after GRIP_OK has taken its level. The one exception is a rise of GRIP_OK,
// which follows the edge: no receiver may pair a new HIGH with the edge of the frame before. GRIP_OK rises with an
// accepted frame only: the supervisor may hold OK over rejected frames, whose edge is an old one.
// Whatever line refuses, GRIP_OK is tried LOW and ALIVE stands still until GRIP_OK has obeyed for `line_trust` frames.
// Right before the edge the frame's age is looked at, and once more right after it: a process that was stopped for long
// just there (SIGSTOP, a debugger) lowers GRIP_OK.
#pragma once

#include <cstdint>
#include <optional>

#include "app/watchdog.hpp"
#include "base/status.hpp"
#include "base/units.hpp"
#include "hal/clock.hpp"
#include "hal/gpio.hpp"

namespace holdfast::outputs {

struct Config {
  // From the start of exposure to the edge: exposure 18 ms, USB transfer 40 ms, and one period of queueing. Older
  // frames are rejected, and never confirmed.
  Micros oldest_frame{150'000};
  // Accepted frames for which GRIP_OK must have obeyed after a refusal before ALIVE moves again: 1 s at 25 fps. A line
  // that somebody else drives as well obeys now and then; if every second time by chance, 25 times in a row once in
  // 3e7.
  int line_trust = 25;
};

struct State {
  bool grip_ok = false;                   // as it was driven last
  bool alive = false;                     // level that ALIVE took last
  int distrusted = 0;                     // accepted frames to go until the lines are trusted again
  std::uint32_t trips = 0;                // of the watchdog, that are known
  std::optional<Micros> first_confirmed;  // when ALIVE confirmed a frame first since start()
};

// What the lines have to say.
struct Wanted {
  bool grip_ok = false;
  bool accepted = false;  // ALIVE changes its level
  Micros timestamp{};     // of the frame that this follows from
};

// Whether a frame of then is too old now to be confirmed.
[[nodiscard]] inline bool is_stale(const Config& config, Micros timestamp, Micros now) {
  return now - timestamp > config.oldest_frame;
}

// Both lines LOW. False: one of them refuses.
[[nodiscard]] bool start(State& state, hal::Gpio& gpio);

// The watchdog has lowered GRIP_OK since the last call of this. Ask before update().
[[nodiscard]] bool lowered_meanwhile(State& state, const OutputWatchdog& watchdog);

// Drives the lines. kNone: both took the level that was wanted. kFrameStale, kGpioFailed: GRIP_OK was driven LOW
// instead, and the device is at fault. Once GRIP_OK is LOW without an accepted frame there is nothing left to watch.
[[nodiscard]] Reason update(State& state, const Config& config, hal::Gpio& gpio, const hal::Clock& clock,
                            OutputWatchdog& watchdog, const Wanted& wanted);

// GRIP_OK LOW; ALIVE stays where it is. Nothing is left to be done about a line that refuses now: a receiver sees ALIVE
// stand still.
void stop(State& state, hal::Gpio& gpio, OutputWatchdog& watchdog);

}  // namespace holdfast::outputs
