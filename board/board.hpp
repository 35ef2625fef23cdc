// SPDX-License-Identifier: Apache-2.0
// What a board gives to the firmware. One file per board implements it: board/<name>/board.cpp is the only place that
// picks drivers, pins and polarity.
#pragma once

#include "app/app.hpp"
#include "app/params.hpp"
#include "hal/serial.hpp"

namespace holdfast::board {

// Built on the first call, alive until the program ends.
[[nodiscard]] Devices& devices();
// The text side of the port `host`: one line per change of state.
[[nodiscard]] hal::Serial& host();
[[nodiscard]] Params params();

}  // namespace holdfast::board
