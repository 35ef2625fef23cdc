// SPDX-License-Identifier: Apache-2.0
// The appliance around the App: what a robot is wired to. Keeps the camera running, obeys commands, moves the gripper,
// and remembers the grasp for the process after this one.
//
//   camera   started again when it is gone or no frame was accepted for long, with back-off; the same sensor only
//   commands TARE, OPENING, RELEASE, ARM and GRIP as frames on the link, the first four also by wire, where wired;
//            OPENING and RELEASE mask slip for opening_max_ms from the first one on, however often they are said
//   gripper  the regulator's force, by Modbus RTU or as pulses on two lines; its faults are FAULTs
//   supply   low: DEGRADED and an event, for as long as it is
//   keep     rest position and empty gel, written when learned and every few seconds on an empty gel
//
// One thread calls poll(); each call waits for the camera for kSlice at most and does a bounded amount of work beside
// it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "app/app.hpp"
#include "app/recorder.hpp"
#include "grip/hande.hpp"
#include "grip/regulator.hpp"
#include "grip/step_lines.hpp"
#include "hal/keep.hpp"
#include "hal/supply.hpp"
#include "link/command_frame.hpp"
#include "link/link.hpp"
#include "store/checkpoint.hpp"

namespace holdfast {

// What a board provides beside the App's devices. All references outlive the Daemon.
struct Periphery {
  hal::Serial& gripper;  // DESIGN.md, port `gripper`; unused without `gripper` 1
  hal::Keep& keep;
  const hal::Supply* supply = nullptr;  // null: the board does not report it
};

enum class Gripper : std::uint8_t { kNone, kHandE, kStepLines };

[[nodiscard]] regulator::Config regulator_config(const Params& params);
[[nodiscard]] hande::Config hande_config(const Params& params);

class Daemon {
 public:
  Daemon(const Devices& devices, const Periphery& periphery, const model::Tree* tree = nullptr)
      : devices_(devices), periphery_(periphery), app_(devices, tree) {}

  // As App::start(), but a camera that is not there yet, or is another finger's, is waited for: kConfig, kGpioFailed.
  [[nodiscard]] Status start(const Params& params);
  // Other parameters while it runs; those that are made with the board (Applies::kAtRestart) stay as they are.
  // Range: validate(params) is ok.
  void reconfigure(const Params& params);
  // A command that came some other way than on the link.
  [[nodiscard]] command_frame::Outcome obey(const command_frame::CommandFrame& frame);
  // Once around. Range: called again at once; every call returns within kSlice and what one frame costs.
  void poll();
  void stop();

  [[nodiscard]] App& app() { return app_; }
  [[nodiscard]] const App& app() const { return app_; }
  [[nodiscard]] const regulator::Command& grip() const { return grip_; }
  [[nodiscard]] const hande::Feedback& gripper() const { return seen_; }
  [[nodiscard]] std::uint32_t camera_starts(int finger = 0) const { return app_.camera(finger).starts; }
  [[nodiscard]] const link::Receiver& commands() const { return receiver_; }
  [[nodiscard]] bool streaming(int finger = 0) const { return app_.camera(finger).streaming; }
  [[nodiscard]] bool resumed(int finger = 0) const { return app_.state(finger).resumed; }
  [[nodiscard]] Recorder& recorder() { return recorder_; }
  [[nodiscard]] const Devices& devices() const { return devices_; }
  [[nodiscard]] const Params& params() const { return params_; }
  [[nodiscard]] bool is_opening() const { return opening_; }
  [[nodiscard]] hal::Supply::State supply() const { return supply_; }

  static constexpr Micros kSlice{5'000};
  // Of the link, per poll(): 115200 baud bring 58 in kSlice.
  static constexpr std::size_t kMostLinkBytes = 64;

 private:
  void mind_the_clock();
  void take_frame();
  void mind_the_supply();
  void mind_the_cameras();
  void camera_started(int finger);
  void regulate();
  void serve_link();
  void read_inputs();
  void move_gripper();
  void keep_reference(int finger);
  void keep_grip();
  void resume_grip();
  [[nodiscard]] command_frame::Outcome execute(const command_frame::CommandFrame& frame);
  [[nodiscard]] command_frame::Outcome tare(bool even_if_touched);
  void arm();
  [[nodiscard]] command_frame::Outcome release();
  [[nodiscard]] bool begin_opening();
  void end_opening();

  Devices devices_;
  Periphery periphery_;
  App app_;
  Params params_{};
  Micros seen_now_{};
  hal::Supply::State supply_ = hal::Supply::State::kUnknown;

  link::Receiver receiver_;
  command_frame::Once once_;
  bool opening_ = false;
  bool may_open_ = true;  // the last OPENING was ended, or something was touched since it began
  Micros opening_until_{};
  struct Wire {
    bool known = false;  // a level has lasted since start()
    bool high = false;   // which
    bool now_high = false;
    Micros since{};  // that it is
  };
  std::array<Wire, hal::kInputCount> wires_{};

  regulator::Config regulator_config_{};
  regulator::State regulator_{};
  regulator::Command grip_{};
  bool grip_asked_ = false;
  bool release_asked_ = false;
  bool opened_ = false;  // by RELEASE: the fingers open when no force is left
  hande::Config hande_config_{};
  hande::State hande_{};
  hande::Feedback seen_{};
  bool reactivate_ = false;
  step_lines::Config lines_config_{};
  step_lines::State lines_{};

  checkpoint::State checkpoint_;
  checkpoint::GripState kept_grip_;
  struct Kept {               // of a finger's reference
    bool looked_for = false;  // once its camera said which sensor it is
    bool kept = false;
    Micros at{};
    bool streamed = false;  // when it was looked at last
  };
  std::array<Kept, kMaxFingers> kept_{};
  Recorder recorder_;
};

// What the daemon adds to the App: gripper and ports, the slot of the checkpoint, and the flight recorder.
static_assert(sizeof(Daemon) - sizeof(App) - sizeof(Recorder) <= 40'000, "fixed memory around the pipeline");
static_assert(sizeof(Recorder) <= 310'000, "ten seconds, twice");

}  // namespace holdfast
