// SPDX-License-Identifier: Apache-2.0
// holdfast replay: a recording through the whole firmware.
#include "toolchain/session/replay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "drivers/sim/camera_replay.hpp"
#include "drivers/sim/recording.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/pairs.hpp"
#include "toolchain/log/recording_file.hpp"
#include "toolchain/play/empty_gel.hpp"
#include "toolchain/play/reference_picture.hpp"
#include "toolchain/play/rig.hpp"
#include "toolchain/session/pair.hpp"
#include "toolchain/support/cli.hpp"
#include "toolchain/support/progress.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::tool {
namespace {

// The firmware's words speak of a camera; a picture of the empty gel can be chosen anew.
std::string explain_reference(Reason reason, const App& app, const Params& params) {
  const GridSize found = app.state().tracker.found;
  const bool other_grid = reason == Reason::kGridMismatch || reason == Reason::kGridAmbiguous;
  if (other_grid && found.cols == params.grid_rows && found.rows == params.grid_cols) {
    return fmt::format("{}. The picture is turned by a quarter: --grid {}", explain(reason, app), grid_text(found));
  }
  if (reason == Reason::kGridMismatch && found.cols == params.grid_cols && found.rows == params.grid_rows) {
    return fmt::format(
        "a lattice of {} is there, with too many gaps or in more than one place. Likely cause: a noisy picture, or "
        "dots beside the markers. Next: give another frame or an image with --reference",
        grid_text(found));
  }
  if (reason != Reason::kJpegDamaged) return explain(reason, app);
  return "the JPEG picture is damaged. Likely cause: the recording broke off, or was damaged on the way. Next: give "
         "another frame or an image with --reference";
}

struct Opening {
  long from = 0, to = 0;
  [[nodiscard]] bool has(long frame) const { return frame >= from && frame <= to; }
};

constexpr long kMostFrames = 1'000'000'000;

std::string parse_openings(const std::vector<std::string>& texts, std::vector<Opening>& openings) {
  for (const std::string& text : texts) {
    Opening one;
    const char* const end = text.data() + text.size();
    const auto [dash, first_error] = std::from_chars(text.data(), end, one.from);
    if (first_error == std::errc{} && dash != end && *dash == '-') {
      const auto [rest, last_error] = std::from_chars(dash + 1, end, one.to);
      if (last_error == std::errc{} && rest == end && one.from >= 0 && one.from <= one.to && one.to <= kMostFrames) {
        openings.push_back(one);
        continue;
      }
    }
    return fmt::format(
        "--opening '{}': not an interval of frames. Likely cause: a typing error. Next: give the first and the last "
        "frame in which the gripper opens, counted from 0, as 320-340",
        text);
  }
  return {};
}

// --reference auto. Empty, or an error line.
std::string find_reference(sim::Recording& recording, const SessionInfo& info, bool quiet, EmptyGel& gel) {
  OneThreadDecoder jpeg(info.params);
  std::optional<Progress> progress;
  if (!quiet) progress.emplace("reference", recording.info().frames);
  const auto found =
      find_empty_gel(recording, pipeline_config(info.params, info.auto_grid), jpeg.get(), [&](long done) {
        if (progress) progress->update(done);
        return !interrupted();
      });
  if (interrupted()) return interrupted_line();
  if (const auto* error = std::get_if<sim::Error>(&found)) return error->line;
  gel = std::get<EmptyGel>(found);
  return {};
}

// Of the luma's quantisation, as libjpeg counts it: 50 is the table of the standard's annex K, 100 the finest. 100 of
// what has no table.
int jpeg_quality(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kEntries = 64;
  constexpr int kSumOfAnnexK = 3688;
  for (std::size_t at = 2; at + 4 <= bytes.size() && bytes[at] == 0xFF && bytes[at + 1] != 0xDA;) {
    const std::size_t size = std::size_t{bytes[at + 2]} << 8 | bytes[at + 3];
    if (bytes[at + 1] == 0xDB && at + 5 + kEntries <= bytes.size() && bytes[at + 4] == 0) {  // 8 bits, number 0
      const auto table = bytes.subspan(at + 5, kEntries);
      const double scale = 100.0 * std::accumulate(table.begin(), table.end(), 0) / kSumOfAnnexK;
      return static_cast<int>(std::lround(scale < 100 ? 100 - scale / 2 : 5000 / scale));
    }
    at += 2 + size;
  }
  return 100;
}

// How far a pixel of the working picture strays from one frame to the next while little moves: standard deviation, grey
// levels.
class PictureNoise {
 public:
  // `reduction`: pixels of `picture` that become one, each way.
  void add(const LumaView& picture, double reduction) {
    constexpr std::int32_t kStep = 3;  // every ninth pixel is enough
    now_.clear();
    for (std::int32_t y = 0; y < picture.height; y += kStep) {
      for (std::int32_t x = 0; x < picture.width; x += kStep) now_.push_back(picture.row(y)[x]);
    }
    if (now_.size() == before_.size() && now_ != before_) {
      const auto n = static_cast<double>(now_.size());
      double mean = 0;  // what all pixels share is the light's
      for (std::size_t i = 0; i < now_.size(); ++i) mean += (now_[i] - before_[i]) / n;
      double strays = 0;
      for (std::size_t i = 0; i < now_.size(); ++i) strays += std::abs(now_[i] - before_[i] - mean) / n;
      // Of a normal distribution the mean deviation is sqrt(2 / pi) of the standard one; here it is that of two pixels.
      all_.push_back(strays * std::sqrt(std::numbers::pi) / 2 / reduction);
    }
    std::swap(now_, before_);
  }

  // Of the stillest tenth of the frames.
  [[nodiscard]] double sigma() const { return learn::quantile(all_, 0.1).value_or(0); }

 private:
  std::vector<int> now_, before_;
  std::vector<double> all_;
};

// A device that is given fewer frames than this is in FAULT: silent for longer than the receiver's rule allows.
constexpr double kLeastFps = 1 / 0.15;

// What is done with a session that has seen all frames. Empty, or an error line; so for run().
using Conclude = std::function<std::string(Session&, const sim::RecordingInfo&)>;

// The right finger's recording, played already.
struct Right {
  FingerTrack track;
  int offset = 0;
};

bool overlap(long left_frames, const Right& right) {
  return right.offset < std::ssize(right.track.frames) && -right.offset < left_frames;
}

std::string run(const ReplayOptions& options, const ReplayWatch& watch, const Conclude& conclude,
                const Right* right = nullptr) {
  SessionInfo info{};
  std::unique_ptr<model::Tree> tree;
  if (std::string error = settle(options.common, info.params, info.auto_grid, tree, info.model_text); !error.empty()) {
    return error;
  }
  std::vector<Opening> openings;
  if (std::string error = parse_openings(options.opening, openings); !error.empty()) return error;
  auto opened = log::open_recording(options.input, {options.fps});
  if (const auto* error = std::get_if<sim::Error>(&opened)) return error->line;
  auto& recording = std::get<sim::Recording>(opened);
  const sim::RecordingInfo about = recording.info();

  info.title = fmt::format("Replay of {}", std::filesystem::path(options.input).filename().string());
  info.clip = std::filesystem::path(options.input).filename().string();
  info.inputs = {options.input, options.common.model, options.common.settings, options.right};
  const bool find = options.reference == "auto";
  if (!find && !names_a_frame(options.reference)) info.inputs.emplace_back(options.reference);
  info.input_text = fmt::format("{} ({}x{}, {}, {:.4g} fps)", options.input, about.width, about.height,
                                about.mjpeg ? "JPEG" : "luma", about.time_base_fps);
  info.reference_text = options.reference;
  Session session(info, options.common.paths);
  if (std::string error = session.output_error(); !error.empty()) return error;
  std::string named = options.reference;
  if (find) {
    EmptyGel gel;
    if (std::string error = find_reference(recording, info, static_cast<bool>(watch), gel); !error.empty())
      return error;
    named = std::to_string(gel.frame);
    session.use(gel);
  }

  auto reference = reference_picture(recording, named, pipeline_config(info.params).luma);
  if (const auto* error = std::get_if<sim::Error>(&reference)) return error->line;
  const hal::Frame rest = sim::as_frame(std::get<sim::RecordedFrame>(reference));

  sim::CameraReplay camera(std::move(recording), session.clock());
  const bool as_device = about.time_base_fps >= kLeastFps;
  session.connect(camera, tree.get(), as_device);
  std::optional<HandPlayer> hand;
  if (right != nullptr) {
    const fingers::Config config =
        fingers::config_of(2, pipeline_config(info.params, info.auto_grid, tree.get()), supervisor_config(info.params));
    hand.emplace(config, right->track.frames, right->offset);
    session.decided_by([&session, &hand, names = hand_columns(), model = config.fusion.classifier] {
      const HandFrame& frame = hand->step(session.app().result(), session.app().state().opening);
      return Session::Hand{frame.result.hand, names, hand_cells(frame, model)};
    });
  }
  const std::string where = names_a_frame(named)
                                ? fmt::format("{}: frame '{}' as picture of the empty gel", options.input, named)
                                : fmt::format("{} as picture of the empty gel", options.reference);
  if (const Status s = session.app().learn(info.params, rest, info.auto_grid); !s.ok()) {
    return fmt::format("{}: {}", where, explain_reference(s.reason, session.app(), info.params));
  }
  if (!as_device) {
    session.note(
        fmt::format("At {:.3g} frames a second a device would be in FAULT; loss of contact, drift and recovery are not "
                    "played. Next: --fps, where the recording carries no time",
                    about.time_base_fps));
  }
  // Of a still and empty gel at 240x180 and below, 2026-11-28: MJPEG and MPEG-4 raised slip, PNG did not; at 320x240
  // none. Of recordings made JPEG again, in intervals where nothing slips: at 320x240 quality 90 raised it 3 times in
  // 14 recordings, 80 7 times, 75 34 times, as they are never; at 640x480 in 7 recordings 75 never, 50 17 times.
  constexpr std::int32_t kLeastWidth = 320, kFineWidth = 640;
  constexpr int kFineQuality = 85, kCoarseQuality = 70;
  if (rest.width > 0 && rest.width < kLeastWidth) {
    session.note(
        fmt::format("The pictures are {} x {}: below 320 x 240 the blocks of a compressed video can pass for a relief "
                    "that moves, and raise slip on an empty gel. Next: record larger pictures",
                    rest.width, rest.height));
  }
  if (const Status s = session.app().start(info.params, info.auto_grid); !s.ok()) {
    return fmt::format("{}: {}", options.input, explain(s.reason, session.app()));
  }
  const int quality = about.mjpeg && names_a_frame(named) ? jpeg_quality(rest.bytes) : 100;
  if (quality < (about.width < kFineWidth ? kFineQuality : about.width < 2 * kFineWidth ? kCoarseQuality : 0)) {
    session.note(fmt::format(
        "The pictures of {} x {} are JPEG of quality {} of 100: what so strong a compression changes can pass "
        "for a relief that moves, and raise slip where nothing does. Next: record with less compression",
        about.width, about.height, quality));
  }

  std::optional<Progress> progress;
  if (!watch) progress.emplace("replay", about.frames);
  // As the daemon takes it: intervals that touch are one OPENING, and it ends by itself (Daemon::begin_opening).
  const std::chrono::milliseconds longest{info.params.opening_max_ms};
  std::optional<Micros> opening_since;
  bool overdue = false;
  const auto announce = [&](long frame) {
    const Micros now = session.clock().now();
    if (std::ranges::none_of(openings, [&](const Opening& o) { return o.has(frame); })) {
      opening_since.reset();
    } else if (!opening_since) {
      opening_since = now;
    }
    if (opening_since && now - *opening_since >= longest && !std::exchange(overdue, true)) {
      session.note(
          fmt::format("--opening lasts longer than opening_max_ms ({} ms): as on the device slip is judged again from "
                      "frame {} on. Next: a shorter --opening, or --settings with the robot's opening_max_ms",
                      info.params.opening_max_ms, frame));
    }
    session.app().opening(opening_since && now - *opening_since < longest);
  };
  announce(0);
  PictureNoise noise;
  while (!interrupted() && session.app().step()) {
    const sim::RecordedFrame& current = camera.current();
    if (session.app().result().quality.reason == Reason::kNoFrame) continue;
    const hal::Frame given = sim::as_frame(current);
    const double scale = about.scale * luma_input::reduction(pipeline_config(info.params).luma, given);
    if (session.app().result().quality.ok()) {
      const bool jpeg = given.format == hal::PixelFormat::kMjpeg;
      noise.add(jpeg ? session.app().state().luma.decoded.view()
                     : LumaView{given.bytes.data(), given.width, given.height, given.stride},
                jpeg ? 1 : luma_input::reduction(pipeline_config(info.params).luma, given));
    }
    if (watch) watch(session.app());
    session.record(current.index, static_cast<double>(current.time.count()) * 1e-6, scale, given);
    if (progress) progress->update(current.index + 1);
    announce(current.index + 1);
  }
  progress.reset();
  session.app().stop();
  if (interrupted()) return interrupted_line();
  if (!camera.error().empty()) return camera.error();

  // The 200 public recordings have 0.2 at most, the simulated camera 2.5. With noise added to the set real 12 onsets of
  // 12 are detected within 10 frames as they are, 11 at 1.9, 8 at 4.1 and there two alarms in silence (2026-11-29).
  constexpr double kMostNoise = 3.0;
  if (const double sigma = noise.sigma(); sigma > kMostNoise) {
    session.note(
        fmt::format("The pictures are noisy: a pixel strays by {:.1f} grey levels from frame to frame. So much hides a "
                    "relief that moves, and its slip. Next: more light or less gain; holdfast calibrate shows what the "
                    "noise does to the decision",
                    sigma));
  }
  const Summary summary = session.summary();
  if (summary.accepted == 0) {
    return fmt::format("{}: {}", options.input,
                       explain_none(summary, session.app(), "the recording breaks off before its first whole frame",
                                    "play it in a video player; record it again"));
  }
  if (right != nullptr && !overlap(summary.frames, *right)) {
    return fmt::format(
        "--offset {}: the recordings have no frame in common (left {} frames, right {}). Likely cause: a typing error, "
        "or the sign. Next: leave it out, and it is found by how the markers move",
        right->offset, summary.frames, right->track.frames.size());
  }
  for (const Opening& one : openings) {
    if (one.from < summary.frames) continue;
    session.note(fmt::format("--opening {}-{} lies behind the last frame, {}: nothing opened. Next: count from 0",
                             one.from, one.to, summary.frames - 1));
  }
  return conclude(session, about);
}

// Empty, or an error line.
std::string play_right(const ReplayOptions& options, Right& right, std::string& text) {
  const auto play = [&](const std::string& input, const std::string& reference, FingerTrack& track,
                        const std::vector<std::string>& opening) {
    ReplayOptions quiet = options;
    quiet.common.paths = {};
    quiet.input = input;
    quiet.reference = reference;
    quiet.opening = opening;
    return play_finger(quiet, track);
  };
  text = fmt::format("Right finger: {}", options.right);
  right.offset = options.offset.value_or(0);
  bool doubtful = false;
  if (!options.offset) {
    FingerTrack left;
    FingerTrack other;
    if (std::string error = play(options.input, options.reference, left, {}); !error.empty()) return error;
    if (std::string error = play(options.right, options.right_reference, other, {}); !error.empty()) return error;
    const learn::Offset found = learn::find_far_offset(speeds_of(left.frames), speeds_of(other.frames));
    right.offset = found.frames;
    text += fmt::format(", placed by how the markers move (correlation {:.2f})", found.correlation);
    doubtful = found.correlation < learn::kDoubtful;
  }
  text += fmt::format("; its frame {} is the left's frame {}", std::max(0, right.offset), std::max(0, -right.offset));
  if (doubtful) {
    text +=
        ". That is doubtful: the markers of the two do not move alike. Likely cause: another grasp, or little moves. ";
    text += "Next: look for a frame that both show, and give --offset";
  }
  std::vector<Opening> openings;
  if (std::string error = parse_openings(options.opening, openings); !error.empty()) return error;
  std::vector<std::string> opening;
  opening.reserve(openings.size());
  for (const Opening& one : openings) {
    if (one.to + right.offset < 0) continue;  // over before the right recording begins
    opening.push_back(fmt::format("{}-{}", std::max(0L, one.from + right.offset), one.to + right.offset));
  }
  return play(options.right, options.right_reference, right.track, opening);
}

}  // namespace

int replay(const ReplayOptions& options) {
  std::optional<Right> right;
  std::string right_text;
  if (!options.right.empty()) {
    if (std::string problem = play_right(options, right.emplace(), right_text); !problem.empty()) return fail(problem);
  }
  const auto conclude = [&](Session& session, const sim::RecordingInfo& about) {
    if (right) session.note(right_text);
    std::string problem = session.commit({}, {}, {});
    if (!problem.empty()) return problem;
    if (options.fps > 0 && about.fps > 0) {
      note(about.stamped ? fmt::format("{} has the time of each frame, so --fps was not used", options.input)
                         : fmt::format("{} says {:.4g} fps; played at {:.4g}, as --fps says", options.input, about.fps,
                                       options.fps));
    }
    print_summary(session, session.summary(), options.common);
    return problem;
  };
  const std::string error = run(options, {}, conclude, right ? &*right : nullptr);
  return error.empty() ? 0 : fail(error);
}

std::string replay_quietly(const ReplayOptions& options, const ReplayWatch& watch) {
  return run(options, watch, [](Session&, const sim::RecordingInfo&) { return std::string(); });
}

}  // namespace holdfast::tool
