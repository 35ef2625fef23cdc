// SPDX-License-Identifier: Apache-2.0
#include "app/app.hpp"

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
  config.classifier.sensitivity = static_cast<Sensitivity>(params.sensitivity);
  config.decision.raise_frames = params.raise_frames;
  config.decision.hold = Micros{std::int64_t{params.hold_ms} * 1000};
  config.fault_markers_pct = params.fault_markers_pct;
  return config;
}

supervisor::Config supervisor_config(const Params& params) {
  supervisor::Config config{};
  config.degraded_markers_pct = params.degraded_markers_pct;
  return config;
}

EighthDecoder::Config jpeg_config(const Params& params) {
  EighthDecoder::Config config{};
  config.walk = params.jpeg_lanes == 0 ? EighthDecoder::Walk::kPlain : EighthDecoder::Walk::kFast;
  config.fast.lanes = params.jpeg_lanes;
  config.limits.rows_pct = params.jpeg_rows_pct;
  return config;
}

Status App::start(const Params& params, bool auto_size) {
  if (const Status s = validate(params); !s.ok()) return s;
  config_ = pipeline_config(params, auto_size, tree_);
  supervisor_config_ = supervisor_config(params);
  if (!devices_.gpio.set(hal::Line::kGripOk, hal::Level::kLow) ||
      !devices_.gpio.set(hal::Line::kAlive, hal::Level::kLow)) {
    return {Reason::kGpioFailed};
  }
  alive_high_ = false;
  supervisor_ = {};  // what held before the restart vouches for nothing now
  outputs_ = {};
  state_.any_frame = false;  // another stream may count its time from another start
  return devices_.camera.start() ? kOkStatus : Status{Reason::kCameraGone};
}

Status App::learn(const Params& params, const hal::Frame& frame, bool auto_size) {
  if (const Status s = validate(params); !s.ok()) return s;
  return pipeline::learn(state_, pipeline_config(params, auto_size, tree_), devices_.jpeg, frame);
}

bool App::step() {
  hal::Frame frame;
  const hal::Capture capture = devices_.camera.next(frame, kFrameWait);
  if (capture == hal::Capture::kFrame) {
    take(frame);
    devices_.camera.release(frame);
    conclude();
  } else {
    result_.quality = {capture == hal::Capture::kGone  ? Reason::kCameraGone
                       : capture == hal::Capture::kBad ? Reason::kJpegDamaged
                                                       : Reason::kNoFrame};
    signal(supervisor::reject(supervisor_, supervisor_config_, result_.quality.reason, result_.request,
                              devices_.clock.now()));
    report();
  }
  return capture != hal::Capture::kGone;
}

// A frame that tells of long ago vouches for nothing; one from the future would lock out all that follow it.
void App::take(const hal::Frame& frame) {
  const Micros age = devices_.clock.now() - frame.timestamp;
  if (age >= -kClockSlack && age <= kOldestFrame) {
    result_ = pipeline::update(state_, config_, devices_.jpeg, frame);
    return;
  }
  result_.timestamp = frame.timestamp;
  result_.sequence = frame.sequence;
  result_.quality = {age > kOldestFrame ? Reason::kFrameStale : Reason::kTimeNotForward};
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
  signal(supervisor::update(supervisor_, supervisor_config_, result_, devices_.clock.now()));
  report();
}

void App::stop() {
  devices_.camera.stop();
  outputs_.grip_ok = false;
  // Nothing is left to be done about a line that refuses now; a receiver sees ALIVE stand still.
  (void)devices_.gpio.set(hal::Line::kGripOk, hal::Level::kLow);
}

// ALIVE vouches for GRIP_OK, so it moves only after GRIP_OK has taken its level. The one exception is a rise, which
// goes out after ALIVE: no receiver may pair a new HIGH with the edge of the frame before. Whatever line refuses,
// GRIP_OK is tried LOW and ALIVE stands still until GRIP_OK obeys again. It rises with an accepted frame only: after a
// refusal the supervisor may hold OK over rejected frames, whose ALIVE edge is an old one.
void App::signal(const supervisor::Outputs& outputs) {
  const bool rises = outputs.grip_ok && !outputs_.grip_ok;
  const auto grip_ok = static_cast<hal::Level>(outputs.grip_ok && !rises);
  bool obeyed = devices_.gpio.set(hal::Line::kGripOk, grip_ok) && (outputs.accepted || !rises);
  if (obeyed && outputs.accepted) {
    obeyed = devices_.gpio.set(hal::Line::kAlive, static_cast<hal::Level>(!alive_high_));
    if (obeyed) alive_high_ = !alive_high_;
  }
  if (obeyed && rises) obeyed = devices_.gpio.set(hal::Line::kGripOk, hal::Level::kHigh);
  outputs_ = outputs;
  if (obeyed) return;
  (void)devices_.gpio.set(hal::Line::kGripOk, hal::Level::kLow);
  outputs_.state = DeviceState::kFault;
  outputs_.reason = Reason::kGpioFailed;
  outputs_.grip_ok = false;
}

void App::report() {
  status_frame::StatusFrame frame{};
  frame.sequence = report_sequence_++;
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
  std::array<std::uint8_t, status_frame::kWireBytes> wire{};
  const std::size_t size = status_frame::encode(frame, wire);
  if (!devices_.link.write(std::span(wire).first(size))) ++link_refused_;
}

}  // namespace holdfast
