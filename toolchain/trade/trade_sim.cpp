// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/trade_sim.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/play/rig.hpp"
#include "toolchain/play/thread_time.hpp"
#include "toolchain/trade/rival.hpp"

namespace holdfast::tool {
namespace {

// Of a picture 320 wide of the cropped view, in which the literature counts.
constexpr double kPxPerMm = 15.79;

struct Setting {
  scene::Level level;
  std::string name;
};

std::vector<Setting> settings(const TradeSimConfig& config) {
  std::vector<Setting> all;
  const auto add = [&](scene::ContactLevel contact, int springs, double cell_mm, std::string name) {
    all.push_back({{scene::Inject::kFeatures, contact, springs, cell_mm}, std::move(name)});
  };
  for (const int springs : {8, 16, 32, 64, 128, 256}) {
    add(scene::ContactLevel::kSprings, springs, 0.7, fmt::format("springs {}", springs));
  }
  for (const double cell_mm : {1.4, 1.0, 0.7, 0.5}) {
    add(scene::ContactLevel::kGrid, 64, cell_mm, fmt::format("grid {:.2f} mm", cell_mm));
  }
  add(scene::ContactLevel::kGrid, 64, config.reference_cell_mm,
      fmt::format("grid {:.2f} mm", config.reference_cell_mm));
  return all;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Run {
  std::vector<std::vector<scene::Vec2>> motion_mm;
  std::vector<bool> touching;
  std::vector<bool> slips;
  std::vector<double> us;  // of frames in contact
};

Run run(const scene::Scene& scene, int repeats) {
  Run out;
  for (int r = 0; r < repeats; ++r) {
    scene::Simulation simulation(scene);
    for (int k = 0; k < scene::frame_count(scene); ++k) {
      const double start = thread_us();
      const scene::Snapshot& snapshot = simulation.next();
      const double spent_us = thread_us() - start;
      const bool touches = snapshot.contact.normal_n > 0.0;
      if (touches) out.us.push_back(spent_us);
      if (r > 0) continue;
      out.motion_mm.push_back(snapshot.motion_mm);
      out.touching.push_back(touches);
      out.slips.push_back(snapshot.level >= scene::SlipLevel::kHalf);
    }
  }
  return out;
}

void compare(const Run& reference, const Run& level, LevelPrice& price) {
  double squares = 0.0;
  long markers = 0;
  for (std::size_t k = 0; k < reference.motion_mm.size(); ++k) {
    if (!reference.touching[k] && !level.touching[k]) continue;
    ++price.frames;
    for (std::size_t i = 0; i < reference.motion_mm[k].size(); ++i) {
      const double x = (level.motion_mm[k][i].x - reference.motion_mm[k][i].x) * kPxPerMm;
      const double y = (level.motion_mm[k][i].y - reference.motion_mm[k][i].y) * kPxPerMm;
      squares += x * x + y * y;
      ++markers;
    }
    price.label_flips += level.slips[k] != reference.slips[k] ? 1 : 0;
  }
  if (markers > 0) price.rms_px = std::sqrt(squares / static_cast<double>(markers));
}

}  // namespace

std::vector<LevelPrice> price_levels(const scene::Scene& asked, const TradeSimConfig& config) {
  scene::Scene scene = asked;
  scene.level.inject = scene::Inject::kFeatures;
  // The contact alone.
  scene::Effects effects;
  effects.creep_gain = asked.effects.creep_gain;
  effects.creep_tau_s = asked.effects.creep_tau_s;
  effects.drive_stiffness_n_per_mm = asked.effects.drive_stiffness_n_per_mm;
  effects.damping_n_s_per_mm = asked.effects.damping_n_s_per_mm;
  scene.effects = effects;
  scene.faults.clear();

  const bool round = scene::as_round(scene.object.shape).has_value();
  std::vector<LevelPrice> prices;
  std::vector<Run> runs;
  for (const Setting& setting : settings(config)) {
    const scene::ContactLevel contact = setting.level.contact;
    if (!round && contact == scene::ContactLevel::kSprings) continue;
    scene.level = setting.level;
    runs.push_back(run(scene, config.repeats));
    LevelPrice& price = prices.emplace_back();
    price.level = setting.name;
    price.us_p50 = median(runs.back().us);
  }
  for (std::size_t i = 0; i < prices.size(); ++i) compare(runs.back(), runs[i], prices[i]);
  for (LevelPrice& price : prices) {
    price.best = std::none_of(prices.begin(), prices.end(), [&](const LevelPrice& other) {
      return other.us_p50 < price.us_p50 && other.rms_px < price.rms_px;
    });
  }
  return prices;
}

namespace {

struct Entered {
  std::vector<PlayedFrame> frames;
  std::vector<bool> touching;
};

Entered enter(const scene::Scene& scene, EntryPrice& price) {
  const Params params;
  Rig rig(params);
  Player player(scene, rig.clock());
  App& app = rig.connect(player.camera());
  Entered out;
  if (!app.start(params).ok()) return out;
  std::vector<double> us;
  trade::MarkerError error;
  bool referenced = false;
  while (true) {
    const double start = thread_us();
    if (!player.step(app, params, false)) break;
    const double spent_us = thread_us() - start;
    const PlayedFrame frame = played(player, app);
    out.frames.push_back(frame);
    out.touching.push_back(player.snapshot().contact.normal_n > 0.0);
    referenced = referenced || frame.referenced;
    if (referenced && !frame.accepted) ++price.refused;
    if (!out.touching.back()) continue;
    us.push_back(spent_us);
    if (!player.marker_centers().empty() && frame.accepted) {
      const hal::Frame lent = player.lent();
      error.add(app.state().tracker.field, player.marker_centers(),
                luma_input::reduction(pipeline_config(params).luma, lent), lent.width);
    }
  }
  price.frames = static_cast<int>(us.size());
  price.us_p50 = median(us);
  if (error.seen > 0) price.rms_px = error.rms();
  return out;
}

}  // namespace

std::vector<EntryPrice> price_entries(const scene::Scene& scene) {
  std::vector<EntryPrice> prices;
  Entered features;
  for (std::size_t i = 0; i < scene::kInjectNames.size(); ++i) {
    EntryPrice& price = prices.emplace_back();
    price.entry = scene::kInjectNames[i];
    scene::Scene entering = scene;
    entering.level.inject = static_cast<scene::Inject>(i);
    Entered entered = enter(entering, price);
    if (i == 0) features = entered;
    double sum = 0.0;
    int both = 0;
    for (std::size_t k = 0; k < std::min(entered.frames.size(), features.frames.size()); ++k) {
      const PlayedFrame& here = entered.frames[k];
      const PlayedFrame& there = features.frames[k];
      if (!features.touching[k] || !here.accepted || !there.accepted || !here.referenced) continue;
      sum += std::abs(here.features.entropy.raw() - there.features.entropy.raw()) / 65536.0;
      ++both;
    }
    if (both > 0) price.entropy_nat = sum / both;
  }
  return prices;
}

}  // namespace holdfast::tool
