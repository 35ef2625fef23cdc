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

}  // namespace

Result update(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame) {
  Result out{};
  out.timestamp = frame.timestamp;
  out.sequence = frame.sequence;
  const auto reject = [&](Status why) {
    out.quality = why;
    out.request = state.decision.raised ? GripRequest::kTighten : GripRequest::kHold;
    return out;
  };

  LumaView luma;
  if (const Status s = in_order(state, frame.timestamp); !s.ok()) return reject(s);
  if (const Status s = luma_input::update(state.luma, config.luma, jpeg, frame, luma); !s.ok()) return reject(s);
  if (const Status s = tracker::update(state.tracker, config.tracker, luma); !s.ok()) return reject(s);

  const MarkerField& field = state.tracker.field;
  out.grid = field.grid;
  out.markers = field.valid_count();
  if (const Status s = enough(field, config.fault_markers_pct); !s.ok()) return reject(s);

  if (reference::update(state.reference, config.reference, field)) {
    tracker::set_home(state.tracker, state.reference.rest);
    features::forget(state.features);
  }
  if (!state.reference.known) return out;
  out.referenced = true;

  displacement::update(config.displacement, field, state.reference.rest, state.reference.pitch, state.saturations,
                       state.displacement);
  out.features =
      features::update(state.features, config.features, state.displacement, frame.timestamp, state.saturations);
  out.verdict = classifier::classify(config.classifier, out.features);
  out.request = decision::update(state.decision, config.decision, out.verdict, frame.timestamp);
  return out;
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
  state.decision = {};
}

}  // namespace holdfast::pipeline
