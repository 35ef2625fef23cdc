// SPDX-License-Identifier: Apache-2.0
// holdfast replay: a recording through the whole firmware.
#include <fmt/format.h>

#include <filesystem>
#include <variant>

#include "drivers/sim/camera_replay.hpp"
#include "drivers/sim/recording.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/progress.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::tool {
namespace {

bool names_a_frame(const std::string& reference) {
  return reference == "first" || reference == "last" ||
         (!reference.empty() && reference.find_first_not_of("-+0123456789") == std::string::npos);
}

// The picture of the empty gel: a frame of the recording, or another image that arrives at the same working size.
sim::Result<sim::RecordedFrame> reference_frame(const sim::Recording& recording, const std::string& reference,
                                                const luma_input::Config& luma) {
  if (names_a_frame(reference)) return recording.at(reference);
  std::error_code ignored;
  if (!std::filesystem::exists(reference, ignored)) {
    return sim::Error{
        fmt::format("{}: no such file, and no name of a frame. Likely cause: a typing error in --reference. Next: give "
                    "first, last, a number from 0, or an image of the empty gel",
                    reference)};
  }
  const sim::RecordingInfo& about = recording.info();
  hal::Frame like{};
  like.format = about.mjpeg ? hal::PixelFormat::kMjpeg : hal::PixelFormat::kLuma8;
  like.width = about.width;
  const auto reduce = about.mjpeg ? luma_input::reduction(luma, like) : static_cast<int>(about.scale);
  auto picture = sim::read_picture(reference, reduce, like.format);
  const auto* frame = std::get_if<sim::RecordedFrame>(&picture);
  if (frame != nullptr && (frame->input_width != about.width || frame->input_height != about.height)) {
    return sim::Error{fmt::format(
        "{}: is {}x{} pixels, but the frames of {} are {}x{}. Likely cause: another sensor, or a picture cropped or "
        "scaled. Next: give a picture of that size, or a frame of the recording",
        reference, frame->input_width, frame->input_height, recording.path().string(), about.width, about.height)};
  }
  return picture;
}

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

  auto reference = reference_frame(recording, options.reference, pipeline_config(info.params).luma);
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
