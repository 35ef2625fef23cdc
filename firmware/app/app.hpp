// SPDX-License-Identifier: Apache-2.0
// The firmware as one object: devices in, fixed memory inside, one frame per step().
//
// From start() to stop() nothing allocates, throws or computes in floating point. Time is the HAL clock's.
// One sensor, or those of a hand of two fingers: they take turns, and each frame of either is decided at once. What is
// asked of a finger is the left one's, or the only one's, where its number is left out.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "app/camera_keeper.hpp"
#include "app/fingers.hpp"
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

// One sensor, and all that belongs to it alone.
struct Finger {
  explicit Finger(hal::Camera& its_camera) : camera(its_camera) {}

  hal::Camera& camera;
  pipeline::State state{};
  pipeline::Result result{};  // of its last step; a timeout leaves that of the frame before, with quality kNoFrame
  supervisor::Inputs inputs{};
  health::State health{};
  camera_keeper::Config keeping{};
  camera_keeper::State keeper{};
  Micros waiting_since{};
  Reason last_rejection = Reason::kNone;                 // of the frame seen last
  contact::Event pending_event = contact::Event::kNone;  // of a frame that was decided too late
};

// What a board provides. All references outlive the App.
struct Devices {
  hal::Camera& camera;
  hal::Gpio& gpio;
  hal::Serial& link;  // status frames alone (DESIGN.md, port `link`)
  hal::Clock& clock;
  JpegDecoder& jpeg;
  // A camera that is not live is judged by the device's rules all the same: a loss of contact that nobody announced is
  // reported, the rest position follows an empty gel, and a FAULT ends as on a device. Without it none of this
  // holds: in a simulation nobody says OPENING. What stays different: a picture may be shown again, and how long a
  // decision took is not judged. Range: frames at least every 150 ms; slower ones would never leave FAULT.
  bool as_device = false;
  // The right finger of a hand of two; then `camera` is the left one's. Its memory is the board's, so that a device of
  // one finger does not carry it. Null: one finger.
  Finger* right = nullptr;
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
  explicit App(const Devices& devices, const model::Tree* tree = nullptr)
      : devices_(devices), tree_(tree), left_(devices.camera), all_{&left_, devices.right} {}
  ~App() = default;
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  // Checks the parameters, drives both lines LOW and starts the cameras. kConfig, kGpioFailed; kCameraGone,
  // kCameraWrong of the first that did not start.
  [[nodiscard]] Status start(const Params& params, bool auto_size = false);

  // Takes `frame` as the picture of the left finger's empty gel; before or after start(). Without it the first still
  // frames of the camera are.
  [[nodiscard]] Status learn(const Params& params, const hal::Frame& frame, bool auto_size = false);

  // Waits for one frame at most kFrameWait, decides, signals. false: the stream has ended.
  [[nodiscard]] bool step();

  // The same for a loop that has more to do: waits at most `wait`. What came is signalled; nothing is signalled at once
  // when the frames are overdue, and otherwise every kFrameWait. Of a hand one camera is asked, for at most kTurn.
  enum class Polled : std::uint8_t { kWaiting, kSignalled, kGone };
  [[nodiscard]] Polled poll(Micros wait);
  // Without a camera time passes, and is signalled every kFrameWait.
  // The camera is started (anew) when it is time for that (camera_keeper.hpp); lattice, rest position and the device's
  // state stay. True: one that was gone has come.
  bool keep_camera(int finger = 0);

  // Other parameters while it runs. What the lattice or its scale depends on has the rest position learned anew.
  // Range: validate(params) is ok.
  void reconfigure(const Params& params);

  void clock_stepped_back();
  // Of every finger.
  void tare();
  void arm();
  void opening(bool is_opening);
  void force_limit(bool at_limit);
  // What a source beside the frames says, until it says otherwise; kNone: all is well. What is worse than before
  // counts at once, the rest from the next frame on. After start().
  void report(supervisor::Source source, Reason reason);
  // Goes on with an earlier process's rest position, when this sensor is that one, and what this model reads of the
  // empty gel was learned then. After start().
  [[nodiscard]] bool resume(const checkpoint::Contents& contents, int finger = 0);
  void remember(checkpoint::Contents& contents, int finger = 0) const;

  // One step of the left finger without its camera: markers, or features, from a simulation that leaves the picture
  // out.
  void step_markers(const MarkerField& field, Micros timestamp, std::uint32_t sequence);
  void step_features(const Features& features, GridSize grid, Micros timestamp, std::uint32_t sequence);

  void stop();

  [[nodiscard]] int fingers() const { return devices_.right == nullptr ? 1 : 2; }
  // Whose the last step was, and whether it was an accepted frame.
  [[nodiscard]] int latest() const { return latest_; }
  [[nodiscard]] bool accepted() const { return of(latest_).result.quality.ok(); }
  [[nodiscard]] const pipeline::Result& result(int finger = 0) const { return of(finger).result; }
  // What the lines say, for all fingers. `accepted`: a frame was, and ALIVE has changed unless a line failed.
  [[nodiscard]] const supervisor::Outputs& outputs() const { return outputs_; }
  [[nodiscard]] const pipeline::State& state(int finger = 0) const { return of(finger).state; }
  // The loaded model that decides; null: the one that is compiled in does.
  [[nodiscard]] const model::Tree* tree() const { return tree_; }
  // When ALIVE confirmed a frame first since start(). The clock of a board with real devices begins with its kernel.
  [[nodiscard]] std::optional<Micros> first_confirmed() const { return lines_.first_confirmed; }
  // Accepted frames that the status frame called OK since start(), or since the last FAULT.
  [[nodiscard]] std::uint64_t ok_frames() const { return ok_frames_; }
  // By the last step(): its frame was accepted and OK, and nothing touches any finger's gel. Where contact is not
  // judged (contact.hpp), or a finger is lost, something may.
  [[nodiscard]] bool holds_nothing() const {
    const auto empty = [](const Finger* finger) {
      return finger->result.quality.ok() && finger->result.contact.judged && !finger->result.contact.touching;
    };
    return accepted() && last_status_.state == DeviceState::kOk && std::ranges::all_of(each(), empty);
  }
  [[nodiscard]] std::uint32_t link_refused() const { return link_refused_; }
  [[nodiscard]] const supervisor::State& supervisor(int finger = 0) const { return hand_.supervisors[idx(finger)]; }
  [[nodiscard]] const health::State& health(int finger = 0) const { return of(finger).health; }
  [[nodiscard]] const camera_keeper::State& camera(int finger = 0) const { return of(finger).keeper; }
  // Which sensor was stored for this finger (camera_keeper::number_of); 0: any.
  [[nodiscard]] std::int32_t expected(int finger) const { return of(finger).keeping.sensor; }
  // The status frame that was sent last.
  [[nodiscard]] const status_frame::StatusFrame& last_status() const { return last_status_; }
  [[nodiscard]] timing::Stopwatch& stopwatch(int finger = 0) { return of(finger).state.stopwatch; }
  // For a thread of its own (app/watchdog.hpp).
  [[nodiscard]] OutputWatchdog& watchdog() { return watchdog_; }

  // One period at 15 fps and a half: a camera that takes longer is late.
  static constexpr Micros kFrameWait{100'000};
  // So long a hand waits for one camera before it asks the other.
  static constexpr Micros kTurn{2'500};
  // How much earlier a hand takes a finger for silent: the receiver's 150 ms began with that finger's last frame, and
  // GRIP_OK has to be LOW by then, though the other finger's frames move ALIVE on, and this thread comes round once in
  // two turns. What is left bridges one lost frame at 15 fps.
  static constexpr Micros kHandMargin{10'000};
  // Frames that claim to be from the future by more than the clocks' slack are rejected.
  static constexpr Micros kClockSlack{5'000};

 private:
  [[nodiscard]] Finger& of(int finger) { return *all_[idx(finger)]; }
  [[nodiscard]] const Finger& of(int finger) const { return *all_[idx(finger)]; }
  // Those that there are.
  [[nodiscard]] std::span<Finger* const> each() const { return std::span(all_).first(idx(fingers())); }
  [[nodiscard]] Polled poll(int finger, Micros wait);
  void process_frame(Finger& finger, const hal::Frame& frame);
  void finish_frame(int finger);
  void decide(int finger);
  void handle_no_frame(int finger, Reason why);
  static void reset_stream(Finger& finger);
  [[nodiscard]] bool is_stale(const Finger& finger) const;
  void report_hang();
  [[nodiscard]] supervisor::Outputs fail(Reason why);
  void signal(const supervisor::Outputs& outputs, Micros timestamp);
  void send_status();
  void add_finger_bits(status_frame::StatusFrame& frame) const;
  void configure(const Params& params);
  void forget_slip();
  void time_frame(Finger& finger);

  Devices devices_;
  const model::Tree* tree_;
  fingers::Config config_{};
  Finger left_;
  std::array<Finger*, kMaxFingers> all_;  // left, right
  fingers::Hand hand_{};
  health::Config health_config_{};
  outputs::Config lines_config_{};
  outputs::State lines_{};
  OutputWatchdog watchdog_;
  int turn_ = 0;  // whose camera is asked next
  int latest_ = 0;
  std::uint64_t ok_frames_ = 0;
  Micros arrived_{};  // the frame that is worked on
  supervisor::Outputs outputs_{};
  bool status_v2_ = false;  // status frames of version 2
  bool auto_size_ = false;
  std::uint16_t report_sequence_ = 0;
  status_frame::StatusFrame last_status_{};
  std::uint32_t link_refused_ = 0;  // status frames that the serial line did not take
};

// DESIGN.md, budgets: the pipeline's static memory without camera buffers. The JPEG decoder adds its own.
static_assert(sizeof(App) <= 3'500'000, "fixed memory of the pipeline");
static_assert(sizeof(App) + sizeof(EighthDecoder) + sizeof(jpeg_fast::Worker) <= 4'500'000, "with one thread");
static_assert(sizeof(App) + sizeof(EighthDecoder) + 2 * sizeof(jpeg_fast::Worker) <= 6'000'000, "with two");
// A second finger shares the decoder and its threads.
static_assert((sizeof(App) + sizeof(EighthDecoder) + sizeof(jpeg_fast::Worker)) * 19 >=
                  (sizeof(App) + sizeof(Finger) + sizeof(EighthDecoder) + sizeof(jpeg_fast::Worker)) * 10,
              "1.9 of one finger");

}  // namespace holdfast
