// SPDX-License-Identifier: Apache-2.0
#include "app/pipeline.hpp"

namespace holdfast::pipeline {
namespace {

// Frames must come in the order of their timestamps; equal stamps are the same picture twice.
Status in_order(State& state, Micros timestamp) {
  if (state.any_frame && timestamp <= state.last_timestamp) return {Reason::kTimeNotForward};
  state.any_frame = true;
  state.last_timestamp = timestamp;
  return kOkStatus;
}

Status enough(const MarkerField& field, int least_pct) {
  const bool few = field.valid_count() * 100 < field.grid.count() * least_pct;
  return few ? Status{Reason::kMarkersLost} : kOkStatus;
}

Result stamped(Micros timestamp, std::uint32_t sequence) {
  Result out{};
  out.timestamp = timestamp;
  out.sequence = sequence;
  return out;
}

Result rejected(const State& state, Result out, Status why) {
  out.quality = why;
  out.request = state.decision.raised ? GripRequest::kTighten : GripRequest::kHold;
  return out;
}

[[nodiscard]] Result feel(State& state, const Config& config, Result out);
[[nodiscard]] Result judge(State& state, const Config& config, Result out);

}  // namespace

// See.
Result update(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame) {
  Result out = stamped(frame.timestamp, frame.sequence);
  LumaView luma;
  if (const Status s = in_order(state, frame.timestamp); !s.ok()) return rejected(state, out, s);
  if (const Status s = luma_input::update(state.luma, config.luma, jpeg, frame, luma); !s.ok()) {
    return rejected(state, out, s);
  }
  if (const Status s = tracker::update(state.tracker, config.tracker, luma); !s.ok()) return rejected(state, out, s);
  return feel(state, config, out);
}

namespace {

// Feel: markers to features.
Result feel(State& state, const Config& config, Result out) {
  const MarkerField& field = state.tracker.field;
  out.grid = field.grid;
  out.markers = field.valid_count();
  if (const Status s = enough(field, config.fault_markers_pct); !s.ok()) return rejected(state, out, s);

  if (reference::update(state.reference, config.reference, field)) {
    tracker::set_home(state.tracker, state.reference.rest);
    features::forget(state.features);
    field_features::forget(state.field);
  }
  if (!state.reference.known) return out;

  displacement::update(config.displacement, field, state.reference.rest, state.reference.pitch, state.saturations,
                       state.displacement);
  out.features =
      features::update(state.features, config.features, state.displacement, out.timestamp, state.saturations);
  if (config.with_field) {
    out.features.field =
        field_features::update(state.field, config.field, state.displacement, out.timestamp, state.saturations);
  }
  return judge(state, config, out);
}

// Judge: features to request.
Result judge(State& state, const Config& config, Result out) {
  out.referenced = true;
  out.verdict = classifier::classify(config.classifier, out.features);
  out.request = decision::update(state.decision, config.decision, out.verdict, out.timestamp);
  return out;
}

}  // namespace

Result update_markers(State& state, const Config& config, const MarkerField& field, Micros timestamp,
                      std::uint32_t sequence) {
  const Result out = stamped(timestamp, sequence);
  if (const Status s = in_order(state, timestamp); !s.ok()) return rejected(state, out, s);
  state.tracker.field = field;
  return feel(state, config, out);
}

Result update_features(State& state, const Config& config, const Features& features, GridSize grid, Micros timestamp,
                       std::uint32_t sequence) {
  Result out = stamped(timestamp, sequence);
  if (const Status s = in_order(state, timestamp); !s.ok()) return rejected(state, out, s);
  out.grid = grid;
  out.markers = features.markers;
  out.features = features;
  return judge(state, config, out);
}

Status learn(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame) {
  tracker::reset(state.tracker);
  tare(state);
  LumaView luma;
  if (const Status s = luma_input::update(state.luma, config.luma, jpeg, frame, luma); !s.ok()) return s;
  if (const Status s = tracker::update(state.tracker, config.tracker, luma); !s.ok()) return s;
  if (const Status s = enough(state.tracker.field, config.fault_markers_pct); !s.ok()) return s;
  reference::Config single = config.reference;
  single.frames = 1;
  if (!reference::update(state.reference, single, state.tracker.field)) return {Reason::kNoLattice};
  tracker::set_home(state.tracker, state.reference.rest);
  return kOkStatus;
}

void tare(State& state) {
  reference::forget(state.reference);
  features::forget(state.features);
  field_features::forget(state.field);
  state.decision = {};
}

}  // namespace holdfast::pipeline
