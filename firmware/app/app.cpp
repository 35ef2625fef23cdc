// SPDX-License-Identifier: Apache-2.0
#include "app/app.hpp"

#include <algorithm>

#include "base/math.hpp"
#include "params/modes.hpp"

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
  state_.stopwatch.use(devices_.clock);
  if (!outputs::start(lines_, devices_.gpio)) return {Reason::kGpioFailed};
  ok_frames_ = 0;
  last_rejection_ = Reason::kNone;
  supervisor_ = {};  // what held before the restart confirms nothing now
  outputs_ = {};
  health_ = {};
  inputs_ = {};
  other_stream();
  waiting_since_ = devices_.clock.now();
  return {camera_keeper::start(camera_, camera_config_, devices_.camera, waiting_since_)};
}

// Another stream may count its time and its pictures from another start.
void App::other_stream() {
  health::restart(health_);
  freshness::restart(state_.freshness);
  state_.any_frame = false;
}

void App::configure(const Params& params) {
  config_ = pipeline_config(params, auto_size_, tree_);
  const bool live = devices_.camera.live();
  config_.must_be_fresh = live;
  config_.follow_drift = live || devices_.as_device;
  supervisor_config_ = supervisor_config(params);
  if (!live && !devices_.as_device) {
    supervisor_config_.recover_frames = 1;
    supervisor_config_.lost_for = Micros{0};
  }
  health_config_ = {};
  if (!live) {
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
  if (!camera_.streaming) {
    devices_.clock.wait(wait);
    if (devices_.clock.now() - waiting_since_ < kFrameWait) return Polled::kWaiting;
    nothing_came(camera_.why);
    return Polled::kSignalled;
  }
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
      camera_keeper::lost(camera_, Reason::kCameraGone, camera_config_.first_retry, devices_.clock.now());
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
  state_.stopwatch.add(Task::kFrame, now - arrived_);
  if (outputs_.accepted) state_.stopwatch.add(Task::kAge, now - result_.timestamp);
}

// Frames that were refused say more than the silence after them.
void App::nothing_came(Reason why) {
  if (why == Reason::kNoFrame && last_rejection_ != Reason::kNone) why = last_rejection_;
  if (why != Reason::kNoFrame) last_rejection_ = why;
  result_.quality = {why};
  signal(supervisor::reject(supervisor_, supervisor_config_, why, result_.request, devices_.clock.now(), inputs_));
  tell();
}

bool App::keep_camera() {
  using camera_keeper::Kept;
  const Kept kept = camera_keeper::keep(camera_, camera_config_, devices_.camera, devices_.clock);
  if (kept == Kept::kAsItWas) return false;
  other_stream();
  if (kept == Kept::kFailed && devices_.clock.now() - waiting_since_ >= kFrameWait) nothing_came(camera_.why);
  return kept == Kept::kCame;
}

void App::clock_stepped_back() {
  waiting_since_ = camera_.try_at = camera_.stalled_since = devices_.clock.now();
}

void App::report(supervisor::Source source, Reason reason) {
  const Reason before = supervisor::first(inputs_, DeviceState::kFault);
  inputs_.of(source) = reason;
  const Reason fault = supervisor::first(inputs_, DeviceState::kFault);
  if (fault == Reason::kNone || before != Reason::kNone) return;
  supervisor::fail(supervisor_, fault);
  signal(supervisor::outputs_of(supervisor_, outputs_.slip, false));
}

bool App::resume(const checkpoint::Contents& contents) {
  if (contents.sensor != camera_.sensor || camera_.sensor == checkpoint::Identity{}) return false;
  if (contents.pitch_um != config_.displacement.pitch_um) return false;
  // Of a process whose model did not read the picture: what the gripper holds now would be learned as the empty gel.
  if (config_.with_imprint && contents.empty.frames == 0) return false;
  pipeline::resume(state_, contents);
  supervisor::resume(supervisor_);
  return true;
}

void App::remember(checkpoint::Contents& contents) const {
  contents.sensor = camera_.sensor;
  pipeline::remember(state_, config_, contents);
}

bool App::is_stale() const {
  return outputs::is_stale(lines_config_, result_.timestamp, devices_.clock.now());
}

// A frame that tells of long ago confirms nothing, nor does one that may; one from the future would lock out all
// that follow it. Range: any stamp; where no clock can be (2^62 us) it is cut, so that differences to it fit.
void App::take(const hal::Frame& frame) {
  constexpr Micros kFarthest{std::int64_t{1} << 62};
  const Micros timestamp = std::clamp(frame.timestamp, -kFarthest, kFarthest);
  const Micros age = devices_.clock.now() - timestamp;
  const Status news = devices_.camera.live() && !frame.stamped ? Status{Reason::kFrameUnstamped}
                      : age > lines_config_.oldest_frame       ? Status{Reason::kFrameStale}
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
  if (outputs::lowered_meanwhile(lines_, watchdog_)) {  // this thread was away for long
    supervisor::fail(supervisor_, Reason::kCaptureHung);
    outputs_ = supervisor::outputs_of(supervisor_, outputs_.slip, false);
    tell();
  }
  last_rejection_ = result_.quality.reason;
  const Micros now = devices_.clock.now();
  if (result_.quality.ok()) {
    camera_keeper::accepted(camera_, camera_config_, now);
    inputs_.of(supervisor::Source::kStream) =
        health::strain(health_, health_config_, result_.timestamp, result_.sequence, now - result_.timestamp);
  }
  inputs_.of(supervisor::Source::kCameraSettings) = devices_.camera.steady() ? Reason::kNone : Reason::kCameraControls;
  state_.stopwatch.begin();
  signal(supervisor::update(supervisor_, supervisor_config_, result_, devices_.clock.now(), inputs_));
  tell();
  state_.stopwatch.lap(Task::kSignal);
}

void App::stop() {
  devices_.camera.stop();
  camera_keeper::stopped(camera_);
  outputs_.grip_ok = false;
  outputs::stop(lines_, devices_.gpio, watchdog_);
}

void App::signal(const supervisor::Outputs& outputs) {
  waiting_since_ = devices_.clock.now();
  const Reason failed =
      outputs::update(lines_, lines_config_, devices_.gpio, devices_.clock, watchdog_,
                      {.grip_ok = outputs.grip_ok, .accepted = outputs.accepted, .timestamp = result_.timestamp});
  outputs_ = outputs;
  if (failed == Reason::kNone) return;
  supervisor::fail(supervisor_, failed);
  outputs_ = {.state = DeviceState::kFault, .reason = failed, .slip = outputs.slip, .accepted = outputs.accepted};
}

void App::tell() {
  status_frame::StatusFrame frame{};
  frame.sequence = report_sequence_;
  report_sequence_ = static_cast<std::uint16_t>(report_sequence_ + 1);  // wraps
  frame.timestamp_us = status_frame::low_timestamp_us(result_.timestamp);
  frame.age_100us = status_frame::age_100us(devices_.clock.now() - result_.timestamp);
  frame.state = outputs_.state;
  frame.reason = outputs_.reason;
  frame.slip = outputs_.slip;
  frame.grip_ok = outputs_.grip_ok;
  frame.alive = lines_.alive;
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
