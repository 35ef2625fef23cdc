// SPDX-License-Identifier: Apache-2.0
// Written by wire_doc from toolchain/trade/trade.csv, which `holdfast trade` measured; do not edit.
#pragma once

#include <array>
#include <cstdint>

#include "params/modes.hpp"

namespace holdfast {

// What a mode costs and gains: CPU time of a frame on the machine that measured (compare, do not rely on it),
// aarch64 instructions, memory it works on, how well it sees filmed markers, and what it detects on recordings.
struct ModePrice {
  std::int32_t us = 0;
  std::int32_t kilo_instructions = 0;
  std::int32_t memory_bytes = 0;
  std::int32_t marker_error_upx = 0;    // RMS, in millionths of a pixel of a picture 320 wide
  std::int32_t entropy_error_unat = 0;  // in millionths of a nat
  std::int32_t onsets_milli_pct = 0;       // of recorded onsets, detected within 10 frames
  std::int32_t alarms_milli_per_hour = 0;  // false ones where the recordings are silent
};

// In the order of kModes.
inline constexpr std::array<ModePrice, kModes.size()> kModePrices{{
    {2144, 16547, 2489096, 10380, 2596, 98780, 2343},
    {14192, 69925, 1767944, 8033, 1682, 98780, 2343},
    {17957, 86227, 3283304, 7627, 1706, 98780, 2343},
}};

}  // namespace holdfast
