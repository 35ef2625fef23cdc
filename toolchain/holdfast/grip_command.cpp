// SPDX-License-Identifier: Apache-2.0
// holdfast grip: the slip-prevention regulator in the closed loop, on named scenes or on random pulls.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/holdfast/commands.hpp"
#include "toolchain/play/grasp.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

struct GripOptions {
  int seeds = 0;
  std::uint64_t first_seed = 1001;
  std::string inject = "grey";
  bool without = false;
  bool json = false;
  std::string csv;
};

struct Played {
  Pull pull;
  Prevention prevention = Prevention::kOn;
  LeastForce least;
  Grasp grasp;
  double allowed_n = 0.0;

  [[nodiscard]] bool finished() const { return !grasp.lost; }
  [[nodiscard]] bool gentle() const { return grasp.final_n <= allowed_n; }
};

Played play(const Pull& pull, const LeastForce& least, Prevention prevention) {
  const regulator::Config config;
  LagGripper gripper;
  Played played{pull, prevention, least, play_pull(pull, least.pull_n, Params{}, config, prevention, gripper), 0.0};
  played.allowed_n = most_allowed_n(least, played.grasp, config);
  return played;
}

constexpr std::array<std::string_view, 6> kPhaseNames{"idle",     "gripping", "tightening",
                                                      "settling", "holding",  "releasing"};
std::string_view name_of(regulator::Phase phase) {
  return kPhaseNames[static_cast<std::size_t>(phase)];
}
std::string_view name_of(Prevention prevention) {
  return prevention == Prevention::kOn ? "with" : "without";
}

// --- tables ---

std::string row(const Played& played) {
  const Grasp& grasp = played.grasp;
  return fmt::format("{:16} {:>6} {:8} {:>8} {:8.2f} {:8.2f} {:8.2f} {:8.2f} {:6.2f} {:6} {:8.2f}  {}",
                     played.pull.name, played.pull.seed, name_of(played.prevention),
                     played.finished() ? "ends" : "lost", played.least.all_n, grasp.start_n, grasp.final_n,
                     played.allowed_n, grasp.final_n / played.least.all_n, grasp.steps, grasp.slid_mm,
                     !played.gentle()                                             ? "above the bound"
                     : played.finished() || played.prevention == Prevention::kOff ? ""
                                                                                  : "not prevented");
}

std::string head() {
  return fmt::format("{:16} {:>6} {:8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>6} {:>6} {:>8}", "scene", "seed", "preven.",
                     "task", "least N", "start N", "final N", "bound N", "ratio", "steps", "slid mm");
}

struct Tally {
  std::size_t pulls = 0, finished = 0, gentle = 0, both = 0;
};
Tally tally_of(const std::vector<Played>& all) {
  Tally tally;
  for (const Played& played : all) {
    if (played.prevention == Prevention::kOff) continue;
    ++tally.pulls;
    tally.finished += played.finished() ? 1U : 0U;
    tally.gentle += played.gentle() ? 1U : 0U;
    tally.both += played.finished() && played.gentle() ? 1U : 0U;
  }
  return tally;
}

double share(std::size_t part, std::size_t whole) {
  return whole > 0 ? 100.0 * static_cast<double>(part) / static_cast<double>(whole) : 0.0;
}

nlohmann::ordered_json json_of(const std::vector<Played>& all) {
  auto rows = nlohmann::ordered_json::array();
  for (const Played& played : all) {
    const Grasp& grasp = played.grasp;
    nlohmann::ordered_json one = {{"scene", played.pull.name},
                                  {"seed", played.pull.seed},
                                  {"prevention", played.prevention == Prevention::kOn},
                                  {"finished", played.finished()},
                                  {"within_bound", played.gentle()},
                                  {"least_n", played.least.all_n},
                                  {"start_n", grasp.start_n},
                                  {"final_n", grasp.final_n},
                                  {"bound_n", played.allowed_n},
                                  {"steps", grasp.steps},
                                  {"slid_mm", grasp.slid_mm}};
    if (grasp.first_slip_s && grasp.first_alarm_s) one["delay_s"] = *grasp.first_alarm_s - *grasp.first_slip_s;
    rows.push_back(std::move(one));
  }
  const Tally tally = tally_of(all);
  return {{"pulls", tally.pulls},
          {"finished", tally.finished},
          {"within_bound", tally.gentle},
          {"finished_within_bound", tally.both},
          {"grasps", rows}};
}

// One row per frame of each scene, or per random pull.
std::string csv_of(const std::vector<Played>& all, bool frames) {
  std::string out = frames ? "scene,prevention,t_s,state,slip,phase,force_counts,position_counts,steps,commanded_n,"
                             "force_n,entropy_nat,entropy_rate_nat_s,truth_load_n,truth_slid_mm,truth_slip_share\n"
                           : "seed,prevention,finished,within_bound,least_n,start_n,final_n,bound_n,steps,slid_mm,"
                             "friction,kinetic_share,mass_kg,shelf_n,speed_mm_s,modulus_mpa\n";
  for (const Played& played : all) {
    const Grasp& grasp = played.grasp;
    if (!frames) {
      const Pull& pull = played.pull;
      out += fmt::format(
          "{},{},{:d},{:d},{:.3f},{:.3f},{:.3f},{:.3f},{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.2f},{:.4f}\n",
          pull.seed, name_of(played.prevention), played.finished(), played.gentle(), played.least.all_n, grasp.start_n,
          grasp.final_n, played.allowed_n, grasp.steps, grasp.slid_mm, pull.friction, pull.kinetic_share, pull.mass_kg,
          pull.shelf_n, pull.speed_mm_s, pull.gel.shear_modulus_mpa);
      continue;
    }
    for (const GraspFrame& f : grasp.frames) {
      out += fmt::format("{},{},{:.2f},{},{:d},{},{},{},{},{:.3f},{:.3f},{:.4f},{:.3f},{:.3f},{:.3f},{:.3f}\n",
                         played.pull.name, name_of(played.prevention), f.t_s, holdfast::info(f.state).name, f.slip,
                         name_of(f.phase), f.force_counts, f.position_counts, f.steps, f.commanded_n, f.force_n,
                         f.entropy_nat, f.entropy_rate_nat_s, f.load_n, f.slid_mm, f.share);
    }
  }
  return out;
}

std::string summary_of(const std::vector<Played>& all) {
  const Tally tally = tally_of(all);
  return fmt::format(
      "finished with prevention {} of {} ({:.1f} %), force within the bound {} ({:.1f} %), both {} ({:.1f} %)",
      tally.finished, tally.pulls, share(tally.finished, tally.pulls), tally.gentle, share(tally.gentle, tally.pulls),
      tally.both, share(tally.both, tally.pulls));
}

// --- the command ---

// Empty, or one line that says what is wrong.
std::string run(const GripOptions& options, std::vector<Played>& all) {
  std::vector<Pull> pulls;
  for (int i = 0; i < options.seeds; ++i) {
    pulls.push_back(random_pull(options.first_seed + static_cast<std::uint64_t>(i)));
    pulls.back().inject = options.inject == "grey" ? scene::Inject::kGrey : scene::Inject::kMarkers;
  }
  if (options.seeds == 0) {
    pulls = named_pulls();
    for (Pull& pull : pulls) pull.inject = options.inject == "grey" ? scene::Inject::kGrey : scene::Inject::kMarkers;
  }
  Progress progress("grip", static_cast<long>(pulls.size()));
  long done = 0;
  for (const Pull& pull : pulls) {
    const LeastForce least = least_forces(pull);
    if (options.seeds == 0 || options.without) all.push_back(play(pull, least, Prevention::kOff));
    if (!options.without) all.push_back(play(pull, least, Prevention::kOn));
    progress.update(++done);
    if (interrupted()) return interrupted_line();
  }
  return {};
}

int grip(const GripOptions& options) {
  OutputFiles outputs({{"--csv", options.csv}});
  if (!outputs.error().empty()) return fail(outputs.error());
  std::vector<Played> all;
  if (const std::string error = run(options, all); !error.empty()) return fail(error);

  if (std::ostream* const csv = outputs.stream("--csv")) *csv << csv_of(all, options.seeds == 0);
  if (const std::string error = outputs.commit(); !error.empty()) return fail(error);
  if (options.json) {
    fmt::print("{}\n", text_of_json(json_of(all)));
    return 0;
  }
  fmt::print("{}\n", head());
  for (const Played& played : all) fmt::print("{}\n", row(played));
  if (!options.without) fmt::print("{}\n", summary_of(all));
  if (!options.csv.empty()) fmt::print("written   {}\n", options.csv);
  return 0;
}

}  // namespace

void add_grip(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<GripOptions>();
  CLI::App* command = app.add_subcommand("grip", "pull a book out of a shelf, with and without slip prevention");
  command->add_option("--seeds", options->seeds, "so many random pulls instead of the named scenes")
      ->check(CLI::Range(1, 10'000));
  command->add_option("--first-seed", options->first_seed, "of the random pulls; 1 to 60 were used for tuning")
      ->capture_default_str();
  command->add_option("--inject", options->inject, "enter the firmware with grey pictures, or with markers alone")
      ->check(CLI::IsMember({"grey", "markers"}))
      ->capture_default_str();
  command->add_flag("--without", options->without, "without prevention only");
  command->add_option("--csv", options->csv, "write frames of the scenes, or one row per random pull: CSV")
      ->check(not_empty);
  command->add_flag("--json", options->json, "print the figures as JSON");
  command->footer("Example:\n  holdfast grip --csv grip.csv\n  holdfast grip --seeds 200");
  commands.push_back({command, [options] { return grip(*options); }});
}

}  // namespace holdfast::tool
