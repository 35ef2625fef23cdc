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

hal::Frame as_frame(const sim::RecordedFrame& recorded) {
  hal::Frame frame{};
  frame.bytes = recorded.bytes;
  frame.format = recorded.format;
  frame.width = recorded.width;
  frame.height = recorded.height;
  frame.stride = recorded.width;
  frame.timestamp = recorded.time;
  frame.sequence = recorded.sequence;
  return frame;
}

bool names_a_frame(const std::string& reference) {
  return reference == "first" || reference == "last" ||
         (!reference.empty() && reference.find_first_not_of("-+0123456789") == std::string::npos);
}

// The picture of the empty gel: a frame of the recording, or another image.
sim::Result<sim::RecordedFrame> reference_frame(const sim::Recording& recording, const std::string& reference) {
  if (names_a_frame(reference)) return recording.at(reference);
  return sim::read_picture(reference, recording.info().mjpeg ? 0 : static_cast<int>(recording.scale()));
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
  info.input = options.input;
  info.input_text = fmt::format("{} ({}x{}, {}, {:.4g} fps)", options.input, about.width, about.height,
                                about.mjpeg ? "JPEG" : "luma", about.time_base_fps);
  info.reference_text = options.reference;
  Session session(info, options.common.paths);
  if (const std::string error = session.output_error(); !error.empty()) return fail(error);

  auto reference = reference_frame(recording, options.reference);
  if (const auto* error = std::get_if<sim::Error>(&reference)) return fail(error->line);
  const hal::Frame rest = as_frame(std::get<sim::RecordedFrame>(reference));

  sim::CameraReplay camera(std::move(recording), session.clock());
  session.connect(camera, tree.get());
  const std::string where =
      names_a_frame(options.reference)
          ? fmt::format("{}: frame '{}' as picture of the empty gel", options.input, options.reference)
          : fmt::format("{} as picture of the empty gel", options.reference);
  if (const Status s = session.app().learn(info.params, rest, info.auto_grid); !s.ok()) {
    return fail(fmt::format("{}: {}", where, explain(s.reason, session.app())));
  }
  if (const Status s = session.app().start(info.params, info.auto_grid); !s.ok()) {
    return fail(fmt::format("{}: {}", options.input, explain(s.reason, session.app())));
  }

  Progress progress("replay", about.frames);
  while (session.app().step()) {
    const sim::RecordedFrame& current = camera.current();
    if (session.app().result().quality.reason == Reason::kNoFrame) continue;
    const hal::Frame given = as_frame(current);
    const double scale = about.scale * luma_input::reduction({pipeline_config(info.params).luma.scale}, given);
    session.record(current.index, static_cast<double>(current.time.count()) * 1e-6, scale, given);
    progress.update(current.index + 1);
  }
  session.app().stop();
  if (!camera.error().empty()) return fail(camera.error());

  const Summary summary = session.summary();
  if (summary.accepted == 0) {
    return fail(fmt::format("{}: none of {} frames could be used: {}", options.input, summary.frames,
                            explain(summary.last_rejection, session.app())));
  }
  if (const std::string error = session.commit({}, {}, {}); !error.empty()) return fail(error);
  print_summary(session, summary, options.common);
  return 0;
}

}  // namespace holdfast::tool
