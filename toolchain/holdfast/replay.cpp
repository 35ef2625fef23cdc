// SPDX-License-Identifier: Apache-2.0
// holdfast replay: a recording through the whole firmware.
#include <fmt/format.h>

#include <filesystem>
#include <variant>

#include "drivers/sim/camera_replay.hpp"
#include "drivers/sim/recording.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/progress.hpp"
#include "toolchain/play/reference_picture.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::tool {
namespace {

// The firmware's words speak of a camera; a picture of the empty gel can be chosen anew.
std::string explain_reference(Reason reason, const App& app) {
  if (reason != Reason::kJpegDamaged) return explain(reason, app);
  return "the JPEG picture is damaged. Likely cause: the recording broke off, or was damaged on the way. Next: give "
         "another frame or an image with --reference";
}

}  // namespace

int replay(const ReplayOptions& options) {
  SessionInfo info{};
  std::unique_ptr<model::Tree> tree;
  if (const std::string error = settle(options.common, info.params, info.auto_grid, tree, info.model_text);
      !error.empty()) {
    return fail(error);
  }
  auto opened = sim::Recording::open(options.input, {options.fps});
  if (const auto* error = std::get_if<sim::Error>(&opened)) return fail(error->line);
  auto& recording = std::get<sim::Recording>(opened);
  const sim::RecordingInfo about = recording.info();

  info.title = fmt::format("Replay of {}", std::filesystem::path(options.input).filename().string());
  info.inputs = {options.input, options.common.model};
  if (!names_a_frame(options.reference)) info.inputs.emplace_back(options.reference);
  info.input_text = fmt::format("{} ({}x{}, {}, {:.4g} fps)", options.input, about.width, about.height,
                                about.mjpeg ? "JPEG" : "luma", about.time_base_fps);
  info.reference_text = options.reference;
  Session session(info, options.common.paths);
  if (const std::string error = session.output_error(); !error.empty()) return fail(error);

  auto reference = reference_picture(recording, options.reference, pipeline_config(info.params).luma);
  if (const auto* error = std::get_if<sim::Error>(&reference)) return fail(error->line);
  const hal::Frame rest = sim::as_frame(std::get<sim::RecordedFrame>(reference));

  sim::CameraReplay camera(std::move(recording), session.clock());
  session.connect(camera, tree.get());
  const std::string where =
      names_a_frame(options.reference)
          ? fmt::format("{}: frame '{}' as picture of the empty gel", options.input, options.reference)
          : fmt::format("{} as picture of the empty gel", options.reference);
  if (const Status s = session.app().learn(info.params, rest, info.auto_grid); !s.ok()) {
    return fail(fmt::format("{}: {}", where, explain_reference(s.reason, session.app())));
  }
  if (const Status s = session.app().start(info.params, info.auto_grid); !s.ok()) {
    return fail(fmt::format("{}: {}", options.input, explain(s.reason, session.app())));
  }

  Progress progress("replay", about.frames);
  while (!interrupted() && session.app().step()) {
    const sim::RecordedFrame& current = camera.current();
    if (session.app().result().quality.reason == Reason::kNoFrame) continue;
    const hal::Frame given = sim::as_frame(current);
    const double scale = about.scale * luma_input::reduction(pipeline_config(info.params).luma, given);
    session.record(current.index, static_cast<double>(current.time.count()) * 1e-6, scale, given);
    progress.update(current.index + 1);
  }
  progress.clear();
  session.app().stop();
  if (interrupted()) return fail(interrupted_line());
  if (!camera.error().empty()) return fail(camera.error());

  const Summary summary = session.summary();
  if (summary.accepted == 0) {
    return fail(fmt::format("{}: none of {} frames could be used: {}", options.input, summary.frames,
                            explain(summary.last_rejection, session.app())));
  }
  if (const std::string error = session.commit({}, {}, {}); !error.empty()) return fail(error);
  if (options.fps > 0 && about.fps > 0) {
    note(fmt::format("{} carries its own time base ({:.4g} fps), so --fps was not used", options.input, about.fps));
  }
  print_summary(session, summary, options.common);
  return 0;
}

}  // namespace holdfast::tool
