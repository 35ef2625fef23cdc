// SPDX-License-Identifier: Apache-2.0
// One frame as logs and the page of a session keep it: what the firmware decided, what it saw, and the picture.
#pragma once

#include <cstdint>
#include <vector>

#include "toolchain/session/overlay.hpp"
#include "toolchain/session/report.hpp"

namespace holdfast::log {

struct LogFrame {
  tool::ReportFrame told;           // time, state, features, lines
  bool alive = false;               // level of the line ALIVE
  double decided_us = 0;            // arrival to edge; 0: not known (virtual time)
  std::vector<tool::Arrow> arrows;  // row by row, in pixels of the picture; a lost marker is not valid
  int cols = 0;                     // of the grid
  std::vector<std::uint8_t> jpeg;   // as the camera sent it; empty: no JPEG, or not kept
};

}  // namespace holdfast::log
