// SPDX-License-Identifier: Apache-2.0
// holdfast sim: a simulated grasp through the whole firmware, checked against its own truth and the scene's promises.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/support/progress.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::tool {

// A scene that is valid at the level it will be played at; prints what is wrong.
std::optional<scene::Scene> load_scene(const std::string& path) {
  const scene::SceneResult read = scene::read_scene_file(path);
  for (const std::string& line : read.errors) (void)fail(line);
  for (const std::string& line : read.warnings) note(line);
  return read.scene;
}

namespace {

struct SimOptions {
  CommonOptions common;
  std::string scene;
  std::string inject;   // instead of the scene's; empty = the scene's
  std::string contact;  // likewise
};

constexpr const char* kTruthHeader =
    "frame,t_s,normal_n,shear_x_n,shear_y_n,moment_nmm,depth_mm,contact_radius_mm,stick_radius_mm,slip_fraction,gross,"
    "slid_x_mm,slid_y_mm,slid_deg,slide_mm_s,slide_deg_s,object_x_mm,object_y_mm,slip_level";

std::string truth_line(const scene::Snapshot& s) {
  const scene::ContactState& c = s.contact;
  return fmt::format(
      "{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{},{:.6f},{:.6f},{:.6f},{:.6f},"
      "{:.6f},{:.6f},{:.6f},{}",
      s.frame, s.t_s, c.normal_n, c.shear_n.x, c.shear_n.y, c.moment_nmm, c.depth_mm, c.contact_radius_mm,
      c.stick_radius_mm, c.slip_fraction, c.gross ? 1 : 0, c.slid_mm.x, c.slid_mm.y, c.slid_rad * 57.29577951308232,
      s.slide_mm_s, s.slide_deg_s, s.object_mm.x, s.object_mm.y, static_cast<int>(s.level));
}

constexpr const char* kTruthMarkersHeader = "frame,row,col,printed,x_px,y_px,rest_x_mm,rest_y_mm,dx_mm,dy_mm";

// Where the markers really are: in pixels of the picture, and on the gel.
std::string truth_marker_lines(const Player& player, int cols) {
  const scene::Snapshot& s = player.snapshot();
  const std::span<const scene::Vec2> rest = player.markers();
  std::string lines;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    const scene::Vec2 u = s.motion_mm[i];
    const scene::PointPx at = scene::to_px(player.picture(), {rest[i].x + u.x, rest[i].y + u.y});
    lines += fmt::format("{},{},{},{},{:.4f},{:.4f},{:.6f},{:.6f},{:.6f},{:.6f}\n", s.frame,
                         i / static_cast<std::size_t>(cols), i % static_cast<std::size_t>(cols),
                         player.dots()[i].printed ? 1 : 0, at.x, at.y, rest[i].x, rest[i].y, u.x, u.y);
  }
  return lines;
}

template <std::size_t N>
std::optional<std::size_t> index_of(const std::array<std::string_view, N>& names, std::string_view name) {
  const auto* found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

// What the command line says instead of the scene. Empty, or an error line.
std::string override_level(const SimOptions& options, scene::Scene& scene) {
  if (!options.inject.empty()) {
    const auto inject = index_of(scene::kInjectNames, options.inject);
    if (!inject) {
      return fmt::format("--inject '{}': no such place. Likely cause: a typing error. Next: give one of {}",
                         options.inject, scene::file::joined(scene::kInjectNames));
    }
    scene.level.inject = static_cast<scene::Inject>(*inject);
  }
  if (!options.contact.empty()) {
    const auto contact = index_of(scene::kContactLevelNames, options.contact);
    if (!contact) {
      return fmt::format("--contact '{}': no such level. Likely cause: a typing error. Next: give one of {}",
                         options.contact, scene::file::joined(scene::kContactLevelNames));
    }
    scene.level.contact = static_cast<scene::ContactLevel>(*contact);
  }
  return {};
}

// What was played and should not be taken for more than it is. `last_s`: the last frame that came.
std::vector<std::string> doubts_of(const scene::Scene& scene, double deepest_mm, double last_s) {
  std::vector<std::string> doubts;
  if (deepest_mm > 0.5 * scene.gel.thickness_mm) {
    doubts.push_back(
        fmt::format("the object was {:.2f} mm deep in a gel of {:g} mm, where small strains no longer hold. Likely "
                    "cause: more force than this object can press with, or a contact that left the gel. Next: see "
                    "depth_mm in --truth",
                    deepest_mm, scene.gel.thickness_mm));
  }
  if (last_s < scene.duration_s - 3.0 / scene.fps) {
    doubts.push_back(
        fmt::format("the last frame came at {:.2f} s of {:g} s, and what is expected was looked at up to there. Likely "
                    "cause: a fault of the camera that lasts to the end. Next: see 'faults'",
                    last_s, scene.duration_s));
  }
  return doubts;
}

int sim_grasp(const SimOptions& options) {
  std::optional<scene::Scene> loaded = load_scene(options.scene);
  if (!loaded) return 1;
  scene::Scene scene = *std::move(loaded);
  if (const std::string error = override_level(options, scene); !error.empty()) return fail(error);
  if (!options.inject.empty() || !options.contact.empty()) {
    // The level that was asked for may lack what the scene requires.
    const scene::SceneResult again = scene::read_scene(scene::write_scene(scene), options.scene + " at this level");
    for (const std::string& line : again.errors) (void)fail(line);
    if (!again.scene) return 1;
  }

  SessionInfo info{};
  info.inputs = {options.scene, options.common.model, options.common.settings};
  CommonOptions common = options.common;
  if (common.grid.empty()) common.grid = fmt::format("{}x{}", scene.markers.cols, scene.markers.rows);
  std::unique_ptr<model::Tree> tree;
  if (const std::string error = settle(common, info.params, info.auto_grid, tree, info.model_text); !error.empty()) {
    return fail(error);
  }

  const bool pictures = scene.level.inject == scene::Inject::kGrey || scene.level.inject == scene::Inject::kJpeg;
  if (!common.paths.overlay.empty() && !pictures) {
    return fail(
        fmt::format("--overlay: the scene enters at {}, where there is no picture. Likely cause: a cheap level "
                    "for speed. Next: add --inject grey or --inject jpeg",
                    scene::kInjectNames[static_cast<std::size_t>(scene.level.inject)]));
  }
  const scene::PictureConfig picture = sim::picture_of(scene);
  const std::string_view inject = scene::kInjectNames[static_cast<std::size_t>(scene.level.inject)];
  const std::string_view contact = scene::kContactLevelNames[static_cast<std::size_t>(scene.level.contact)];
  info.title = fmt::format("Simulated grasp: {}", scene.name);
  info.input_text =
      pictures ? fmt::format("{} ({}x{} {}, {:.4g} fps, contact level {})", options.scene, picture.width,
                             picture.height, inject, scene.fps, contact)
               : fmt::format("{} ({}, {:.4g} fps, contact level {})", options.scene, inject, scene.fps, contact);
  info.reference_text = scene.level.inject == scene::Inject::kFeatures
                            ? "the true rest position"
                            : fmt::format("mean of the first {} still frames", info.params.reference_frames);
  Session session(info, common.paths);
  if (const std::string error = session.output_error(); !error.empty()) return fail(error);
  Player player(scene, session.clock());
  session.connect(player.camera(), tree.get());
  if (const Status s = session.app().start(info.params, info.auto_grid); !s.ok()) {
    return fail(fmt::format("scene {}: {}", scene.name, explain(s.reason, session.app())));
  }

  TruthSeries fraction{"slipping share of the contact", "", {}};
  std::vector<PlayedFrame> frames;
  double deepest_mm = 0.0, last_s = 0.0;
  Progress progress("sim", scene::frame_count(scene));
  while (!interrupted() && player.step(session.app(), info.params, info.auto_grid)) {
    const scene::Snapshot& truth = player.snapshot();
    const hal::Frame given = player.lent();
    const double scale = pictures ? luma_input::reduction(pipeline_config(info.params).luma, given) : 1.0;
    session.record(truth.frame, truth.t_s, scale, given);
    session.record_truth(kTruthHeader, truth_line(truth));
    if (!common.paths.truth_markers.empty()) {
      session.record_truth_markers(kTruthMarkersHeader, truth_marker_lines(player, scene.markers.cols));
    }
    fraction.points.emplace_back(truth.t_s, truth.contact.slip_fraction);
    frames.push_back(played(player, session.app()));
    deepest_mm = std::max(deepest_mm, truth.contact.depth_mm);
    last_s = truth.t_s;
    progress.update(truth.frame + 1);
  }
  progress.clear();
  session.app().stop();
  if (interrupted()) return fail(interrupted_line());

  std::vector<TruthMark> marks;
  const auto mark = [&](scene::SlipLevel level, const char* text, bool main) {
    if (const auto t = onset_s(frames, level)) marks.push_back({*t, text, main});
  };
  mark(scene::SlipLevel::kAnnulus, "slip begins", false);
  mark(scene::SlipLevel::kHalf, "half slips", true);
  mark(scene::SlipLevel::kGross, "all slips", false);

  const Summary summary = session.summary();
  if (summary.accepted == 0) {
    return fail(fmt::format("scene {}: {}", scene.name,
                            explain_none(summary, session.app(), "its faults keep the camera off the whole time",
                                         "let 'faults' end sooner, or make 'duration_s' longer")));
  }
  std::string left_out;
  for (const std::string_view what : scene::omissions(scene.level.contact)) {
    left_out += fmt::format("{}{}", left_out.empty() ? "" : "; ", what);
  }
  for (std::string& doubt : doubts_of(scene, deepest_mm, last_s)) session.note(std::move(doubt));
  const std::string said = fmt::format(
      "Simulated at contact level {}, which leaves out: {}. Onset means that more than half of the contact's area "
      "slips.",
      contact, left_out);
  if (const std::string error = session.commit(marks, fraction, {said}); !error.empty()) return fail(error);
  print_summary(session, summary, common);
  if (!common.json) fmt::print(common.paths.people(), "lines\n{}", session.gpio_timeline());

  std::vector<Promise> promises = check_promises(scene.expect, frames);
  if (!summary.slip_frames.empty()) {
    promises.push_back({"GRIP_OK LOW in the frame that raises slip",
                        summary.grip_ok_fell_with_first_slip ? "it is" : "it is not",
                        summary.grip_ok_fell_with_first_slip});
  }
  std::string broken;
  for (const Promise& promise : promises) {
    if (!common.json) {
      fmt::print(common.paths.people(), "expected  {}: {}, {}\n", promise.what, promise.result,
                 promise.met ? "met" : "NOT MET");
    }
    if (!promise.met) broken += fmt::format("{}{} ({})", broken.empty() ? "" : "; ", promise.what, promise.result);
  }
  if (!common.json) {
    const bool committed = options.inject.empty() && options.contact.empty() && common.model.empty();
    for (const Promise& goal : check_goals(scene.goal, frames))
      fmt::print(common.paths.people(), "goal  {}\n", goal_line(goal, committed));
  }
  if (broken.empty()) return 0;
  return fail(
      fmt::format("scene {}: not as expected: {}. Likely cause: the scene, the model or the features changed. "
                  "Next: look at the report, and at 'expect' in {}",
                  scene.name, broken, options.scene));
}

}  // namespace

void add_sim(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<SimOptions>();
  options->common.grid.clear();  // the scene says
  CLI::App* const command = app.add_subcommand("sim", "play a scene through the firmware and check what it expects");
  command->add_option("SCENE", options->scene, "scene file; tests/scenes has a gallery")->required()->check(not_empty);
  command->add_option("--inject", options->inject, "enter here instead: features, markers, grey or jpeg");
  command->add_option("--contact", options->contact, "with this contact level instead: springs or grid");
  command->add_option("--truth", options->common.paths.truth, "write the simulated truth, one row per frame: CSV")
      ->check(not_empty);
  command
      ->add_option("--truth-markers", options->common.paths.truth_markers,
                   "write where the markers really are, one row per marker and frame: CSV")
      ->check(not_empty);
  add_common_options(*command, options->common);
  command->footer("Example:\n  holdfast sim tests/scenes/sphere_slip.json --report slip.html --truth truth.csv");
  commands.push_back({command, [options] { return sim_grasp(*options); }});
}

}  // namespace holdfast::tool
