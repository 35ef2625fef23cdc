// SPDX-License-Identifier: Apache-2.0
// Written by wire_doc from toolchain/trade/trade.csv, which `holdfast trade` measured; do not edit.
#pragma once

#include <array>
#include <cstdint>

#include "params/modes.hpp"

namespace holdfast {

// What a mode costs and gains: CPU time of a frame on the machine that measured (compare, do not rely on it),
// aarch64 instructions, memory it works on, and how well it sees filmed grasps.
struct ModePrice {
  std::int32_t us = 0;
  std::int32_t kilo_instructions = 0;
  std::int32_t memory_bytes = 0;
  std::int32_t marker_error_upx = 0;    // RMS, in millionths of a pixel of a picture 320 wide
  std::int32_t entropy_error_unat = 0;  // in millionths of a nat
  std::int32_t balanced_milli_pct = 0;  // balanced accuracy, in thousandths of a percent
  std::int32_t delay_ms = 0;            // median, from the onset of slip
};

// In the order of kModes.
inline constexpr std::array<ModePrice, kModes.size()> kModePrices{{
    {2062, 18312, 2573472, 10383, 2770, 75368, 80},
    {10803, 70250, 1860944, 8032, 1932, 75172, 80},
    {12903, 81396, 3376304, 7628, 1951, 75172, 80},
}};

}  // namespace holdfast
