// SPDX-License-Identifier: Apache-2.0
#include "app/app.hpp"

#include <algorithm>

#include "app/modes.hpp"
#include "base/math.hpp"

namespace holdfast {

pipeline::Config pipeline_config(const Params& params, bool auto_size, const model::Tree* tree) {
  pipeline::Config config{};
  config.classifier.loaded = tree;
  config.luma.scale = kModes[idx(params.mode)].scale;
  config.tracker.grid.size = {static_cast<std::uint8_t>(params.grid_rows), static_cast<std::uint8_t>(params.grid_cols)};
  config.tracker.grid.auto_size = auto_size;
  config.reference.frames = params.reference_frames;
  config.displacement.pitch_um = params.pitch_um;
  config.features.histogram_range_um = params.histogram_range_um;
  config.features.max_gap = Micros{std::int64_t{params.max_gap_ms} * 1000};
  config.field.pitch_um = params.pitch_um;
  config.field.max_gap = config.features.max_gap;
  config.imprint.pitch_um = params.pitch_um;
  const auto makes = [&](Stage stage) {
    return params.all_features != 0 || classifier::needs(config.classifier, stage);
  };
  config.with_field = makes(Stage::kField);
  config.with_imprint = makes(Stage::kImprint);
  config.decision.raise_frames = params.raise_frames;
  config.decision.hold = Micros{std::int64_t{params.hold_ms} * 1000};
  config.fault_markers_pct = params.fault_markers_pct;
  return config;
}

supervisor::Config supervisor_config(const Params& params) {
  supervisor::Config config{};
  config.degraded_markers_pct = params.degraded_markers_pct;
  config.latch = params.latch != 0;
  return config;
}

EighthDecoder::Config jpeg_config(const Params& params) {
  EighthDecoder::Config config{};
  config.walk = params.jpeg_lanes == 0 ? EighthDecoder::Walk::kPlain : EighthDecoder::Walk::kFast;
  config.fast.lanes = params.jpeg_lanes;
  return config;
}

Status App::start(const Params& params, bool auto_size) {
  if (const Status s = validate(params); !s.ok()) return s;
  auto_size_ = auto_size;
  configure(params);
  state_.laps.use(devices_.clock);
  if (!devices_.gpio.set(hal::Line::kGripOk, hal::Level::kLow) ||
      !devices_.gpio.set(hal::Line::kAlive, hal::Level::kLow)) {
    return {Reason::kGpioFailed};
  }
  alive_high_ = false;
  distrusted_ = 0;
  first_accepted_.reset();
  ok_frames_ = 0;
  last_rejection_ = Reason::kNone;
  supervisor_ = {};  // what held before the restart vouches for nothing now
  outputs_ = {};
  sensor_ = {};
  freshness::restart(state_.freshness);
  state_.any_frame = false;  // another stream may count its time from another start
  health_ = {};
  strain_ = held_ = beside_ = strain_beside_ = Reason::kNone;
  force_limit_ = false;
  waiting_since_ = devices_.clock.now();
  if (!devices_.camera.start()) return {Reason::kCameraGone};
  sensor_ = keepsake::identity_of(devices_.camera.identity());
  return kOkStatus;
}

void App::configure(const Params& params) {
  config_ = pipeline_config(params, auto_size_, tree_);
  config_.follow_drift = config_.must_be_fresh = devices_.camera.live();
  supervisor_config_ = supervisor_config(params);
  health_config_ = {};
  if (!devices_.camera.live()) {  // a recording may have five frames a second, and nobody in it can say OPENING
    supervisor_config_.recover_frames = 1;
    supervisor_config_.lost_for = Micros{0};
    // Too few frames a second are too few wherever they come from. More than the sensor has lose nothing; and how long
    // a decision took is nothing that a recording could tell.
    health_config_.shortest_period = Micros{0};
    health_config_.deadline = Micros::max();
  }
}

void App::reconfigure(const Params& params) {
  const pipeline::Config before = config_;
  configure(params);
  const bool same = before.luma.scale == config_.luma.scale && before.tracker.grid.size == config_.tracker.grid.size &&
                    before.displacement.pitch_um == config_.displacement.pitch_um;
  if (same) return;
  tracker::reset(state_.tracker);
  pipeline::tare(state_);
}

Status App::learn(const Params& params, const hal::Frame& frame, bool auto_size) {
  if (const Status s = validate(params); !s.ok()) return s;
  return pipeline::learn(state_, pipeline_config(params, auto_size, tree_), devices_.jpeg, frame);
}

bool App::step() {
  while (true) {
    const Micros left = waiting_since_ + kFrameWait - devices_.clock.now();
    const Polled polled = poll(std::max(left, Micros{0}));
    if (polled != Polled::kWaiting) return polled == Polled::kSignalled;
  }
}

App::Polled App::poll(Micros wait) {
  hal::Frame frame;
  switch (devices_.camera.next(frame, wait)) {
    case hal::Capture::kFrame:
      arrived_ = devices_.clock.now();
      take(frame);
      devices_.camera.release(frame);
      conclude();
      time_frame();
      return Polled::kSignalled;
    case hal::Capture::kBad:
      nothing_came(Reason::kJpegDamaged);
      return Polled::kSignalled;
    case hal::Capture::kGone:
      nothing_came(Reason::kCameraGone);
      return Polled::kGone;
    case hal::Capture::kTimeout:
      break;
  }
  const Micros now = devices_.clock.now();
  const bool overdue = supervisor_.any_accepted && supervisor_.device != DeviceState::kFault &&
                       supervisor::is_silent(supervisor_, supervisor_config_, now);
  if (!overdue && now - waiting_since_ < kFrameWait) return Polled::kWaiting;
  nothing_came(Reason::kNoFrame);
  return Polled::kSignalled;
}

void App::time_frame() {
  const Micros now = devices_.clock.now();
  state_.laps.add(Task::kFrame, now - arrived_);
  if (outputs_.accepted) state_.laps.add(Task::kAge, now - result_.timestamp);
}

// Frames that were refused say more than the silence after them.
void App::nothing_came(Reason why) {
  if (why == Reason::kNoFrame && last_rejection_ != Reason::kNone) why = last_rejection_;
  if (why != Reason::kNoFrame) last_rejection_ = why;
  result_.quality = {why};
  signal(supervisor::reject(supervisor_, supervisor_config_, why, result_.request, devices_.clock.now(), health_now()));
  report();
}

bool App::absent(Reason why) {
  if (devices_.clock.now() - waiting_since_ < kFrameWait) return false;
  nothing_came(why);
  return true;
}

Status App::restart_camera() {
  devices_.camera.stop();
  health::restart(health_);
  freshness::restart(state_.freshness);
  state_.any_frame = false;  // another stream may count its time from another start
  Status status = devices_.camera.start() ? kOkStatus : Status{Reason::kCameraGone};
  if (status.ok()) {
    const keepsake::Identity sensor = keepsake::identity_of(devices_.camera.identity());
    if (sensor_ == keepsake::Identity{}) sensor_ = sensor;  // the first that came
    if (sensor != sensor_) {
      devices_.camera.stop();
      status = {Reason::kCameraWrong};
    }
  }
  if (!status.ok()) (void)absent(status.reason);
  return status;
}

void App::opening(bool is_opening) {
  pipeline::opening(state_, is_opening);
}

void App::beside(Reason fault, Reason strain, bool force_limit) {
  strain_beside_ = strain;
  force_limit_ = force_limit;
  const bool began = fault != Reason::kNone && beside_ == Reason::kNone;
  beside_ = fault;
  if (!began) return;
  supervisor::fail(supervisor_, fault);
  signal(supervisor::outputs_of(supervisor_, outputs_.slip, false));
}

void App::hold(Reason fault) {
  held_ = fault;
  if (fault == Reason::kNone) return;
  supervisor::fail(supervisor_, fault);
  signal(supervisor::outputs_of(supervisor_, outputs_.slip, false));
}

bool App::resume(const keepsake::Contents& contents) {
  if (contents.sensor != sensor_ || sensor_ == keepsake::Identity{}) return false;
  if (contents.pitch_um != config_.displacement.pitch_um) return false;
  // Of a process whose model did not read the picture: what the gripper holds now would be learned as the empty gel.
  if (config_.with_imprint && contents.empty.frames == 0) return false;
  pipeline::resume(state_, contents);
  return true;
}

void App::remember(keepsake::Contents& contents) const {
  contents.sensor = sensor_;
  pipeline::remember(state_, config_, contents);
}

supervisor::Health App::health_now() const {
  const Reason strain = strain_ != Reason::kNone          ? strain_
                        : strain_beside_ != Reason::kNone ? strain_beside_
                        : devices_.camera.steady()        ? Reason::kNone
                                                          : Reason::kCameraControls;
  return {.fault = held_ != Reason::kNone ? held_ : beside_,
          .strain = strain,
          .opening = state_.opening,
          .force_limit = force_limit_};
}

bool App::is_stale() const {
  return devices_.clock.now() - result_.timestamp > kOldestFrame;
}

// A frame that tells of long ago vouches for nothing, nor does one that may; one from the future would lock out all
// that follow it. Range: any stamp; where no clock can be (2^62 us) it is cut, so that differences to it fit.
void App::take(const hal::Frame& frame) {
  constexpr Micros kFarthest{std::int64_t{1} << 62};
  const Micros timestamp = std::clamp(frame.timestamp, -kFarthest, kFarthest);
  const Micros age = devices_.clock.now() - timestamp;
  const Status news = devices_.camera.live() && !frame.stamped ? Status{Reason::kFrameUnstamped}
                      : age > kOldestFrame                     ? Status{Reason::kFrameStale}
                      : age < -kClockSlack                     ? Status{Reason::kTimeNotForward}
                                                               : kOkStatus;
  if (news.ok()) {
    result_ = pipeline::update(state_, config_, devices_.jpeg, frame);
    if (result_.quality.ok() && is_stale()) result_.quality = {Reason::kFrameStale};  // decided too late
  } else {
    result_.timestamp = timestamp;
    result_.sequence = frame.sequence;
    result_.quality = news;
  }
}

void App::step_markers(const MarkerField& field, Micros timestamp, std::uint32_t sequence) {
  result_ = pipeline::update_markers(state_, config_, field, timestamp, sequence);
  conclude();
}

void App::step_features(const Features& features, GridSize grid, Micros timestamp, std::uint32_t sequence) {
  result_ = pipeline::update_features(state_, config_, features, grid, timestamp, sequence);
  conclude();
}

void App::conclude() {
  if (watchdog_.trips() != trips_seen_) {  // this thread was away for long, and GRIP_OK was lowered meanwhile
    trips_seen_ = watchdog_.trips();
    supervisor::fail(supervisor_, Reason::kCaptureHung);
    outputs_ = supervisor::outputs_of(supervisor_, outputs_.slip, false);
    report();
  }
  last_rejection_ = result_.quality.reason;
  if (result_.quality.ok()) {
    const Micros decided_after = devices_.clock.now() - result_.timestamp;
    strain_ = health::strain(health_, health_config_, result_.timestamp, result_.sequence, decided_after);
  }
  state_.laps.begin();
  signal(supervisor::update(supervisor_, supervisor_config_, result_, devices_.clock.now(), health_now()));
  report();
  state_.laps.lap(Task::kSignal);
}

void App::stop() {
  devices_.camera.stop();
  outputs_.grip_ok = false;
  watchdog_.rest();
  // Nothing is left to be done about a line that refuses now; a receiver sees ALIVE stand still.
  (void)devices_.gpio.set(hal::Line::kGripOk, hal::Level::kLow);
}

// ALIVE vouches for GRIP_OK, so it moves only after GRIP_OK has taken its level. The one exception is a rise, which
// goes out after ALIVE: no receiver may pair a new HIGH with the edge of the frame before. Whatever line refuses,
// GRIP_OK is tried LOW and ALIVE stands still until GRIP_OK has obeyed for kLineTrust frames. It rises with an accepted
// frame only: the supervisor may hold OK over rejected frames, whose ALIVE edge is an old one. A process that was
// stopped for long just here (SIGSTOP, a debugger) finds its frame stale: GRIP_OK goes LOW and ALIVE stays as it is.
void App::signal(const supervisor::Outputs& outputs) {
  waiting_since_ = devices_.clock.now();
  if (distrusts(outputs)) return;
  const bool rises = outputs.grip_ok && !outputs_.grip_ok;
  const auto grip_ok = static_cast<hal::Level>(outputs.grip_ok && !rises);
  bool obeyed = devices_.gpio.set(hal::Line::kGripOk, grip_ok) && (outputs.accepted || !rises);
  if (obeyed && outputs.accepted) {
    if (is_stale()) return (void)give_up(outputs, Reason::kFrameStale);
    obeyed = devices_.gpio.set(hal::Line::kAlive, static_cast<hal::Level>(!alive_high_));
    if (obeyed) alive_high_ = !alive_high_;
    // Stopped between the look at the clock and the edge (30 ns wide): what the edge says is taken back at once.
    if (obeyed && is_stale()) return (void)give_up(outputs, Reason::kFrameStale);
    if (obeyed) vouch();
  }
  if (obeyed && rises) obeyed = devices_.gpio.set(hal::Line::kGripOk, hal::Level::kHigh);
  outputs_ = outputs;
  if (obeyed) return;
  distrusted_ = kLineTrust;
  (void)give_up(outputs, Reason::kGpioFailed);
}

void App::vouch() {
  const Micros now = devices_.clock.now();
  watchdog_.vouch(now);
  if (!first_accepted_) first_accepted_ = now;
}

bool App::give_up(const supervisor::Outputs& outputs, Reason why) {
  const bool obeyed = devices_.gpio.set(hal::Line::kGripOk, hal::Level::kLow);
  supervisor::fail(supervisor_, why);
  outputs_ = {.state = DeviceState::kFault, .reason = why, .slip = outputs.slip, .accepted = outputs.accepted};
  return obeyed;
}

bool App::distrusts(const supervisor::Outputs& outputs) {
  if (distrusted_ == 0) return false;
  const bool obeyed = give_up(outputs, Reason::kGpioFailed);
  if (!obeyed) distrusted_ = kLineTrust;
  if (obeyed && outputs.accepted) --distrusted_;
  return true;
}

void App::report() {
  status_frame::StatusFrame frame{};
  frame.sequence = report_sequence_;
  report_sequence_ = static_cast<std::uint16_t>(report_sequence_ + 1);  // wraps
  frame.timestamp_us = status_frame::low_timestamp_us(result_.timestamp);
  frame.age_100us = status_frame::age_100us(devices_.clock.now() - result_.timestamp);
  frame.state = outputs_.state;
  frame.reason = outputs_.reason;
  frame.slip = outputs_.slip;
  frame.grip_ok = outputs_.grip_ok;
  frame.alive = alive_high_;
  if (result_.quality.ok() && result_.referenced) {
    frame.features_valid = true;
    frame.markers = static_cast<std::uint8_t>(result_.features.markers);
    frame.vx_um_s = result_.features.vx.raw();
    frame.vy_um_s = result_.features.vy.raw();
    frame.entropy_nat_q16 = result_.features.entropy.raw();
    frame.entropy_rate_nat_s_q8 = result_.features.entropy_rate.raw();
  }
  told_ = frame;
  if (frame.state == DeviceState::kFault) {
    ok_frames_ = 0;
  } else if (frame.state == DeviceState::kOk && outputs_.accepted) {
    ++ok_frames_;
  }
  std::array<std::uint8_t, status_frame::kWireBytes> wire{};
  const std::size_t size = status_frame::encode(frame, wire);
  if (!devices_.link.write(std::span(wire).first(size))) count_up(link_refused_);
}

}  // namespace holdfast
