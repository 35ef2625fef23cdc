// SPDX-License-Identifier: Apache-2.0
// holdfast live and holdfast record: the sensor on this computer, without a board.
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "drivers/common/monotonic_clock.hpp"
#include "drivers/common/trouble.hpp"
#include "drivers/linux/camera_v4l2.hpp"
#include "drivers/sim/camera_played.hpp"
#include "toolchain/console/device.hpp"
#include "toolchain/console/port.hpp"
#include "toolchain/console/signals.hpp"
#include "toolchain/devices/inventory.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/live/desk.hpp"
#include "toolchain/live/hub.hpp"
#include "toolchain/live/recorder.hpp"
#include "toolchain/live/web.hpp"
#include "toolchain/log/recording_file.hpp"
#include "toolchain/play/empty_gel.hpp"
#include "toolchain/play/reference_picture.hpp"
#include "toolchain/play/rig.hpp"
#include "toolchain/session/page.hpp"
#include "toolchain/session/run.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

using Seconds = std::chrono::duration<double>;
using SteadyClock = std::chrono::steady_clock;

constexpr console_tool::Millis kPatience{5000};  // with a board that does not answer

struct LiveOptions {
  CommonOptions common;  // grid, mode and model of them
  std::string play, board, sensor;
  double fps = 0;
  std::string record;
  int port = 8632;
  double seconds = 0;  // 0: until Ctrl-C
};

// The camera, and what it is in words.
struct Source {
  std::unique_ptr<hal::Camera> camera;
  std::string what;
  std::optional<sim::RecordedFrame> rest;  // of a recording that shows the empty gel
  bool recorded = false;
};

// Empty, or an error line.
std::string find_rest(sim::Recording& recording, const Params& params, Source& source) {
  OneThreadDecoder jpeg(params);
  Progress progress("looking for the empty gel", recording.info().frames);
  const auto found = find_empty_gel(recording, pipeline_config(params), jpeg.get(), [&](long done) {
    progress.update(done);
    return !interrupted();
  });
  progress.clear();
  if (interrupted()) return interrupted_line();
  if (const auto* error = std::get_if<sim::Error>(&found)) return error->line;
  const EmptyGel& gel = std::get<EmptyGel>(found);
  auto picture = reference_picture(recording, std::to_string(gel.frame), pipeline_config(params).luma);
  if (const auto* error = std::get_if<sim::Error>(&picture)) return error->line;
  source.rest = std::get<sim::RecordedFrame>(std::move(picture));
  source.what = fmt::format("empty gel: frame {}{}", gel.frame, gel.clear ? "" : " (not clear)");
  return {};
}

std::string open_scene(const LiveOptions& options, hal::Clock& clock, Source& source) {
  Progress progress("filming the scene", 0);
  sim::PlayedCamera::Config config;
  config.filmed = [&](long done, long) {
    progress.update(done);
    return !interrupted();
  };
  auto played = sim::PlayedCamera::open(options.play, clock, config);
  progress.clear();
  if (interrupted()) return interrupted_line();
  if (const auto* error = std::get_if<sim::Error>(&played)) return error->line;
  source.camera = std::get<0>(std::move(played));
  source.what = fmt::format("{} (a scene, filmed in grey), again and again", options.play);
  return {};
}

std::string open_played(const LiveOptions& options, hal::Clock& clock, const Params& params, Source& source) {
  source.recorded = true;
  if (options.play.ends_with(".json")) return open_scene(options, clock, source);
  auto opened = log::open_recording(options.play, {options.fps});
  if (const auto* error = std::get_if<sim::Error>(&opened)) return error->line;
  auto& recording = std::get<sim::Recording>(opened);
  const sim::RecordingInfo info = recording.info();
  if (std::string error = find_rest(recording, params, source); !error.empty()) return error;
  source.what = fmt::format("{} ({}x{}, {:.4g} fps), again and again; {}", options.play, info.width, info.height,
                            info.time_base_fps, source.what);
  source.camera = sim::PlayedCamera::of(std::move(recording), clock);
  return {};
}

// What doctor says of the cameras, before anything is started.
void say_what_is_wrong_with_cameras() {
  for (const devices::Item& item : devices::cameras(devices::this_computer())) {
    // That there is none at all is the error itself.
    if (item.verdict == devices::Verdict::kGood || item.path.empty()) continue;
    note(fmt::format("{} {}: {}{}{}", item.path, item.name, item.what, item.fix.empty() ? "" : ". Next: ", item.fix));
  }
}

std::string open_source(const LiveOptions& options, hal::Clock& clock, const Params& params, Source& source) {
  if (!options.play.empty()) return open_played(options, clock, params, source);
  say_what_is_wrong_with_cameras();
  drivers::V4l2Camera::Config config;
  config.serial = options.sensor;
  source.camera = std::make_unique<drivers::V4l2Camera>(config);
  source.what = options.sensor.empty() ? "the sensor on USB" : "sensor " + options.sensor;
  // Now, and not while it runs: a desk without a sensor has nothing to show.
  if (!source.camera->start()) return std::string(source.camera->problem());
  source.what = fmt::format("sensor {}", source.camera->identity());
  if (!source.camera->unset().empty()) note(std::string(source.camera->unset()));
  source.camera->stop();
  return {};
}

// State and figures in one line at a terminal, a line for each change of the state otherwise.
class Screen {
 public:
  void show(const log::FrameRecord& frame) {
    ++frames_;
    if (frame.state != state_ || frame.reason != reason_ || frames_ == 1) {
      bar_.clear();
      fmt::print("{:9.3f} s  {}{}\n", frame.t_s(), text_of(frame),
                 frame.evidence_name.empty() || !frame.slip ? "" : "  by " + evidence_of(frame));
      (void)std::fflush(stdout);
    }
    state_ = frame.state;
    reason_ = frame.reason;
    bar_.update(frames_);
  }
  void clear() { bar_.clear(); }
  [[nodiscard]] long frames() const { return frames_; }

 private:
  static std::string text_of(const log::FrameRecord& frame) {
    return frame.reason == Reason::kNone ? std::string(frame.state_name)
                                         : fmt::format("{} ({})", frame.state_name, frame.reason_name);
  }
  static std::string evidence_of(const log::FrameRecord& frame) {
    return fmt::format("{} {:.4g} of {:.4g} {}, {} frames in a row", frame.evidence_name, frame.evidence_value,
                       frame.evidence_threshold, frame.evidence_unit, frame.evidence_frames);
  }
  Progress bar_{"frames (Ctrl-C ends it)", 0};
  DeviceState state_ = DeviceState::kBoot;
  Reason reason_ = Reason::kNone;
  long frames_ = 0;
};

class Deadline {
 public:
  explicit Deadline(double seconds) : seconds_(seconds) {}
  [[nodiscard]] bool over() const {
    return interrupted() || (seconds_ > 0 && Seconds(SteadyClock::now() - begun_).count() >= seconds_);
  }

 private:
  double seconds_;
  SteadyClock::time_point begun_ = SteadyClock::now();
};

void say_where(const live::Web& web) {
  fmt::print("page      {}\n", web.address(true));
  fmt::print("to look   {}\n", web.address(false));
  (void)std::fflush(stdout);
}

// A device of its own in this process; with a page, or only to record it.
int run_desk(const LiveOptions& options, bool page) {
  for (const std::string& input : {options.play, options.common.model}) {
    if (options.record.empty() || input.empty() || !same_place(options.record, input)) continue;
    return fail(trouble(options.record + ": the recording would change an input of this run",
                        "the same name given twice", "give another place for the recording"));
  }
  Params params;
  bool auto_grid = false;
  std::unique_ptr<model::Tree> tree;
  std::string model_text;
  if (std::string error = settle(options.common, params, auto_grid, tree, model_text); !error.empty()) {
    return fail(error);
  }
  if (auto_grid) {
    return fail(trouble("--grid auto: a device does not guess its gel", "an option of replay",
                        "give the printed grid as COLSxROWS; 9x7 is the GelSight Mini's"));
  }
  drivers::MonotonicClock clock;
  Source source;
  if (const std::string error = open_source(options, clock, params, source); !error.empty()) return fail(error);

  std::unique_ptr<live::Recorder> recorder;
  if (!options.record.empty()) {
    recorder = std::make_unique<live::Recorder>(
        options.record, std::map<std::string, std::string>{{"source", source.what}, {"model", model_text}});
    if (!recorder->error().empty()) return fail(recorder->error());
  }
  live::Hub hub;
  const std::string code = live::new_token();
  live::Desk desk(*source.camera, clock, hub, {params, tree.get(), source.recorded, code});
  if (source.rest) {
    if (const std::string error = desk.learn(*source.rest); !error.empty()) return fail(options.play + ": " + error);
  }
  std::unique_ptr<live::Web> web;
  if (page) {
    web = std::make_unique<live::Web>(hub, page::live(true), "unlock " + code);
    if (const std::string error = web->start(options.port); !error.empty()) return fail(error);
  }
  if (const std::string error = desk.start(); !error.empty()) return fail(error);
  fmt::print("source    {}\n", source.what);
  if (web) say_where(*web);
  if (recorder) desk.record_to(recorder.get());

  const Deadline deadline(options.seconds);
  Screen screen;
  std::string told;
  bool cut_short = false;
  while (!deadline.over() && (page || !cut_short)) {
    if (const auto frame = desk.turn()) screen.show(*frame);
    if (recorder && recorder->failed()) {
      // Now, and not at the end: hours may lie between. A page goes on without it.
      desk.record_to(nullptr);
      screen.clear();
      note(recorder->finish());
      recorder.reset();
      cut_short = true;
    }
    if (std::string now = desk.camera_problem(); now != told) {
      told = std::move(now);
      screen.clear();
      note(told.empty() ? "the camera is there" : told);
    }
  }
  screen.clear();
  desk.stop();
  if (recorder) {
    desk.record_to(nullptr);
    if (const std::string error = recorder->finish(); !error.empty()) return fail(error);
    fmt::print("recorded  {}: {} frames{}\n", options.record, recorder->frames(),
               recorder->left_out() == 0
                   ? std::string()
                   : fmt::format("; {} left out, because the disk is slower than the camera", recorder->left_out()));
  }
  if (screen.frames() == 0) {
    return fail(trouble("no frame came", "the camera does not deliver", "holdfast doctor says what is wrong with it"));
  }
  return cut_short ? 1 : 0;
}

// Somebody else's device: its console's port is joined to the page, and nothing else.
int run_board(const LiveOptions& options) {
  console_tool::Port port;
  if (const auto opened = port.open(options.board); opened != console_tool::Port::Opened::kYes) {
    return fail(console_tool::refusal(options.board, opened));
  }
  console_tool::Signals signals;
  console_tool::Device device(port, signals, kPatience);
  if (!device.attach(kPatience)) return fail(console_tool::no_answer(options.board));
  device.lock_at_end();
  live::Hub hub;
  live::Web web(hub, page::live(true), "");
  if (const std::string error = web.start(options.port); !error.empty()) return fail(error);
  fmt::print("source    board on {}; its console unlocks with its own code\n", options.board);
  say_where(web);
  const Deadline deadline(options.seconds);
  std::array<std::uint8_t, 4096> bytes{};
  std::string gone;
  while (!deadline.over() && !signals.over() && gone.empty()) {
    pollfd wait{port.fd(), POLLIN, 0};
    (void)::poll(&wait, 1, 20);
    const int count = port.read(bytes);
    if (count < 0) gone = "while it was looked at";
    if (count > 0) hub.spread(std::span(bytes).first(static_cast<std::size_t>(count)));
    const std::size_t said = hub.said(bytes);
    if (said > 0 && !port.write({reinterpret_cast<const char*>(bytes.data()), said})) gone = "while it was told";
  }
  if (gone.empty()) return 0;
  return fail(trouble(fmt::format("{} has gone {}", options.board, gone),
                      "the cable was pulled, or the board started anew", "plug it in, and start anew"));
}

// A film's name would promise what other programs cannot open. Empty, or what is wrong.
std::string mcap_name(const std::string& text) {
  const std::string ending = std::filesystem::path(text).extension().string();
  for (const std::string_view other : {".avi", ".mjpg", ".mjpeg", ".mkv", ".mp4", ".csv", ".json"}) {
    if (ending == other) return fmt::format("'{}': the recording is MCAP: let its name end with .mcap", text);
  }
  return not_empty(text);
}

void add_source_options(CLI::App* command, LiveOptions& options) {
  command->add_option("--sensor", options.sensor, "serial of the GelSight Mini, as 2BNN4ZE7; without it the only one")
      ->check(not_empty);
  command
      ->add_option("--play", options.play,
                   "instead of a sensor: a recording or a scene, in real time and again and again. Where it begins "
                   "anew, what was held is gone: SLIP (contact_lost)")
      ->check(not_empty)
      ->excludes("--sensor");
  command
      ->add_option("--fps", options.fps,
                   "frames per second of a recording that carries no time (else 25), or a wrong one")
      ->check(number_from_to(1, 100))
      ->needs("--play");
  command->add_option("--grid", options.common.grid, "printed grid as COLSxROWS")->capture_default_str();
  command->add_option("--mode", options.common.mode, "speed setting: fast, balanced, precise")->capture_default_str();
  command->add_option("--model", options.common.model, "model to decide with instead of the compiled one")
      ->check(not_empty);
  command->add_option("--seconds", options.seconds, "end after so many; without it Ctrl-C ends it")
      ->check(number_from_to(0.1, 1e7));
}

}  // namespace

void add_live(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<LiveOptions>();
  CLI::App* const command =
      app.add_subcommand("live", "the sensor on this computer in the browser: picture, decision, console");
  add_source_options(command, *options);
  CLI::Option* const board =
      command
          ->add_option("--board", options->board,
                       "instead: the page for a board whose console is on this serial port; the picture stays there")
          ->check(not_empty);
  for (const char* own : {"--sensor", "--play", "--grid", "--mode", "--model"}) {
    board->excludes(command->get_option(own));
  }
  command->add_option("--record", options->record, "record it as well: MCAP, pictures untouched")
      ->check(mcap_name)
      ->excludes(board);
  command->add_option("--port", options->port, "of the page on 127.0.0.1; 0: any that is free")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command->footer(
      "Open the address that it prints. Whoever has the first may change the device, with the second only look; "
      "several "
      "pages at once. No lines are driven: this shows and records, it guards no grasp.\n"
      "Example:\n  holdfast live --record grasp.mcap\n  holdfast live --play tests/scenes/sphere_slip.json");
  commands.push_back(
      {command, [options] { return options->board.empty() ? run_desk(*options, true) : run_board(*options); }});
}

void add_record(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<LiveOptions>();
  CLI::App* const command = app.add_subcommand("record", "record the sensor on this computer: pictures and decisions");
  command->add_option("FILE", options->record, "the recording: MCAP, pictures untouched")->required()->check(mcap_name);
  add_source_options(command, *options);
  command->footer(
      "Each recording should show the empty gel at its start or end: replay and evaluate look for it there.\n"
      "Example:\n  holdfast record grasp.mcap --seconds 20\n  holdfast replay grasp.mcap --report grasp.html");
  commands.push_back({command, [options] { return run_desk(*options, false); }});
}

}  // namespace holdfast::tool
