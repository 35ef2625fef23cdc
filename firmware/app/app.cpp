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
  config.load = {params.pitch_um, params.shear_scale, params.normal_scale};
  const auto makes = [&](Stage stage) {
    return params.all_features != 0 || classifier::needs(config.classifier, stage);
  };
  config.with_field = makes(Stage::kField);
  config.with_imprint = makes(Stage::kImprint);
  config.judges_contact = classifier::needs(config.classifier, Stage::kImprint);
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
  for (Finger* const finger : each()) finger->state.stopwatch.use(devices_.clock);
  if (!outputs::start(lines_, devices_.gpio)) return {Reason::kGpioFailed};
  ok_frames_ = 0;
  hand_ = {};  // what held before the restart confirms nothing now
  outputs_ = {};
  latest_ = turn_ = 0;
  Reason why = Reason::kNone;
  for (Finger* const finger : each()) {
    finger->last_rejection = Reason::kNone;
    finger->health = {};
    finger->inputs = {};
    reset_stream(*finger);
    finger->waiting_since = devices_.clock.now();
    const Reason its = camera_keeper::start(finger->keeper, finger->keeping, finger->camera, finger->waiting_since);
    if (why == Reason::kNone) why = its;
  }
  return {why};
}

// Another stream may count its time and its pictures from another start.
void App::reset_stream(Finger& finger) {
  health::restart(finger.health);
  freshness::restart(finger.state.freshness);
  finger.state.any_frame = false;
  finger.pending_event = contact::Event::kNone;
}

void App::configure(const Params& params) {
  config_ = fingers::config_of(fingers(), pipeline_config(params, auto_size_, tree_), supervisor_config(params));
  config_.one_may_be_lost = params.lost_finger != 0;
  config_.oldest_frame = lines_config_.oldest_frame;
  if (fingers() > 1) config_.supervisor.hold -= kHandMargin;
  status_v2_ = fingers() > 1 && params.status_version == 2;
  left_.keeping.sensor = params.left_sensor;
  if (devices_.right != nullptr) devices_.right->keeping.sensor = params.right_sensor;
  const bool live = std::ranges::all_of(each(), [](const Finger* finger) { return finger->camera.live(); });
  config_.pipeline.must_be_fresh = live;
  config_.pipeline.follow_drift = live || devices_.as_device;
  if (!live && !devices_.as_device) {
    config_.supervisor.recover_frames = 1;
    config_.supervisor.lost_for = Micros{0};
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
  const pipeline::Config before = config_.pipeline;
  configure(params);
  const pipeline::Config& now = config_.pipeline;
  // A model that read no picture had no empty gel learned.
  const bool same = before.luma.scale == now.luma.scale && before.tracker.grid.size == now.tracker.grid.size &&
                    before.displacement.pitch_um == now.displacement.pitch_um &&
                    (before.with_imprint || !now.with_imprint);
  if (same) {
    if (before.features.histogram_range_um == now.features.histogram_range_um) return;
    for (Finger* const finger : each()) features::forget(finger->state.features);  // E of other bins: no rate of change
    return;
  }
  for (Finger* const finger : each()) {
    luma_input::forget(finger->state.luma);
    tracker::reset(finger->state.tracker);
    pipeline::forget(finger->state);
  }
  forget_slip();
}

void App::tare() {
  for (Finger* const finger : each()) pipeline::tare(finger->state);
  forget_slip();
}

void App::forget_slip() {
  hand_.fusion = {};
  hand_.request = GripRequest::kHold;
}

void App::arm() {
  for (int i = 0; i < fingers(); ++i) supervisor::arm(hand_.supervisors[idx(i)]);
}

void App::opening(bool is_opening) {
  for (Finger* const finger : each()) pipeline::opening(finger->state, finger->inputs.opening = is_opening);
}

void App::force_limit(bool at_limit) {
  for (Finger* const finger : each()) finger->inputs.force_limit = at_limit;
}

Status App::learn(const Params& params, const hal::Frame& frame, bool auto_size) {
  if (const Status s = validate(params); !s.ok()) return s;
  return pipeline::learn(left_.state, pipeline_config(params, auto_size, tree_), devices_.jpeg, frame);
}

bool App::step() {
  while (true) {
    const Micros left = of(turn_).waiting_since + kFrameWait - devices_.clock.now();
    const Polled polled = poll(std::max(left, Micros{0}));
    if (polled != Polled::kWaiting) return polled == Polled::kSignalled;
  }
}

App::Polled App::poll(Micros wait) {
  const int finger = turn_;
  turn_ = (turn_ + 1) % fingers();
  return poll(finger, fingers() == 1 ? wait : std::min(wait, kTurn));
}

App::Polled App::poll(int finger, Micros wait) {
  Finger& its = of(finger);
  if (!its.keeper.streaming) {
    const bool any = std::ranges::any_of(each(), [](const Finger* one) { return one->keeper.streaming; });
    if (!any) devices_.clock.wait(wait);
    if (devices_.clock.now() - its.waiting_since < kFrameWait) return Polled::kWaiting;
    handle_no_frame(finger, its.keeper.why);
    return Polled::kSignalled;
  }
  hal::Frame frame;
  switch (its.camera.next(frame, wait)) {
    case hal::Capture::kFrame:
      arrived_ = devices_.clock.now();
      process_frame(its, frame);
      its.camera.release(frame);
      finish_frame(finger);
      time_frame(its);
      return Polled::kSignalled;
    case hal::Capture::kBad:
      handle_no_frame(finger, Reason::kJpegDamaged);
      return Polled::kSignalled;
    case hal::Capture::kGone:
      camera_keeper::lost(its.keeper, Reason::kCameraGone, its.keeping.first_retry, devices_.clock.now());
      handle_no_frame(finger, Reason::kCameraGone);
      return Polled::kGone;
    case hal::Capture::kTimeout:
      break;
  }
  const Micros now = devices_.clock.now();
  const supervisor::State& supervisor = hand_.supervisors[idx(finger)];
  const bool overdue = supervisor.any_accepted && supervisor.device != DeviceState::kFault &&
                       supervisor::is_silent(supervisor, config_.supervisor, now);
  if (!overdue && now - its.waiting_since < kFrameWait) return Polled::kWaiting;
  handle_no_frame(finger, Reason::kNoFrame);
  return Polled::kSignalled;
}

void App::time_frame(Finger& finger) {
  const Micros now = devices_.clock.now();
  finger.state.stopwatch.add(Task::kFrame, now - arrived_);
  if (finger.result.quality.ok()) finger.state.stopwatch.add(Task::kAge, now - finger.result.timestamp);
}

// Behind a refused frame its reason says more than the silence after it.
void App::handle_no_frame(int finger, Reason why) {
  Finger& its = of(finger);
  if (why == Reason::kNoFrame && its.last_rejection != Reason::kNone) why = its.last_rejection;
  if (why != Reason::kNoFrame) its.last_rejection = why;
  its.result.quality = {why};
  report_hang();
  decide(finger);
  send_status();
}

bool App::keep_camera(int finger) {
  using camera_keeper::Kept;
  Finger& its = of(finger);
  const Kept kept = camera_keeper::keep(its.keeper, its.keeping, its.camera, devices_.clock);
  if (kept == Kept::kAsItWas) return false;
  reset_stream(its);
  const bool due = devices_.clock.now() - its.waiting_since >= kFrameWait;
  if (kept == Kept::kCame) its.last_rejection = Reason::kNone;  // a camera that is there and silent is not gone
  if (kept == Kept::kFailed && due) handle_no_frame(finger, its.keeper.why);
  return kept == Kept::kCame;
}

void App::clock_stepped_back() {
  for (Finger* const finger : each()) {
    finger->waiting_since = finger->keeper.try_at = finger->keeper.stalled_since = devices_.clock.now();
  }
  fusion::restart(hand_.fusion);
}

void App::report(supervisor::Source source, Reason reason) {
  const Reason before = supervisor::first(left_.inputs, DeviceState::kFault);
  for (Finger* const finger : each()) finger->inputs.of(source) = reason;
  const Reason fault = supervisor::first(left_.inputs, DeviceState::kFault);
  if (fault == Reason::kNone || before != Reason::kNone) return;
  for (Finger* const finger : each()) finger->waiting_since = devices_.clock.now();
  signal(fail(fault), {});
}

// The watchdog had to lower GRIP_OK: this thread was away for long.
void App::report_hang() {
  if (!outputs::lowered_meanwhile(lines_, watchdog_)) return;
  outputs_ = fail(Reason::kCaptureHung);
  send_status();
}

// Until frames say otherwise, whatever each finger sees.
supervisor::Outputs App::fail(Reason why) {
  for (int i = 0; i < fingers(); ++i) supervisor::fail(hand_.supervisors[idx(i)], why);
  hand_.grip_ok = false;
  return {.state = DeviceState::kFault, .reason = why, .slip = outputs_.slip};
}

bool App::resume(const checkpoint::Contents& contents, int finger) {
  Finger& its = of(finger);
  const checkpoint::Identity& sensor = its.keeper.sensor;
  if (contents.sensor != sensor || sensor == checkpoint::Identity{}) return false;
  if (contents.pitch_um != config_.pipeline.displacement.pitch_um) return false;
  // Of a process whose model did not read the picture: what the gripper holds now would be learned as the empty gel.
  if (config_.pipeline.judges_contact && contents.empty.frames == 0) return false;
  pipeline::resume(its.state, contents);
  supervisor::resume(hand_.supervisors[idx(finger)]);
  return true;
}

void App::remember(checkpoint::Contents& contents, int finger) const {
  contents.sensor = of(finger).keeper.sensor;
  pipeline::remember(of(finger).state, config_.pipeline, contents);
}

bool App::is_stale(const Finger& finger) const {
  return outputs::is_stale(lines_config_, finger.result.timestamp, devices_.clock.now());
}

// A stale frame confirms nothing, nor does one without a stamp; one from the future would make all that follow look
// old. Range: any stamp; where no clock can be (2^62 us) it is cut, so that differences to it fit.
void App::process_frame(Finger& finger, const hal::Frame& frame) {
  constexpr Micros kFarthest{std::int64_t{1} << 62};
  const Micros timestamp = std::clamp(frame.timestamp, -kFarthest, kFarthest);
  const Micros age = devices_.clock.now() - timestamp;
  const Status stamp = finger.camera.live() && !frame.stamped ? Status{Reason::kFrameUnstamped}
                       : age > lines_config_.oldest_frame     ? Status{Reason::kFrameStale}
                       : age < -kClockSlack                   ? Status{Reason::kTimeNotForward}
                                                              : kOkStatus;
  if (stamp.ok()) {
    finger.result =
        pipeline::update(finger.state, config_.pipeline, devices_.jpeg, frame, hand_.fusion.decision.raised);
    if (!finger.result.quality.ok()) return;
    // An event of the contact happens once: what a frame saw that was decided too late is told with the next one.
    contact::Event& event = finger.result.contact.event;
    if (event == contact::Event::kNone) event = finger.pending_event;
    const bool too_late = is_stale(finger);
    finger.pending_event = too_late ? event : contact::Event::kNone;
    if (too_late) finger.result.quality = {Reason::kFrameStale};
  } else {
    finger.result.timestamp = timestamp;
    finger.result.sequence = frame.sequence;
    finger.result.quality = stamp;
  }
}

void App::step_markers(const MarkerField& field, Micros timestamp, std::uint32_t sequence) {
  left_.result = pipeline::update_markers(left_.state, config_.pipeline, field, timestamp, sequence);
  finish_frame(0);
}

void App::step_features(const Features& features, GridSize grid, Micros timestamp, std::uint32_t sequence) {
  left_.result = pipeline::update_features(left_.state, config_.pipeline, features, grid, timestamp, sequence);
  finish_frame(0);
}

void App::finish_frame(int finger) {
  Finger& its = of(finger);
  report_hang();
  its.last_rejection = its.result.quality.reason;
  const Micros now = devices_.clock.now();
  health::came(its.health);
  if (its.result.quality.ok()) {
    camera_keeper::accepted(its.keeper, its.keeping, now);
    its.inputs.of(supervisor::Source::kStream) = health::strain(its.health, health_config_, its.result.timestamp,
                                                                its.result.sequence, now - its.result.timestamp);
  }
  its.inputs.of(supervisor::Source::kCameraSettings) = its.camera.steady() ? Reason::kNone : Reason::kCameraControls;
  its.state.stopwatch.begin();
  decide(finger);
  send_status();
  its.state.stopwatch.lap(Task::kSignal);
}

// What the finger's last result comes to, for the hand and on the lines.
void App::decide(int finger) {
  Finger& its = of(finger);
  const fingers::Result decided = fingers::decide(hand_, config_, finger, its.result, devices_.clock.now(), its.inputs);
  its.result.request = decided.fused.request;
  its.result.verdict = decided.fused.step;
  latest_ = finger;
  its.waiting_since = devices_.clock.now();
  signal(decided.hand, fingers() == 1 ? its.result.timestamp : decided.oldest);
}

void App::stop() {
  outputs_.grip_ok = false;
  outputs::stop(lines_, devices_.gpio, watchdog_);
  for (Finger* const finger : each()) {  // a driver may hang there
    finger->camera.stop();
    camera_keeper::stopped(finger->keeper);
  }
}

// `timestamp`: of the oldest frame that this follows from.
void App::signal(const supervisor::Outputs& outputs, Micros timestamp) {
  const Reason failed =
      outputs::update(lines_, lines_config_, devices_.gpio, devices_.clock, watchdog_,
                      {.grip_ok = outputs.grip_ok, .accepted = outputs.accepted, .timestamp = timestamp});
  outputs_ = outputs;
  if (failed == Reason::kNone) return;
  outputs_ = fail(failed);
  outputs_.accepted = outputs.accepted;
}

// The hand's state; of pictures the left finger's, also when the right one's frame was decided.
void App::send_status() {
  const pipeline::Result& result = left_.result;
  status_frame::StatusFrame frame{};
  frame.sequence = report_sequence_;
  report_sequence_ = static_cast<std::uint16_t>(report_sequence_ + 1);  // wraps
  frame.timestamp_us = status_frame::low_timestamp_us(result.timestamp);
  frame.age_100us = status_frame::age_100us(devices_.clock.now() - result.timestamp);
  frame.state = outputs_.state;
  frame.reason = outputs_.reason;
  frame.slip = outputs_.slip;
  frame.grip_ok = outputs_.grip_ok;
  frame.alive = lines_.alive;
  if (result.quality.ok() && result.referenced) {
    frame.features_valid = true;
    frame.markers = static_cast<std::uint8_t>(result.features.markers);
    frame.vx_um_s = result.features.vx.raw();
    frame.vy_um_s = result.features.vy.raw();
    frame.entropy_nat_q16 = result.features.entropy.raw();
    frame.entropy_rate_nat_s_q8 = result.features.entropy_rate.raw();
  }
  if (status_v2_) add_finger_bits(frame);
  last_status_ = frame;
  if (frame.state == DeviceState::kFault) {
    ok_frames_ = 0;
  } else if (frame.state == DeviceState::kOk && outputs_.accepted) {
    ++ok_frames_;
  }
  std::array<std::uint8_t, status_frame::kMostWireBytes> wire{};
  const std::size_t size = status_frame::encode(frame, wire);
  if (!devices_.link.write(std::span(wire).first(size))) count_up(link_refused_);
}

void App::add_finger_bits(status_frame::StatusFrame& frame) const {
  for (int i = 0; i < fingers(); ++i) {
    const auto bit = static_cast<std::uint8_t>(1U << i);
    const DeviceState state = fingers::condition_of(hand_, config_, i, devices_.clock.now()).state;
    const pipeline::Result& result = of(i).result;
    frame.fingers |= bit;
    if (state == DeviceState::kOk || state == DeviceState::kSlip) frame.healthy |= bit;
    if (result.quality.ok() && result.contact.judged && result.contact.touching) frame.contact |= bit;
  }
}

}  // namespace holdfast
