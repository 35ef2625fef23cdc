// SPDX-License-Identifier: Apache-2.0
// What a board gives to the firmware. One file per board implements it: board/<name>/board.cpp is the only place that
// picks drivers, pins and polarity.
#pragma once

#include <optional>

#include "app/daemon.hpp"
#include "app/watchdog.hpp"
#include "console/console.hpp"
#include "hal/serial.hpp"
#include "params/params.hpp"
#include "slip/model.hpp"

namespace holdfast::board {

// First of all: reads the command line and makes everything below, which then lives until the program ends. A status to
// leave with: help was asked for (0), the board cannot be made (1), the command line is wrong (2); stderr says why.
[[nodiscard]] std::optional<int> make(int argc, char** argv);

[[nodiscard]] Devices& devices();
[[nodiscard]] Periphery& periphery();
// The port `host`, and what the console there has to know of the board.
[[nodiscard]] hal::Serial& host();
[[nodiscard]] console::Place place();
[[nodiscard]] Params params();
// A loaded model that decides; null: the one that is compiled in.
[[nodiscard]] const model::Tree* model();

// Has `watchdog` called from a thread of its own until the program ends; a board in virtual time needs none. Before the
// Daemon starts. False: no thread is to be had.
[[nodiscard]] bool watch(OutputWatchdog& watchdog);
// The Daemon has started: whoever waits for that may be told.
void started();
// Once around: what the board's log is to say of it.
void tell(const App& app);
// The program was asked to end, or there is nothing more to see.
[[nodiscard]] bool over();

}  // namespace holdfast::board
