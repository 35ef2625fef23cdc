// SPDX-License-Identifier: Apache-2.0
// holdfast grip: the slip-prevention regulator in the closed loop, on named scenes or on random pulls.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/charts.hpp"
#include "toolchain/page/assets.hpp"
#include "toolchain/play/grasp.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/escape.hpp"
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
  std::string report;
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

// --- the picture: the paper's figure, and the truth below it ---

constexpr double kLeft = 62, kWidth = 760, kRight = 16, kHead = 98;

constexpr double kLongest_s = 11.0;

double x_of(double t_s) {
  return kLeft + t_s / kLongest_s * kWidth;
}

struct Line {
  std::string name;
  std::string_view color;
  std::string_view dash;
  std::function<double(const GraspFrame&)> value;
};

// Round number at or above: 1, 2, 2.5, 3 or 5 times a power of ten.
double round_up(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(std::max(value, 1e-3))));
  for (const double lead : {1.0, 2.0, 2.5, 3.0, 5.0}) {
    if (value <= lead * power * 1.0001) return lead * power;
  }
  return 10.0 * power;
}

std::string panel(const std::vector<GraspFrame>& frames, double top, double height, std::string_view title,
                  const std::vector<Line>& lines, bool both_signs) {
  double most = 0.0;
  for (const GraspFrame& frame : frames) {
    for (const Line& line : lines) most = std::max(most, std::abs(line.value(frame)));
  }
  most = round_up(most);
  const double low = both_signs ? -most : 0.0;
  const auto y = [&](double value) { return top + height - (value - low) / (most - low) * height; };
  std::string out;
  for (int k = 0; k <= 2; ++k) {
    const double tick = low + (most - low) * k / 2.0;
    out += fmt::format(
        "<path d=\"M{:.1f} {:.1f}h{:.1f}\" stroke=\"#e4e7ea\" fill=\"none\"/>"
        "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"end\" font-size=\"11\" fill=\"#4a525b\">{:g}</text>\n",
        kLeft, y(tick), kWidth, kLeft - 6, y(tick) + 4, tick);
  }
  out +=
      fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" font-size=\"12\" font-weight=\"600\" fill=\"#1d2126\">{}</text>\n",
                  kLeft, top - 6, escape(title));
  double legend = kLeft + kWidth;
  // NOLINTNEXTLINE(modernize-loop-convert): clang 14 cannot read libstdc++ 12's std::views
  for (auto line = lines.rbegin(); line != lines.rend(); ++line) {
    std::string d;
    for (const GraspFrame& frame : frames) {
      d += fmt::format("{}{:.1f} {:.1f}", d.empty() ? 'M' : 'L', x_of(frame.t_s), y(line->value(frame)));
    }
    out += fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" stroke-dasharray=\"{}\"/>\n", d,
                       line->color, line->dash);
    if (line->name.empty()) continue;
    legend -= 34.0 + 7.0 * static_cast<double>(line->name.size());
    out += fmt::format(
        "<path d=\"M{:.1f} {:.1f}h18\" stroke=\"{}\" stroke-width=\"2\" stroke-dasharray=\"{}\"/>"
        "<text x=\"{:.1f}\" y=\"{:.1f}\" font-size=\"11\" fill=\"#4a525b\">{}</text>\n",
        legend, top - 10, line->color, line->dash, legend + 22, top - 6, escape(line->name));
  }
  return out;
}

// A row of coloured stretches: what `pick` says, by its colour; empty: nothing.
std::string band(const std::vector<GraspFrame>& frames, double top, std::string_view name,
                 const std::function<std::string_view(const GraspFrame&)>& pick) {
  std::string out =
      fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"end\" font-size=\"11\" fill=\"#4a525b\">{}</text>\n",
                  kLeft - 6, top + 11, name);
  for (std::size_t i = 0; i < frames.size();) {
    std::size_t end = i + 1;
    while (end < frames.size() && pick(frames[end]) == pick(frames[i])) ++end;
    const double until_s = end < frames.size() ? frames[end].t_s : frames.back().t_s;
    if (!pick(frames[i]).empty()) {
      out += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"14\" fill=\"{}\"/>\n",
                         x_of(frames[i].t_s), top, x_of(until_s) - x_of(frames[i].t_s), pick(frames[i]));
    }
    i = end;
  }
  return out;
}

std::string_view state_color(const GraspFrame& frame) {
  switch (frame.state) {
    case DeviceState::kOk:
      return "#009e73";
    case DeviceState::kSlip:
      return "#d55e00";
    case DeviceState::kReference:
      return "#56b4e9";
    case DeviceState::kDegraded:
      return "#e69f00";
    case DeviceState::kFault:
      return "#882255";
    case DeviceState::kBoot:
      break;
  }
  return "#9aa0a6";
}

std::string_view phase_color(const GraspFrame& frame) {
  constexpr std::array<std::string_view, 6> kColors{"", "#56b4e9", "#d55e00", "#e69f00", "#009e73", "#cc79a7"};
  return kColors[static_cast<std::size_t>(frame.phase)];
}

std::string chart(const Played& played) {
  const std::vector<GraspFrame>& frames = played.grasp.frames;
  const std::string title = fmt::format("{}, {} prevention: {}", played.pull.name, name_of(played.prevention),
                                        played.finished() ? "the task ends" : "the book is lost");
  std::string body = fmt::format(
      "<text x=\"12\" y=\"22\" font-size=\"14\" font-weight=\"600\" fill=\"#1d2126\">{}</text>\n"
      "<text x=\"12\" y=\"40\" font-size=\"11\" fill=\"#4a525b\">{}</text>\n"
      "<text x=\"12\" y=\"56\" font-size=\"11\" fill=\"#4a525b\">State: blue reference, green OK, vermilion SLIP. "
      "Truth: more than half of the contact slips.</text>\n"
      "<text x=\"12\" y=\"70\" font-size=\"11\" fill=\"#4a525b\">Grip: blue gripping, vermilion tightening, yellow "
      "settling, green holding, purple releasing</text>\n",
      escape(title), escape(played.pull.help));
  double top = kHead;
  body += band(frames, top, "state", state_color);
  body += band(frames, top + 18, "truth",
               [](const GraspFrame& f) { return f.share > scene::kHalfSlip ? std::string_view("#d55e00") : ""; });
  body += band(frames, top + 36, "grip", phase_color);
  top += 78;
  const auto add = [&](double height, std::string_view name, const std::vector<Line>& lines, bool both_signs = false) {
    body += panel(frames, top, height, name, lines, both_signs);
    top += height + 34;
  };
  const double least_n = played.least.all_n;
  const double before_n = played.least.pull_n;
  add(110, "Force, N",
      {{"commanded", "#0072b2", "none", [](const GraspFrame& f) { return f.commanded_n; }},
       {"on the gel", "#d55e00", "none", [](const GraspFrame& f) { return f.force_n; }},
       {"least that holds", "#1d2126", "4 3",
        [=, event_s = played.pull.event_s](const GraspFrame& f) { return f.t_s < event_s ? before_n : least_n; }}});
  add(50, "Commanded position, counts",
      {{"", "#0072b2", "none", [](const GraspFrame& f) { return static_cast<double>(f.position_counts); }}});
  add(90, "E, nat", {{"", "#0072b2", "none", [](const GraspFrame& f) { return f.entropy_nat; }}});
  add(90, "dE/dt, nat/s", {{"", "#0072b2", "none", [](const GraspFrame& f) { return f.entropy_rate_nat_s; }}}, true);
  add(70, "Truth: load along the gel, N", {{"", "#cc79a7", "none", [](const GraspFrame& f) { return f.load_n; }}});
  add(70, "Truth: the book has slid on the gel, mm",
      {{"", "#cc79a7", "none", [](const GraspFrame& f) { return std::min(f.slid_mm, 2.0 * kLost_mm); }}});
  const double bottom = top - 28;
  const auto mark = [&](double t_s, std::string_view name) {
    body += fmt::format(
        "<path d=\"M{0:.1f} {1:.1f}V{2:.1f}\" stroke=\"#4a525b\" stroke-dasharray=\"2 3\" fill=\"none\"/>"
        "<text x=\"{3:.1f}\" y=\"{4:.1f}\" font-size=\"11\" fill=\"#4a525b\">{5}</text>\n",
        x_of(t_s), kHead - 2, bottom, x_of(t_s) + 3, kHead - 6, name);
  };
  mark(kGripAt, "grip");
  mark(kPullAt, "pull");
  if (least_n != before_n || played.pull.bump_mm > 0.0) mark(played.pull.event_s, "event");
  mark(kReleaseAt, "release");
  for (int t = 0; t <= static_cast<int>(kLongest_s); ++t) {
    body += fmt::format(
        "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\" font-size=\"11\" fill=\"#4a525b\">{} s</text>\n",
        x_of(t), bottom + 14, t);
  }
  const double height = bottom + 24;
  const double width = kLeft + kWidth + kRight;
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "role=\"img\" aria-label=\"{2}\" font-family=\"system-ui,sans-serif\">\n"
      "<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#ffffff\"/>\n{3}</svg>\n",
      width, height, escape(title), body);
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

std::string html_of(const std::vector<Played>& all, const std::vector<std::string>& charts) {
  std::string table;
  for (const Played& played : all) table += escape(row(played)) + "\n";
  std::string pictures;
  for (const std::string& picture : charts) pictures += "<figure>" + picture + "</figure>\n";
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>"
      "<meta name=\"viewport\" content=\"width=device-width\"/><title>holdfast grip</title><style>{}"
      "pre{{font-size:12px;overflow-x:auto}}figure{{margin:24px 0;padding:12px;background:#fff;overflow-x:auto}}figure "
      "text{{fill:#4a5058}}"
      "figure svg{{min-width:640px;max-width:100%;height:auto}}"
      "@media print{{figure svg{{min-width:0}}figure{{break-inside:avoid}}}}</style></head><body><main>\n"
      "<h1>Slip prevention in the closed loop</h1>\n<p>{}. Bound: the larger of 1.3 times the least force that holds "
      "and two steps above the start. Forces are of one finger.</p>\n<pre "
      "tabindex=\"0\">{}\n{}</pre>\n{}</main></body></html>\n",
      page::style_text(), summary_of(all), escape(head()), table, pictures);
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
  if (!options.csv.empty() && !options.report.empty() && same_place(options.csv, options.report)) {
    return fail(
        fmt::format("{}: given for both --csv and --report. Likely cause: a typing error. Next: give each output "
                    "a file of its own",
                    options.csv));
  }
  for (const std::string* path : {&options.csv, &options.report}) {
    if (path->empty()) continue;
    if (const AtomicFile probe(*path); !probe.error().empty()) return fail(probe.error());
  }
  std::vector<Played> all;
  if (const std::string error = run(options, all); !error.empty()) return fail(error);

  std::vector<std::pair<std::filesystem::path, std::string>> outputs;
  const bool frames = options.seeds == 0;
  if (!options.csv.empty()) outputs.emplace_back(options.csv, csv_of(all, frames));
  if (!options.report.empty()) {
    // Of random pulls those that went wrong, a few of them.
    constexpr std::size_t kMostPictures = 12;
    std::vector<std::string> charts;
    for (const Played& played : all) {
      const bool shown = frames || !played.finished() || !played.gentle();
      if (shown && charts.size() < kMostPictures) charts.push_back(chart(played));
    }
    const bool svg = std::filesystem::path(options.report).extension() == ".svg";
    outputs.emplace_back(options.report, svg ? learn::charts::stacked(charts) : html_of(all, charts));
  }
  if (const std::string error = write_all("", outputs); !error.empty()) return fail(error);
  if (options.json) {
    fmt::print("{}\n", json_of(all).dump());
    return 0;
  }
  fmt::print("{}\n", head());
  for (const Played& played : all) fmt::print("{}\n", row(played));
  if (!options.without) fmt::print("{}\n", summary_of(all));
  for (const auto& [path, bytes] : outputs) fmt::print("written   {}\n", path.string());
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
  command->add_option("--report", options->report, "write table and plots: HTML, or plots alone: .svg")
      ->check(not_empty);
  command->add_flag("--json", options->json, "print the figures as JSON");
  command->footer("Example:\n  holdfast grip --report grip.html\n  holdfast grip --seeds 200");
  commands.push_back({command, [options] { return grip(*options); }});
}

}  // namespace holdfast::tool
