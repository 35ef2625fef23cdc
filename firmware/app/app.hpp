// SPDX-License-Identifier: Apache-2.0
// The firmware as one object: devices in, fixed memory inside, one frame per step().
//
// From start() to stop() nothing allocates, throws or computes in floating point. Time is the HAL clock's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "app/camera_keeper.hpp"
#include "app/health.hpp"
#include "app/outputs.hpp"
#include "app/pipeline.hpp"
#include "app/supervisor.hpp"
#include "app/watchdog.hpp"
#include "hal/camera.hpp"
#include "hal/clock.hpp"
#include "hal/gpio.hpp"
#include "hal/serial.hpp"
#include "link/status_frame.hpp"
#include "params/params.hpp"
#include "vision/jpeg.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast {

// What a board provides. All references outlive the App.
struct Devices {
  hal::Camera& camera;
  hal::Gpio& gpio;
  hal::Serial& link;  // status frames alone (DESIGN.md, port `link`)
  hal::Clock& clock;
  JpegDecoder& jpeg;
  // A camera that is not live is judged by the device's rules all the same: a loss of contact that nobody announced is
  // reported, the rest position follows an empty gel, and a FAULT ends after three frames. Without it none of this
  // holds: in a simulation nobody says OPENING. What stays different: a picture may be shown again, and how long a
  // decision took is not judged. Range: frames at least every 150 ms; slower ones would never leave FAULT.
  bool as_device = false;
};

// Settings of the stages from the one table of parameters. Range: validate(params) is ok.
// `auto_size`: take whatever lattice is printed on the gel instead of grid_rows x grid_cols.
// `tree`: decides in place of the compiled one; what no model in charge reads is not computed.
[[nodiscard]] pipeline::Config pipeline_config(const Params& params, bool auto_size = false,
                                               const model::Tree* tree = nullptr);
[[nodiscard]] supervisor::Config supervisor_config(const Params& params);
// For the board, which makes the decoder and its crew of `jpeg_threads`.
[[nodiscard]] EighthDecoder::Config jpeg_config(const Params& params);

class App {
 public:
  // `tree`: a loaded model that decides instead of the compiled one; outlives the App. May be null.
  explicit App(const Devices& devices, const model::Tree* tree = nullptr) : devices_(devices), tree_(tree) {}

  // Checks the parameters, drives both lines LOW and starts the camera. kConfig, kGpioFailed, kCameraGone.
  [[nodiscard]] Status start(const Params& params, bool auto_size = false);

  // Takes `frame` as the picture of the empty gel; before or after start(). Without it the first still frames of
  // the camera are.
  [[nodiscard]] Status learn(const Params& params, const hal::Frame& frame, bool auto_size = false);

  // Waits for one frame at most kFrameWait, decides, signals. false: the stream has ended.
  [[nodiscard]] bool step();

  // The same for a loop that has more to do: waits at most `wait`. What came is signalled; nothing is signalled at once
  // when the frames are overdue, and otherwise every kFrameWait.
  enum class Polled : std::uint8_t { kWaiting, kSignalled, kGone };
  [[nodiscard]] Polled poll(Micros wait);
  // Without a camera time passes, and is signalled every kFrameWait.
  // The camera is started (anew) when it is time for that (camera_keeper.hpp); lattice, rest position and the device's
  // state stay. True: one that was gone has come.
  bool keep_camera();

  // Other parameters while it runs. What the lattice or its scale depends on has the rest position learned anew.
  // Range: validate(params) is ok.
  void reconfigure(const Params& params);

  void clock_stepped_back();
  void tare() { pipeline::tare(state_); }
  void arm() { supervisor::arm(supervisor_); }
  void opening(bool is_opening) { pipeline::opening(state_, inputs_.opening = is_opening); }
  void force_limit(bool at_limit) { inputs_.force_limit = at_limit; }
  // What a source beside the frames says, until it says otherwise; kNone: all is well. What is worse than before
  // counts at once, the rest from the next frame on. After start().
  void report(supervisor::Source source, Reason reason);
  // Goes on with an earlier process's rest position, when this sensor is that one, and what this model reads of the
  // empty gel was learned then. After start().
  [[nodiscard]] bool resume(const checkpoint::Contents& contents);
  void remember(checkpoint::Contents& contents) const;

  // One step without the camera: markers, or features, from a simulation that leaves the picture out.
  void step_markers(const MarkerField& field, Micros timestamp, std::uint32_t sequence);
  void step_features(const Features& features, GridSize grid, Micros timestamp, std::uint32_t sequence);

  void stop();

  // Of the last step(). A timeout leaves `result` of the frame before it, with quality kNoFrame.
  [[nodiscard]] const pipeline::Result& result() const { return result_; }
  [[nodiscard]] const supervisor::Outputs& outputs() const { return outputs_; }
  [[nodiscard]] const pipeline::State& state() const { return state_; }
  // The loaded model that decides; null: the one that is compiled in does.
  [[nodiscard]] const model::Tree* tree() const { return tree_; }
  // When ALIVE confirmed a frame first since start(). The clock of a board with real devices begins with its kernel.
  [[nodiscard]] std::optional<Micros> first_confirmed() const { return lines_.first_confirmed; }
  // Accepted frames that the status frame called OK since start(), or since the last FAULT.
  [[nodiscard]] std::uint64_t ok_frames() const { return ok_frames_; }
  // By the last step(): its frame was accepted and OK, and nothing touches the gel.
  [[nodiscard]] bool holds_nothing() const {
    return outputs_.accepted && told_.state == DeviceState::kOk && !result_.contact.touching;
  }
  [[nodiscard]] std::uint32_t link_refused() const { return link_refused_; }
  [[nodiscard]] const supervisor::State& supervisor() const { return supervisor_; }
  [[nodiscard]] const health::State& health() const { return health_; }
  [[nodiscard]] const camera_keeper::State& camera() const { return camera_; }
  // The status frame that was sent last.
  [[nodiscard]] const status_frame::StatusFrame& told() const { return told_; }
  [[nodiscard]] timing::Stopwatch& stopwatch() { return state_.stopwatch; }
  // For a thread of its own (app/watchdog.hpp).
  [[nodiscard]] OutputWatchdog& watchdog() { return watchdog_; }

  // One period at 15 fps and a half: a camera that takes longer is late.
  static constexpr Micros kFrameWait{100'000};
  // Frames that claim to be from the future by more than the clocks' slack are rejected.
  static constexpr Micros kClockSlack{5'000};

 private:
  void take(const hal::Frame& frame);
  void conclude();
  void nothing_came(Reason why);
  void other_stream();
  [[nodiscard]] bool is_stale() const;
  void signal(const supervisor::Outputs& outputs);
  void tell();
  void configure(const Params& params);
  void time_frame();

  Devices devices_;
  const model::Tree* tree_;
  pipeline::Config config_{};
  supervisor::Config supervisor_config_{};
  pipeline::State state_{};
  supervisor::State supervisor_{};
  health::Config health_config_{};
  health::State health_{};
  supervisor::Inputs inputs_{};
  camera_keeper::Config camera_config_{};
  camera_keeper::State camera_{};
  outputs::Config lines_config_{};
  outputs::State lines_{};
  OutputWatchdog watchdog_;
  Micros waiting_since_{};
  std::uint64_t ok_frames_ = 0;
  Micros arrived_{};                       // the frame that is worked on
  Reason last_rejection_ = Reason::kNone;  // of the frame seen last
  pipeline::Result result_{};
  supervisor::Outputs outputs_{};
  bool auto_size_ = false;
  std::uint16_t report_sequence_ = 0;
  status_frame::StatusFrame told_{};
  std::uint32_t link_refused_ = 0;  // status frames that the serial line did not take
};

// DESIGN.md, budgets: the pipeline's static memory without camera buffers. The JPEG decoder adds its own.
static_assert(sizeof(App) <= 3'500'000, "fixed memory of the pipeline");
static_assert(sizeof(App) + sizeof(EighthDecoder) + sizeof(jpeg_fast::Worker) <= 4'500'000, "with one thread");
static_assert(sizeof(App) + sizeof(EighthDecoder) + 2 * sizeof(jpeg_fast::Worker) <= 6'000'000, "with two");

}  // namespace holdfast
