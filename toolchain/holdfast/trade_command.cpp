// SPDX-License-Identifier: Apache-2.0
// holdfast trade sim: what each level of the simulator costs and what it leaves wrong, on scenes.
#include <fmt/format.h>

#include <optional>
#include <string_view>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/progress.hpp"
#include "toolchain/trade/trade_sim.hpp"

namespace holdfast::tool {
namespace {

void print_table(const std::vector<LevelPrice>& prices) {
  std::string scene;
  for (const LevelPrice& p : prices) {
    if (p.scene != scene) {
      scene = p.scene;
      fmt::print("{}\n  {:14} {:>11} {:>11} {:>9} {:>9} {:>9} {:>6} {:>9} {:>9}  {}\n", scene, "level", "us p50",
                 "us p99", "rms px", "most px", "dE nat", "flips", "onset ms", "alarm ms", "omits");
    }
    const auto cell = [](const std::optional<double>& value) { return value ? fmt::format("{:+.0f}", *value) : "-"; };
    fmt::print("{} {:14} {:11.2f} {:11.2f} {:9.4f} {:9.4f} {:9.4f} {:6} {:>9} {:>9}  {}\n", p.best ? '*' : ' ', p.level,
               p.us_p50, p.us_p99, p.rms_px, p.most_px, p.entropy_nat, p.label_flips, cell(p.onset_shift_ms),
               cell(p.alarm_shift_ms), p.reference ? "(reference)" : p.omitted);
  }
}

void print_entries(const std::vector<EntryPrice>& prices) {
  fmt::print("\nentering the firmware with\n  {:14} {:>11} {:>11} {:>9} {:>9} {:>9} {:>9}\n", "", "us p50", "us p99",
             "rms px", "dE nat", "refused", "alarm ms");
  std::string scene;
  for (const EntryPrice& p : prices) {
    if (p.scene != scene) fmt::print("{}\n", scene = p.scene);
    fmt::print("  {:14} {:11.2f} {:11.2f} {:>9} {:9.4f} {:9} {:>9}\n", p.entry, p.us_p50, p.us_p99,
               p.rms_px ? fmt::format("{:.4f}", *p.rms_px) : "-", p.entropy_nat, p.refused,
               p.alarm_shift_ms ? fmt::format("{:+.0f}", *p.alarm_shift_ms) : "-");
  }
  fmt::print(
      "  simulator and firmware together, the scene's own contact and effects; changes are those against features\n\n");
}

}  // namespace

int trade_sim(const TradeSimOptions& options) {
  OutputFiles outputs({{"--csv", options.csv}, {"--entries", options.entries}, {"--svg", options.svg}}, options.scenes,
                      "scene");
  if (!outputs.error().empty()) return fail(outputs.error());
  std::vector<scene::Scene> scenes;
  for (const std::string& path : options.scenes) {
    std::optional<scene::Scene> scene = load_scene(path);
    if (!scene) return 1;
    scenes.push_back(*std::move(scene));
  }
  TradeSimConfig config;
  config.reference_cell_mm = options.reference_cell_mm;
  config.repeats = options.repeats;
  std::vector<LevelPrice> prices;
  std::vector<EntryPrice> entries;
  Progress progress("trade", static_cast<long>(scenes.size()));
  long done = 0;
  for (const scene::Scene& scene : scenes) {
    const std::vector<LevelPrice> some = price_levels(scene, config);
    prices.insert(prices.end(), some.begin(), some.end());
    const std::vector<EntryPrice> ways = price_entries(scene);
    entries.insert(entries.end(), ways.begin(), ways.end());
    progress.update(++done);
    if (interrupted()) return fail(interrupted_line());
  }
  progress.clear();
  print_table(prices);
  fmt::print(
      "* nothing is both faster and nearer. px of a picture 320 wide; times are thread CPU time on this machine\n");
  print_entries(entries);
  for (const scene::ContactLevel level : {scene::ContactLevel::kSprings, scene::ContactLevel::kGrid}) {
    fmt::print("{} leaves out\n", scene::kContactLevelNames[static_cast<std::size_t>(level)]);
    for (const std::string_view what : scene::omissions(level)) fmt::print("  {}\n", what);
  }
  if (std::ostream* const csv = outputs.stream("--csv")) *csv << trade_sim_csv(prices);
  if (std::ostream* const csv = outputs.stream("--entries")) *csv << trade_sim_entries_csv(entries);
  if (std::ostream* const svg = outputs.stream("--svg")) *svg << trade_sim_svg(prices);
  if (const std::string error = outputs.commit(); !error.empty()) return fail(error);
  return 0;
}

}  // namespace holdfast::tool
