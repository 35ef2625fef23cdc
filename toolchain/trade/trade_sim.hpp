// SPDX-License-Identifier: Apache-2.0
// Work and precision of the simulator's levels: what each way to compute the contact costs and how far it is from the
// finest grid, and what it costs to enter the firmware later or earlier, and changes.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/scene.hpp"

namespace holdfast::tool {

// One level on one scene.
struct LevelPrice {
  std::string level;    // "springs 64", "grid 0.70 mm"
  bool best = false;    // nothing is both faster and nearer
  double us_p50 = 0.0;  // thread CPU time of a frame in contact, marker motion included
  double rms_px = 0.0;  // of all markers and frames in contact, against the reference; px of a picture 320 wide
  int label_flips = 0;  // frames whose label (more than half slips) differs
  int frames = 0;       // in contact
};

// One way into the firmware, on one scene as it is, the scene's own contact and effects.
struct EntryPrice {
  std::string_view entry;        // of scene::kInjectNames
  double us_p50 = 0.0;           // thread CPU time of a frame in contact, simulator and firmware
  std::optional<double> rms_px;  // where there are pictures: marker centres against the truth; px of a picture 320 wide
  double entropy_nat = 0.0;      // mean change of E against the features' entry, frames in contact that both accept
  int refused = 0;               // frames that the firmware did not accept, once it has its rest position
  int frames = 0;                // in contact
};

struct TradeSimConfig {
  double reference_cell_mm = 0.35;
  int repeats = 3;  // of the timing
};

// All levels that can play the scene's object; the reference last. The scene is played at features, without noise:
// every difference is the contact's.
[[nodiscard]] std::vector<LevelPrice> price_levels(const scene::Scene& asked, const TradeSimConfig& config);

// All ways in, cheapest first.
[[nodiscard]] std::vector<EntryPrice> price_entries(const scene::Scene& scene);

}  // namespace holdfast::tool
