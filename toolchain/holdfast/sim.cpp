// SPDX-License-Identifier: Apache-2.0
// holdfast sim: a simulated grasp through the whole firmware, checked against its own truth.
#include <fmt/format.h>

#include <cmath>
#include <cstdlib>

#include "drivers/sim/camera_grasp.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/progress.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::tool {
namespace {

std::string truth_line(long frame, const scene::GraspTruth& t) {
  return fmt::format("{},{:.6f},{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{},{:.6f},{}", frame, t.time_s,
                     scene::name(t.phase), t.normal_n, t.shear_n, t.contact_radius_mm, t.stick_radius_mm,
                     t.slip_fraction, t.gross ? 1 : 0, t.travel_mm, static_cast<int>(scene::slip_level(t)));
}

constexpr const char* kTruthHeader =
    "frame,t_s,phase,normal_n,shear_n,contact_radius_mm,stick_radius_mm,slip_fraction,gross,travel_mm,slip_"
    "level";

}  // namespace

int sim_grasp(const SimOptions& options) {
  if (options.list) {
    for (const scene::Scene& s : scene::kScenes) fmt::print("{:14} {}\n", s.name, s.help);
    return 0;
  }
  std::string names;
  for (const scene::Scene& s : scene::kScenes) names += fmt::format("{}{}", names.empty() ? "" : ", ", s.name);
  if (options.scene.empty()) {
    return fail(fmt::format("sim: no scene given. Likely cause: its name was left out. Next: give one of {}", names));
  }
  const scene::Scene* chosen = scene::find_scene(options.scene);
  if (chosen == nullptr) {
    return fail(
        fmt::format("scene '{}': not known. Likely cause: a typing error. Next: give one of {}", options.scene, names));
  }
  SessionInfo info{};
  info.inputs = {options.common.model};
  std::unique_ptr<model::Tree> tree;
  if (const std::string error = settle(options.common, info.params, info.auto_grid, tree, info.model_text);
      !error.empty()) {
    return fail(error);
  }
  sim::GraspCamera::Config config{};
  config.grasp = chosen->grasp();
  if (options.camera == "320x240") {
    config.picture = scene::cropped_320x240();
    config.format = hal::PixelFormat::kLuma8;
  } else if (options.camera != "3280x2464") {
    return fail(
        fmt::format("--camera '{}': no such camera. Likely cause: a typing error. Next: give 3280x2464 (JPEG, as "
                    "the sensor) or 320x240 (luma)",
                    options.camera));
  }

  info.title = fmt::format("Simulated grasp: {}", chosen->name);
  info.input_text =
      fmt::format("{} ({}; {}x{} {}, {:.4g} fps)", chosen->name, chosen->help, config.picture.width,
                  config.picture.height, config.format == hal::PixelFormat::kMjpeg ? "JPEG" : "luma", config.grasp.fps);
  info.reference_text = fmt::format("mean of the first {} still frames", info.params.reference_frames);
  Session session(info, options.common.paths);
  if (const std::string error = session.output_error(); !error.empty()) return fail(error);
  sim::GraspCamera camera(config, session.clock());
  session.connect(camera, tree.get());
  if (const Status s = session.app().start(info.params, info.auto_grid); !s.ok()) {
    return fail(fmt::format("scene {}: {}", chosen->name, explain(s.reason, session.app())));
  }

  TruthSeries fraction{"slipping share of the contact", "", {}};
  const long total = scene::frame_count(config.grasp);
  Progress progress("sim", total);
  long frame = 0;
  while (!interrupted() && session.app().step()) {
    if (session.app().result().quality.reason == Reason::kNoFrame) continue;
    const scene::GraspTruth& truth = camera.truth();
    const hal::Frame& given = camera.lent();
    const double scale = luma_input::reduction(pipeline_config(info.params).luma, given);
    session.record(frame, truth.time_s, scale, given);
    session.record_truth(kTruthHeader, truth_line(frame, truth));
    fraction.points.emplace_back(truth.time_s, truth.slip_fraction);
    progress.update(++frame);
  }
  progress.clear();
  session.app().stop();
  if (interrupted()) return fail(interrupted_line());

  const auto half = scene::onset_s(config.grasp, scene::SlipLevel::kHalf);
  std::vector<TruthMark> marks;
  if (const auto t = scene::onset_s(config.grasp, scene::SlipLevel::kAnnulus))
    marks.push_back({*t, "slip begins", false});
  if (half) marks.push_back({*half, "half slips", true});
  if (const auto t = scene::onset_s(config.grasp, scene::SlipLevel::kGross)) marks.push_back({*t, "all slips", false});

  const Summary summary = session.summary();
  if (summary.accepted == 0) {
    return fail(fmt::format("scene {}: none of {} frames could be used: {}", chosen->name, summary.frames,
                            explain(summary.last_rejection, session.app())));
  }
  const std::string error = session.commit(marks, fraction,
                                           {"Simulated: closed-form partial slip of a sphere on a half-space "
                                            "(Cattaneo-Mindlin). Onset means that more than "
                                            "half of the contact's area slides."});
  if (!error.empty()) return fail(error);
  print_summary(session, summary, options.common);
  if (!options.common.json) fmt::print("lines\n{}", session.gpio_timeline());

  if (!half || !chosen->onset_within_frames) return 0;
  // The first frame that can show the onset is the first one after it.
  const long onset_frame = std::lround(std::ceil(*half * config.grasp.fps - 1e-9));
  const bool raised = !summary.slip_frames.empty();
  const long delay = raised ? summary.slip_frames.front() - onset_frame : 0;
  const bool met = raised && std::labs(delay) <= *chosen->onset_within_frames && summary.grip_ok_fell_with_first_slip;
  if (!options.common.json) {
    fmt::print(
        "expected  slip within {} frames of the onset (frame {}, {:.3f} s), GRIP_OK LOW in the same frame: "
        "{}\n",
        *chosen->onset_within_frames, onset_frame, *half, met ? fmt::format("met, {:+} frames", delay) : "NOT MET");
  }
  if (met) return 0;
  return fail(
      fmt::format("scene {}: slip was {}. Likely cause: model or features changed. Next: look at the report and "
                  "at tests/e2e",
                  chosen->name, raised ? fmt::format("raised {:+} frames from the onset", delay) : "never raised"));
}

}  // namespace holdfast::tool
