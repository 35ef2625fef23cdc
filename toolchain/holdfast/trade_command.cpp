// SPDX-License-Identifier: Apache-2.0
// holdfast trade sim: what each level of the simulator costs and what it leaves wrong, on scenes.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toolchain/holdfast/commands.hpp"
#include "toolchain/support/progress.hpp"
#include "toolchain/trade/trade_sim.hpp"

namespace holdfast::tool {
namespace {

struct LevelOptions {
  std::vector<std::string> scenes;
  double reference_cell_mm = 0.35;
  int repeats = 3;
};

void print(const std::string& scene, const std::vector<LevelPrice>& levels, const std::vector<EntryPrice>& entries) {
  fmt::print("{}\n  {:14} {:>11} {:>9} {:>6}\n", scene, "contact level", "us a frame", "rms px", "flips");
  for (const LevelPrice& p : levels) {
    fmt::print("{} {:14} {:11.2f} {:9.4f} {:6}\n", p.best ? '*' : ' ', p.level, p.us_p50, p.rms_px, p.label_flips);
  }
  fmt::print("  {:14} {:>11} {:>9} {:>9} {:>9}\n", "way in", "us a frame", "rms px", "dE nat", "refused");
  for (const EntryPrice& p : entries) {
    fmt::print("  {:14} {:11.2f} {:>9} {:9.4f} {:9}\n", p.entry, p.us_p50,
               p.rms_px ? fmt::format("{:.4f}", *p.rms_px) : "-", p.entropy_nat, p.refused);
  }
}

int trade_sim(const LevelOptions& options) {
  TradeSimConfig config;
  config.reference_cell_mm = options.reference_cell_mm;
  config.repeats = options.repeats;
  Progress progress("trade", static_cast<long>(options.scenes.size()));
  long done = 0;
  for (const std::string& path : options.scenes) {
    const std::optional<scene::Scene> scene = load_scene(path);
    if (!scene) return 1;
    const std::vector<LevelPrice> levels = price_levels(*scene, config);
    const std::vector<EntryPrice> entries = price_entries(*scene);
    if (interrupted()) return fail(interrupted_line());
    progress.clear();
    print(scene->name, levels, entries);
    progress.update(++done);
  }
  progress.clear();
  fmt::print(
      "* nothing is both faster and nearer to the last, the reference. px of a picture 320 wide; times are thread CPU "
      "time on this machine. Ways in: simulator and firmware together, changes against features. What a level leaves "
      "out: tests/scenes/README.md\n");
  return 0;
}

}  // namespace

void add_trade(CLI::App& app, std::vector<Command>& commands) {
  CLI::App* const trade = app.add_subcommand("trade", "measure speed against accuracy");
  trade->require_subcommand(1);
  trade->footer("Example:\n  holdfast trade sim tests/scenes/sphere_slip.json");
  const auto options = std::make_shared<LevelOptions>();
  CLI::App* const sim = trade->add_subcommand(
      "sim", "levels of the simulator: time, and error against the finest grid; ways into the firmware");
  sim->add_option("SCENE", options->scenes, "scene files")->required()->check(not_empty);
  sim->add_option("--reference-cell", options->reference_cell_mm,
                  "cell of the finest grid, mm; time goes as its "
                  "fourth power")
      ->check(number_from_to(0.2, 1.0))
      ->capture_default_str();
  sim->add_option("--repeats", options->repeats, "of the timing")->check(CLI::Range(1, 100))->capture_default_str();
  sim->footer("Example:\n  holdfast trade sim tests/scenes/sphere_slip.json");
  commands.push_back({sim, [options] { return trade_sim(*options); }});
  add_trade_firmware(*trade, commands);
}

}  // namespace holdfast::tool
