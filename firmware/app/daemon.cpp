// SPDX-License-Identifier: Apache-2.0
#include "app/daemon.hpp"

#include <algorithm>
#include <span>

#include "base/math.hpp"

namespace holdfast {
namespace {

using command_frame::Command;
using command_frame::CommandFrame;
using command_frame::Outcome;
using supervisor::Source;

// Contacts bounce, and a robot controller holds a level for two of its cycles of 8 ms.
constexpr Micros kDebounce{10'000};
constexpr Micros kKeepEvery{2'000'000};

}  // namespace

regulator::Config regulator_config(const Params& params) {
  regulator::Config config{};
  config.start_force = params.start_force;
  config.force_step = params.force_step;
  config.grow_pct = params.grow_pct;
  config.release_step = params.release_step;
  config.max_force = params.max_force;
  return config;
}

// A gripper that falls silent has to be known of within the receiver's 150 ms: no status older than 120 ms counts. So
// one lost reply (30 ms), a pause (10 ms) and the next one still fit in; the manual's 50 ms would not.
hande::Config hande_config(const Params& params) {
  hande::Config config{};
  config.closed_counts = static_cast<std::uint8_t>(params.closed_counts);
  config.bus.timeout = Micros{30'000};
  config.back_off = Micros{10'000};
  config.longest_back_off = Micros{250'000};  // back within 2 s, activation apart
  config.idle_poll = Micros{40'000};
  config.fresh_for = Micros{120'000};
  return config;
}

Status Daemon::start(const Params& params) {
  params_ = params;
  regulator_config_ = regulator_config(params);
  hande_config_ = hande_config(params);
  const Status status = app_.start(params);
  const bool camera = status.reason == Reason::kCameraGone || status.reason == Reason::kCameraWrong;
  if (!status.ok() && !camera) return status;
  if (const Status s = regulator::validate(regulator_config_); !s.ok()) return s;
  if (static_cast<Gripper>(params.gripper) == Gripper::kStepLines) {
    if (const Status s = step_lines::start(lines_, devices_.gpio, 0); !s.ok()) return s;
  }
  kept_ = {};
  wires_.fill({.since = devices_.clock.now()});
  for (int i = 0; i < app_.fingers(); ++i) {
    if (streaming(i)) camera_started(i);
  }
  resume_grip();
  return kOkStatus;
}

void Daemon::poll() {
  mind_the_clock();
  mind_the_supply();
  for (int i = 0; i < app_.fingers(); ++i) kept_[idx(i)].streamed = streaming(i);
  take_frame();
  mind_the_cameras();
  const Micros begun = devices_.clock.now();
  serve_link();
  read_inputs();
  move_gripper();
  app_.stopwatch().add(Task::kServe, devices_.clock.now() - begun);
}

// Each is started (anew) when it is time for that, and what came or went is noted.
void Daemon::mind_the_cameras() {
  for (int i = 0; i < app_.fingers(); ++i) {
    if (app_.keep_camera(i)) camera_started(i);
    if (!kept_[idx(i)].streamed || streaming(i)) continue;
    recorder_.note(EventKind::kCameraGone, devices_.clock.now(), static_cast<std::int32_t>(app_.camera(i).why), i);
  }
}

void Daemon::reconfigure(const Params& params) {
  Params next = params;
  for (const ParamInfo& row : kParams) {
    if (row.applies == Applies::kAtRestart) next.*row.member = params_.*row.member;
  }
  params_ = next;
  regulator_config_ = regulator_config(next);
  hande_config_ = hande_config(next);
  app_.reconfigure(next);
}

// hal::Clock never steps back. One that does all the same (a board whose clock is set late) must not leave waits behind
// that end in hours: they begin anew, and the gripper is asked what it does before it is told anything.
void Daemon::mind_the_clock() {
  const Micros now = devices_.clock.now();
  if (now < seen_now_) {
    for (Kept& one : kept_) one.at = now;
    regulator_.last_step = now;
    regulator_.steady = {};
    opening_until_ = std::min(opening_until_, now + Micros{std::int64_t{params_.opening_max_ms} * 1000});
    hande_ = {};
    lines_.since = now;
    for (Wire& wire : wires_) wire.since = now;
    app_.clock_stepped_back();
  }
  seen_now_ = now;
}

void Daemon::mind_the_supply() {
  const hal::Supply::State state = periphery_.supply == nullptr ? supply_ : periphery_.supply->state();
  if (state == supply_) return;
  supply_ = state;
  recorder_.note(EventKind::kSupply, devices_.clock.now(), static_cast<std::int32_t>(state));
  app_.report(Source::kSupply, state == hal::Supply::State::kLow ? Reason::kBoardUndervoltage : Reason::kNone);
}

void Daemon::stop() {
  app_.stop();
}

// One frame, or its absence, from the camera to the lines, the log and the grip.
void Daemon::take_frame() {
  const App::Polled polled = app_.poll(kSlice);
  if (polled != App::Polled::kWaiting) {
    const int finger = app_.latest();
    recorder_.take(app_.result(finger), app_.state(finger).displacement, app_.outputs(), devices_.clock.now(), finger);
  }
  if (polled == App::Polled::kSignalled || !streaming(app_.latest())) regulate();
  if (polled != App::Polled::kSignalled || !app_.accepted()) return;
  if (app_.result(app_.latest()).contact.event == contact::Event::kTouched) may_open_ = true;
  keep_reference(app_.latest());
}

// The first time the sensor has said which one it is: what was kept may be its own.
void Daemon::camera_started(int finger) {
  recorder_.note(EventKind::kCameraStarted, devices_.clock.now(), static_cast<std::int32_t>(camera_starts(finger)),
                 finger);
  Kept& its = kept_[idx(finger)];
  if (its.looked_for) return;
  its.looked_for = true;
  if (!checkpoint::load(checkpoint_, periphery_.keep, idx(finger))) return;
  (void)app_.resume(checkpoint_.slot.contents, finger);  // what does not fit is learned anew
}

// What follows from a frame for the grip. Without a camera, too: GRIP and RELEASE are obeyed all the same.
void Daemon::regulate() {
  const pipeline::Result& result = app_.result(app_.latest());
  const supervisor::Outputs& outputs = app_.outputs();
  const bool trusted = app_.accepted() && (outputs.state == DeviceState::kOk || outputs.state == DeviceState::kSlip);
  grip_ = regulator::update(regulator_, regulator_config_,
                            {.trusted = trusted,
                             .request = result.request,
                             .verdict = result.verdict,
                             .entropy = result.features.entropy,
                             .finger = app_.latest(),
                             .grip = grip_asked_,
                             .release = release_asked_},
                            devices_.clock.now());
  if (release_asked_) opened_ = true;
  if (grip_asked_) opened_ = false;
  grip_asked_ = release_asked_ = false;
  keep_grip();
}

void Daemon::keep_reference(int finger) {
  const pipeline::Result& result = app_.result(finger);
  Kept& its = kept_[idx(finger)];
  const Micros now = devices_.clock.now();
  if (!result.referenced) {
    its.kept = false;
    return;
  }
  if (its.kept && (!result.empty || now - its.at < kKeepEvery)) return;
  app_.remember(checkpoint_.slot.contents, finger);
  its.kept = true;
  its.at = now;
  (void)checkpoint::save(checkpoint_, periphery_.keep, idx(finger));  // a board without keeps nothing
}

// The gripper holds on while no process runs; the next one goes on tightening, or letting go, from where this one was.
void Daemon::resume_grip() {
  if (!checkpoint::load(kept_grip_, periphery_.keep) || kept_grip_.slot.contents.doing == checkpoint::Grip::kNothing) {
    return;
  }
  if (static_cast<Gripper>(params_.gripper) != Gripper::kHandE) return;
  const checkpoint::Grip& kept = kept_grip_.slot.contents;
  regulator_ = {};
  regulator_.phase = regulator::Phase::kHolding;
  if (kept.doing == checkpoint::Grip::kLetsGo) {
    regulator_.phase = regulator::Phase::kReleasing;
    opened_ = true;
    (void)begin_opening();
  }
  regulator_.force = std::min<int>(kept.force, regulator_config_.max_force);
  regulator_.last_step = devices_.clock.now();
  grip_ = regulator::command_of(regulator_);
}

void Daemon::keep_grip() {
  using checkpoint::Grip;
  const bool closed = opened_ && !grip_.go && seen_.echo != 0;  // the gripper has not heard of it yet
  const bool lets_go = grip_.phase == regulator::Phase::kReleasing || closed;
  const Grip grip{lets_go ? Grip::kLetsGo : grip_.go ? Grip::kHolds : Grip::kNothing, grip_.force};
  if (kept_grip_.slot.contents == grip) return;
  kept_grip_.slot.contents = grip;
  (void)checkpoint::save(kept_grip_, periphery_.keep);
}

void Daemon::serve_link() {
  std::array<std::uint8_t, kMostLinkBytes> bytes;
  const std::size_t count = devices_.link.read(bytes);
  for (const std::uint8_t byte : std::span(bytes).first(count)) {
    if (receiver_.push(byte) != link::Event::kFrame) continue;
    const auto frame = command_frame::read_command(receiver_.payload());
    if (!frame) continue;
    const command_frame::AnswerFrame answer =
        once_.answer(*frame, devices_.clock.now(), [this](const CommandFrame& f) { return obey(f); });
    std::array<std::uint8_t, command_frame::kAnswerBytes> wire;
    (void)command_frame::encode(answer, wire);
    (void)devices_.link.write(wire);  // an answer that is lost is asked for again
  }
}

Outcome Daemon::obey(const CommandFrame& frame) {
  const Outcome wrong = command_frame::check(frame);
  const Outcome result = wrong == Outcome::kDone ? execute(frame) : wrong;
  recorder_.note(EventKind::kCommand, devices_.clock.now(), static_cast<std::int32_t>(frame.command),
                 static_cast<std::int32_t>(result));
  return result;
}

Outcome Daemon::execute(const CommandFrame& frame) {
  switch (frame.command) {
    case Command::kTare:
      return tare(frame.argument == 1);
    case Command::kOpening:
      if (frame.argument == 1) return begin_opening() ? Outcome::kDone : Outcome::kOverdue;
      end_opening();
      return Outcome::kDone;
    case Command::kRelease:
      return release();
    case Command::kArm:
      arm();
      return Outcome::kDone;
    case Command::kGrip:
      if (static_cast<Gripper>(params_.gripper) == Gripper::kNone) return Outcome::kState;
      if (frame.argument == 0) return release();
      grip_asked_ = true;
      release_asked_ = false;
      end_opening();
      return Outcome::kDone;
  }
  return Outcome::kUnknown;
}

Outcome Daemon::tare(bool even_if_touched) {
  for (int i = 0; i < app_.fingers() && !even_if_touched; ++i) {
    if (app_.state(i).contact.touching) return Outcome::kTouching;  // also while its frames are refused
  }
  app_.tare();
  for (int i = 0; i < app_.fingers(); ++i) {
    kept_[idx(i)].kept = false;
    checkpoint::forget(checkpoint_, periphery_.keep, idx(i));
  }
  return Outcome::kDone;
}

void Daemon::arm() {
  app_.arm();
  reactivate_ = true;
  if (static_cast<Gripper>(params_.gripper) == Gripper::kStepLines && lines_.failed) {
    (void)step_lines::start(lines_, devices_.gpio, grip_.steps);  // a line that still refuses fails again at once
  }
}

Outcome Daemon::release() {
  if (static_cast<Gripper>(params_.gripper) == Gripper::kNone) return Outcome::kState;
  release_asked_ = true;
  grip_asked_ = false;
  (void)begin_opening();  // the fingers open all the same; what slips then is told
  return Outcome::kDone;
}

// Said again it is the same one, and its time runs on. When that is over, another one begins only after this one was
// ended, or after a contact was made: a sender that never stops saying it would mask slip for good. Whether it is in
// force.
bool Daemon::begin_opening() {
  if (!may_open_) return opening_;
  may_open_ = false;
  opening_ = true;
  opening_until_ = devices_.clock.now() + Micros{std::int64_t{params_.opening_max_ms} * 1000};
  return true;
}

void Daemon::end_opening() {
  opening_ = false;
  may_open_ = true;
}

// Levels that have lasted for kDebounce. TARE, RELEASE and ARM act on the rise; a wire that was HIGH when this process
// started has not risen: it was obeyed by the one before. OPENING acts as long as it is HIGH.
void Daemon::read_inputs() {
  constexpr std::array kCommandOf{Command::kTare, Command::kOpening, Command::kRelease, Command::kArm};
  static_assert(kCommandOf.size() == hal::kInputCount);
  const Micros now = devices_.clock.now();
  for (std::size_t k = 0; k < wires_.size(); ++k) {
    const auto level = devices_.gpio.read(static_cast<hal::Input>(k));
    Wire& wire = wires_[k];
    const bool high = level == hal::Level::kHigh;
    if (!level || high != wire.now_high) wire.since = now;
    wire.now_high = high;
    if (now - wire.since < kDebounce || (wire.known && high == wire.high)) continue;
    const bool changed = wire.known;
    wire.known = true;
    wire.high = high;
    const bool opening = kCommandOf[k] == Command::kOpening;
    const bool acts = opening ? high || changed : high && changed;
    if (!acts) continue;
    const std::uint8_t argument = opening && high ? 1 : 0;
    (void)obey({.command = kCommandOf[k], .argument = argument});  // a refusal is in the log
  }
}

// OPENING ends with the command, or when it has lasted for too long: masked for good, a slip would never be told.
void Daemon::move_gripper() {
  const Micros now = devices_.clock.now();
  if (opening_ && now >= opening_until_) opening_ = false;
  app_.opening(opening_);

  switch (static_cast<Gripper>(params_.gripper)) {
    case Gripper::kNone:
      return;
    case Gripper::kHandE: {
      const bool opens = opened_ && !grip_.go;  // what the regulator has let go of, the fingers leave
      seen_ = hande::update(hande_, hande_config_, periphery_.gripper,
                            {.go = grip_.go || opens,
                             .position = opens ? hande::kFullyOpen : hande::kFullyClosed,
                             .speed = static_cast<std::uint8_t>(params_.grip_speed),
                             .force = grip_.force,
                             .reactivate = reactivate_},
                            now);
      reactivate_ = false;
      Reason fault = seen_.fault_reason;
      if (fault == Reason::kNone && !seen_.fresh) fault = Reason::kGripperSilent;
      const bool hot = fault == Reason::kGripperHot;
      app_.force_limit(grip_.at_limit);
      app_.report(Source::kGripperHeat, hot ? fault : Reason::kNone);
      app_.report(Source::kGripper, hot ? Reason::kNone : fault);
      return;
    }
    case Gripper::kStepLines: {
      const Status status = step_lines::update(lines_, lines_config_, devices_.gpio, grip_.steps, now);
      app_.force_limit(grip_.at_limit);
      app_.report(Source::kGripper, status.reason);
      return;
    }
  }
}

}  // namespace holdfast
