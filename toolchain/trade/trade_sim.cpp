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

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

struct Run {
  std::vector<std::vector<scene::Vec2>> motion_mm;
  std::vector<bool> touching;
  std::vector<PlayedFrame> frames;
};

Run run(const scene::Scene& scene) {
  // The truth and what the firmware makes of it come from the same frames.
  Run out;
  scene::Simulation simulation(scene);
  for (int k = 0; k < scene::frame_count(scene); ++k) {
    const scene::Snapshot& snapshot = simulation.next();
    out.motion_mm.push_back(snapshot.motion_mm);
    out.touching.push_back(snapshot.contact.normal_n > 0.0);
  }
  out.frames = play(scene, Params{});
  return out;
}

void time_frames(const scene::Scene& scene, int repeats, LevelPrice& price) {
  std::vector<double> us;
  for (int r = 0; r < repeats; ++r) {
    scene::Simulation simulation(scene);
    for (int k = 0; k < scene::frame_count(scene); ++k) {
      const double start = thread_us();
      const scene::Snapshot& snapshot = simulation.next();
      const double end = thread_us();
      if (snapshot.contact.normal_n > 0.0) us.push_back(end - start);
    }
  }
  price.us_p50 = percentile(us, 0.5);
  price.us_p99 = percentile(us, 0.99);
}

std::optional<double> first_alarm_s(const std::vector<PlayedFrame>& frames) {
  const auto first = std::find_if(frames.begin(), frames.end(), [](const PlayedFrame& f) { return f.slip; });
  return first == frames.end() ? std::nullopt : std::optional(first->t_s);
}

std::optional<double> shift_ms(std::optional<double> reference_s, std::optional<double> s) {
  if (!reference_s || !s) return std::nullopt;
  return (*s - *reference_s) * 1e3;
}

void compare(const Run& reference, const Run& level, LevelPrice& price) {
  double squares = 0.0;
  double entropy = 0.0;
  long markers = 0;
  const std::size_t frames = std::min(reference.frames.size(), level.frames.size());
  for (std::size_t k = 0; k < frames; ++k) {
    if (!reference.touching[k] && !level.touching[k]) continue;
    ++price.frames;
    for (std::size_t i = 0; i < reference.motion_mm[k].size(); ++i) {
      const double x = (level.motion_mm[k][i].x - reference.motion_mm[k][i].x) * kPxPerMm;
      const double y = (level.motion_mm[k][i].y - reference.motion_mm[k][i].y) * kPxPerMm;
      squares += x * x + y * y;
      price.most_px = std::max(price.most_px, std::sqrt(x * x + y * y));
      ++markers;
    }
    const double e = level.frames[k].features.entropy.raw() - reference.frames[k].features.entropy.raw();
    entropy += std::abs(e) / 65536.0;
    const bool slips = level.frames[k].level >= scene::SlipLevel::kHalf;
    price.label_flips += slips != (reference.frames[k].level >= scene::SlipLevel::kHalf) ? 1 : 0;
  }
  if (markers > 0) price.rms_px = std::sqrt(squares / static_cast<double>(markers));
  if (price.frames > 0) price.entropy_nat = entropy / price.frames;
  price.onset_shift_ms =
      shift_ms(onset_s(reference.frames, scene::SlipLevel::kHalf), onset_s(level.frames, scene::SlipLevel::kHalf));
  price.alarm_shift_ms = shift_ms(first_alarm_s(reference.frames), first_alarm_s(level.frames));
}

std::string omitted(const scene::Scene& scene, scene::ContactLevel contact) {
  std::string names;
  const std::vector<std::string_view> used = scene::used_capabilities(scene);
  for (const scene::Capability& capability : scene::kCapabilities) {
    if (std::find(used.begin(), used.end(), capability.name) == used.end()) continue;
    if (can(contact, capability)) continue;
    names += fmt::format("{}{}", names.empty() ? "" : " ", capability.name);
  }
  return names;
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
    LevelPrice price;
    price.scene = scene.name;
    price.level = setting.name;
    // What the scene uses at the level that can do most.
    scene.level.contact = scene::ContactLevel::kGrid;
    price.omitted = omitted(scene, contact);
    scene.level.contact = contact;
    time_frames(scene, config.repeats, price);
    runs.push_back(run(scene));
    prices.push_back(price);
  }
  prices.back().reference = true;
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
  price.us_p50 = percentile(us, 0.5);
  price.us_p99 = percentile(us, 0.99);
  if (error.seen > 0) price.rms_px = error.rms();
  return out;
}

}  // namespace

std::vector<EntryPrice> price_entries(const scene::Scene& scene) {
  std::vector<EntryPrice> prices;
  Entered features;
  for (std::size_t i = 0; i < scene::kInjectNames.size(); ++i) {
    EntryPrice& price = prices.emplace_back();
    price.scene = scene.name;
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
    price.alarm_shift_ms = shift_ms(first_alarm_s(features.frames), first_alarm_s(entered.frames));
  }
  return prices;
}

std::string trade_sim_entries_csv(const std::vector<EntryPrice>& prices) {
  std::string out = "scene,entry,us_p50,us_p99,marker_rms_px,entropy_change_nat,refused,frames,alarm_shift_ms\n";
  for (const EntryPrice& p : prices) {
    out += fmt::format("{},{},{:.2f},{:.2f},{},{:.4f},{},{},{}\n", p.scene, p.entry, p.us_p50, p.us_p99,
                       p.rms_px ? fmt::format("{:.4f}", *p.rms_px) : "", p.entropy_nat, p.refused, p.frames,
                       p.alarm_shift_ms ? fmt::format("{:.0f}", *p.alarm_shift_ms) : "");
  }
  return out;
}

std::string trade_sim_csv(const std::vector<LevelPrice>& prices) {
  std::string out =
      "scene,level,us_p50,us_p99,marker_rms_px,marker_most_px,entropy_change_nat,label_flips,frames,onset_shift_ms,"
      "alarm_shift_ms,pareto,reference,omitted\n";
  const auto cell = [](const std::optional<double>& value) { return value ? fmt::format("{:.0f}", *value) : ""; };
  for (const LevelPrice& p : prices) {
    out += fmt::format("{},{},{:.2f},{:.2f},{:.4f},{:.4f},{:.4f},{},{},{},{},{},{},{}\n", p.scene, p.level, p.us_p50,
                       p.us_p99, p.rms_px, p.most_px, p.entropy_nat, p.label_flips, p.frames, cell(p.onset_shift_ms),
                       cell(p.alarm_shift_ms), p.best ? 1 : 0, p.reference ? 1 : 0, p.omitted);
  }
  return out;
}

namespace {

// --- picture ---

constexpr double kPanelWidth = 380.0;
constexpr double kPanelHeight = 300.0;
constexpr double kLeft = 54.0;
constexpr double kRight = 26.0;
constexpr double kTop = 34.0;
constexpr double kBottom = 62.0;
constexpr int kColumns = 3;

// Decades shown: 1 us to 100 ms, and 0.001 to 100 px. What lies outside is drawn on the edge.
constexpr double kLeastUs = 1.0, kMostUs = 1e5, kLeastPx = 1e-3, kMostPx = 1e2;

struct LevelStyle {
  std::string_view prefix;
  std::string_view color;
};
constexpr std::array<LevelStyle, 2> kStyles{{
    {"springs", "#2166ac"},
    {"grid", "#b2182b"},
}};

std::string_view color_of(std::string_view level) {
  for (const LevelStyle& style : kStyles) {
    if (level.starts_with(style.prefix)) return style.color;
  }
  return "#000000";
}

double along(double value, double least, double most, double length) {
  const double share = std::log(std::clamp(value, least, most) / least) / std::log(most / least);
  return share * length;
}

std::string text(double x, double y, std::string_view anchor, std::string_view what, double size = 10.0,
                 std::string_view color = "#222222") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"{:.0f}\" fill=\"{}\">{}</text>\n",
                     x, y, anchor, size, color, what);
}

std::string panel(double left, double top, const std::string& name, const std::vector<const LevelPrice*>& prices) {
  const double width = kPanelWidth - kLeft - kRight;
  const double height = kPanelHeight - kTop - kBottom;
  const double x0 = left + kLeft;
  const double y0 = top + kTop + height;
  std::string out = text(x0, top + 18.0, "start", name, 13.0);
  out += fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"none\" stroke=\"#999999\"/>\n", x0,
      top + kTop, width, height);
  for (double us = kLeastUs; us <= kMostUs * 1.01; us *= 10.0) {
    const double x = x0 + along(us, kLeastUs, kMostUs, width);
    out += fmt::format("<path d=\"M{:.1f} {:.1f}v{:.1f}\" stroke=\"#eeeeee\"/>\n", x, y0, -height);
    const std::string label = us < 1e3   ? fmt::format("{:.0f} us", us)
                              : us < 1e6 ? fmt::format("{:.0f} ms", us / 1e3)
                                         : "1 s";
    out += text(x, y0 + 13.0, "middle", label);
  }
  for (double px = kLeastPx; px <= kMostPx * 1.01; px *= 10.0) {
    const double y = y0 - along(px, kLeastPx, kMostPx, height);
    out += fmt::format("<path d=\"M{:.1f} {:.1f}h{:.1f}\" stroke=\"#eeeeee\"/>\n", x0, y, width);
    out += text(x0 - 5.0, y + 3.0, "end", fmt::format("{:g}", px));
  }
  std::vector<std::pair<double, double>> front;
  std::map<std::string, std::string> omissions;  // by kind of level
  for (const LevelPrice* p : prices) {
    const std::string kind = p->level.substr(0, p->level.find(' '));
    if (!p->omitted.empty()) omissions[kind] = p->omitted;
    if (p->reference) continue;
    const double x = x0 + along(p->us_p50, kLeastUs, kMostUs, width);
    const double y = y0 - along(p->rms_px, kLeastPx, kMostPx, height);
    out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4\" fill=\"{}\" stroke=\"{}\"/>\n", x, y,
                       p->omitted.empty() ? color_of(p->level) : "#ffffff", color_of(p->level));
    // Springs lie close together: the first and the last stand for all.
    const std::string number = p->level.size() == kind.size() ? p->level : p->level.substr(kind.size() + 1);
    const bool below = kind == "grid";
    if (kind != "springs" || number == "8" || number == "256") {
      out += text(below ? x - 4.0 : x + 4.0, below ? y + 13.0 : y - 6.0, below ? "end" : "start", number, 8.0,
                  color_of(p->level));
    }
    if (p->best) front.emplace_back(x, y);
  }
  std::sort(front.begin(), front.end());
  std::string path;
  for (const auto& point : front) {
    path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", point.first, point.second);
  }
  if (!path.empty()) {
    out += fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"#222222\" stroke-dasharray=\"3 3\"/>\n", path);
  }
  double line = y0 + 27.0;
  for (const auto& [kind, what] : omissions) {
    out += text(x0, line, "start", fmt::format("{} omits {}", kind, what), 8.0, color_of(kind));
    line += 10.0;
  }
  return out;
}

}  // namespace

std::string trade_sim_svg(const std::vector<LevelPrice>& prices) {
  std::vector<std::string> names;
  std::map<std::string, std::vector<const LevelPrice*>> by_scene;
  for (const LevelPrice& p : prices) {
    if (by_scene[p.scene].empty()) names.push_back(p.scene);
    by_scene[p.scene].push_back(&p);
  }
  const int columns = std::min<int>(kColumns, std::max<int>(1, static_cast<int>(names.size())));
  const int rows = (static_cast<int>(names.size()) + columns - 1) / columns;
  const double width = columns * kPanelWidth;
  const double height = rows * kPanelHeight + 56.0;
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "font-family=\"sans-serif\">\n<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#ffffff\"/>\n",
      width, height);
  out +=
      text(12.0, 20.0, "start", "Contact levels: time of a frame (median) against marker error (RMS, px of 320)", 14.0);
  double x = 12.0;
  for (const LevelStyle& style : kStyles) {
    out += fmt::format("<circle cx=\"{:.1f}\" cy=\"38\" r=\"4\" fill=\"{}\"/>\n", x + 4.0, style.color);
    out += text(x + 12.0, 42.0, "start", style.prefix, 11.0, style.color);
    x += 84.0;
  }
  out +=
      text(x, 42.0, "start", "hollow: omits something the scene has; dashed: nothing is both faster and nearer", 11.0);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::size_t row = i / static_cast<std::size_t>(columns);
    const double left = static_cast<double>(i % static_cast<std::size_t>(columns)) * kPanelWidth;
    const double top = 56.0 + static_cast<double>(row) * kPanelHeight;
    out += panel(left, top, names[i], by_scene[names[i]]);
  }
  return out + "</svg>\n";
}

}  // namespace holdfast::tool
