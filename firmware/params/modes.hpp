// SPDX-License-Identifier: Apache-2.0
// The speed settings: one table. What each costs and gains is measured by `holdfast trade`, not written here.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "vision/jpeg.hpp"

namespace holdfast {

struct Mode {
  std::string_view name;  // as for --mode and in settings
  DecodeScale scale;      // of the camera's JPEG picture
  std::string_view help;
};

// Index = value of the parameter `mode`. From fast to precise.
inline constexpr std::array<Mode, 3> kModes{{
    {"fast", DecodeScale::kEighth, "decode at 1/8 (410x308 of the camera's 3280x2464): least time and memory"},
    {"balanced", DecodeScale::kQuarter, "decode at 1/4 (820x616): four times the pixels of fast"},
    {"precise", DecodeScale::kHalf, "decode at 1/2 (1640x1232): sixteen times the pixels of fast"},
}};

[[nodiscard]] constexpr std::optional<std::int32_t> find_mode(std::string_view name) {
  for (std::size_t i = 0; i < kModes.size(); ++i) {
    if (kModes[i].name == name) return static_cast<std::int32_t>(i);
  }
  return std::nullopt;
}

}  // namespace holdfast
