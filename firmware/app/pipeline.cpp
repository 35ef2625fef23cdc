// SPDX-License-Identifier: Apache-2.0
#include "app/pipeline.hpp"

#include <algorithm>
#include <cstdlib>

#include "base/math.hpp"
#include "vision/exposure.hpp"

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

// Why no markers were found: the light, or what the search says.
Status lit(const LumaView& luma, Status why) {
  return exposure::is_bad(luma) ? Status{Reason::kExposure} : why;
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

// Nothing is learned across a change of light, the lattice least of all. True: it has changed since learning began.
bool begin_anew_in_new_light(State& state, const Config& config, const LumaView& luma) {
  if (state.reference.known || state.resuming) return false;
  if (!light::update(state.light, config.light, luma)) {
    tracker::reset(state.tracker);
    reference::forget(state.reference);
  }
  return state.light.changed;
}

[[nodiscard]] Result measure(State& state, const Config& config, const LumaView* luma, bool slips, Result out);
[[nodiscard]] Result classify(State& state, const Config& config, Result out);

}  // namespace

// A camera's frame to markers.
Result update(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame, bool hand_slips) {
  Result out = stamped(frame.timestamp, frame.sequence);
  LumaView luma;
  state.stopwatch.begin();
  if (const Status s = in_order(state, frame.timestamp); !s.ok()) return rejected(state, out, s);
  if (const Status s = luma_input::update(state.luma, config.luma, jpeg, frame, luma); !s.ok()) {
    return rejected(state, out, s);
  }
  state.stopwatch.lap(Task::kDecode);
  if (config.must_be_fresh) {
    if (const Status s = freshness::update(state.freshness, luma, frame.sequence); !s.ok()) {
      return rejected(state, out, lit(luma, s));
    }
  }
  out.light_changed = begin_anew_in_new_light(state, config, luma);
  if (const Status s = tracker::update(state.tracker, config.tracker, luma); !s.ok()) {
    return rejected(state, out, lit(luma, s));
  }
  state.stopwatch.lap(Task::kTrack);
  return measure(state, config, &luma, state.decision.raised || hand_slips, out);
}

namespace {

// The picture of the gel, as the rest position's is learned: nobody touches it then.
void learn_empty(State& state, const Config& config, const LumaView& luma, const MarkerField& markers,
                 const MarkerField& rest, Micros now) {
  (void)imprint::update(state.imprint, config.imprint, luma, markers, rest, reference::pitch_of(rest), now,
                        state.saturations);
  imprint::learn_empty(state.imprint, config.imprint);
}

// Only while there is provably no contact.
void follow_drift(State& state, const Config& config) {
  if (!config.follow_drift || !state.contact.empty) return reference::pause(state.reference);
  if (!reference::follow(state.reference, config.reference, state.tracker.field)) return;
  tracker::set_home(state.tracker, state.reference.rest);
  imprint::place_again(state.imprint);
}

// A kept rest position is that of this lattice when the pitch is the same within a tenth and every marker lies within
// one and a half pitches of its place: a gel that is pressed and sheared hard stays within (24 px of 320 is 1.1
// pitches, the most on the recordings), another sensor or another crop does not.
bool fits(const State& state, const MarkerField& now, const LumaView* luma) {
  const reference::State& kept = state.reference;
  if (kept.rest.grid != now.grid) return false;
  if (luma != nullptr && (luma->width != state.kept_width || luma->height != state.kept_height)) return false;
  const std::int64_t pitch = reference::pitch_of(now).raw();
  if (std::abs(pitch - kept.pitch.raw()) * 10 > kept.pitch.raw()) return false;
  const std::int64_t most = std::int64_t{kept.pitch.raw()} * 3 / 2;
  for (std::int32_t i = 0; i < now.grid.count(); ++i) {
    const Marker& a = kept.rest.markers[idx(i)];
    const Marker& b = now.markers[idx(i)];
    if (a.valid && b.valid && square(b.x.raw() - a.x.raw()) + square(b.y.raw() - a.y.raw()) > square(most)) {
      return false;
    }
  }
  return true;
}

// The first picture after resume() decides.
void end_resuming(State& state, const LumaView* luma) {
  state.resuming = false;
  state.resumed = state.reference.known = fits(state, state.tracker.field, luma);
  if (state.reference.known) {
    tracker::set_home(state.tracker, state.reference.rest);
  } else {
    reference::forget(state.reference);
    imprint::forget(state.imprint);
  }
}

// Markers, and the picture between them where there is one, to features. `slips`: slip is raised.
Result measure(State& state, const Config& config, const LumaView* luma, bool slips, Result out) {
  const MarkerField& field = state.tracker.field;
  out.grid = field.grid;
  out.markers = field.valid_count();
  if (const Status s = enough(field, config.fault_markers_pct); !s.ok()) {
    return rejected(state, out, luma == nullptr ? s : lit(*luma, s));
  }

  const bool with_picture = luma != nullptr && config.with_imprint;
  if (state.resuming) end_resuming(state, luma);
  if (reference::update(state.reference, config.reference, field)) {
    tracker::set_home(state.tracker, state.reference.rest);
    features::forget(state.features);
    field_features::forget(state.field);
    contact::forget(state.contact);
    imprint::place_again(state.imprint);
  }
  if (!state.reference.known) {
    out.bent = state.reference.bent;
    if (!with_picture) return out;
    if (state.reference.count == 1) imprint::forget(state.imprint);
    learn_empty(state, config, *luma, field, state.reference.first, out.timestamp);
    return out;
  }

  displacement::update(config.displacement, field, state.reference.rest, state.reference.pitch, state.saturations,
                       state.displacement);
  if (config.with_load) out.load = load::update(config.load, state.displacement, state.load_saturations);
  out.features =
      features::update(state.features, config.features, state.displacement, out.timestamp, state.saturations);
  if (config.with_field) {
    out.features.field =
        field_features::update(state.field, config.field, state.displacement, out.timestamp, state.saturations);
  }
  if (with_picture) {
    out.features.imprint = imprint::update(state.imprint, config.imprint, *luma, field, state.reference.rest,
                                           state.reference.pitch, out.timestamp, state.saturations, slips);
  }
  if (with_picture && config.judges_contact) {
    out.contact = contact::update(state.contact, config.contact, state.displacement, out.features.imprint.patches,
                                  state.opening, out.timestamp);
    out.empty = state.contact.empty;
    if (out.empty) imprint::learn_empty(state.imprint, config.imprint);
    follow_drift(state, config);
  }
  state.stopwatch.lap(Task::kFeatures);
  return classify(state, config, out);
}

// Features to request. Nothing slips that does not touch, or is being let go.
Result classify(State& state, const Config& config, Result out) {
  out.referenced = true;
  const bool held = !state.opening && (!out.contact.judged || out.contact.touching);
  out.features.contact = Count::from_raw(held ? 1 : 0);
  const bool raised = state.decision.raised;
  const Features classified = raised ? classifier::while_raised(out.features) : out.features;
  if (!held) state.judging = {};
  out.verdict =
      held ? classifier::judge(state.judging, config.classifier, classified, out.timestamp, raised) : Verdict::kHold;
  out.evidence = evidence::decisive(config.classifier, classified, out.verdict);
  const bool goes_on = raised && held && classifier::goes_on(config.classifier, classified);
  out.request = decision::update(state.decision, config.decision, out.verdict, out.timestamp, goes_on);
  out.run = state.decision.run;
  if (raised && out.verdict != Verdict::kHold) out.verdict = classifier::for_a_step(config.classifier, classified);
  state.stopwatch.lap(Task::kClassify);
  return out;
}

}  // namespace

Result update_markers(State& state, const Config& config, const MarkerField& field, Micros timestamp,
                      std::uint32_t sequence) {
  const Result out = stamped(timestamp, sequence);
  if (const Status s = in_order(state, timestamp); !s.ok()) return rejected(state, out, s);
  state.tracker.field = field;
  return measure(state, config, nullptr, state.decision.raised, out);
}

Result update_features(State& state, const Config& config, const Features& features, GridSize grid, Micros timestamp,
                       std::uint32_t sequence) {
  Result out = stamped(timestamp, sequence);
  if (const Status s = in_order(state, timestamp); !s.ok()) return rejected(state, out, s);
  out.grid = grid;
  out.markers = features.markers;
  out.features = features;
  return classify(state, config, out);
}

Status learn(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame) {
  tracker::reset(state.tracker);
  forget(state);
  LumaView luma;
  if (const Status s = luma_input::update(state.luma, config.luma, jpeg, frame, luma); !s.ok()) return s;
  if (const Status s = tracker::update(state.tracker, config.tracker, luma); !s.ok()) return s;
  if (const Status s = enough(state.tracker.field, config.fault_markers_pct); !s.ok()) return s;
  reference::Config single = config.reference;
  single.frames = 1;
  single.most_bend_permille = 0;  // somebody has chosen it
  if (!reference::update(state.reference, single, state.tracker.field)) return {Reason::kNoLattice};
  tracker::set_home(state.tracker, state.reference.rest);
  if (config.with_imprint) {
    learn_empty(state, config, luma, state.tracker.field, state.reference.rest, frame.timestamp);
  }
  return kOkStatus;
}

void opening(State& state, bool is_opening) {
  state.opening = is_opening;
}

void remember(const State& state, const Config& config, checkpoint::Contents& contents) {
  contents.width = state.luma.width;
  contents.height = state.luma.height;
  contents.pitch_um = config.displacement.pitch_um;
  contents.pitch = state.reference.pitch;
  contents.rest = state.reference.rest;
  contents.first = state.reference.first;
  contents.empty = state.imprint.empty;
}

void resume(State& state, const checkpoint::Contents& contents) {
  forget(state);
  state.resuming = state.resumed = true;
  state.kept_width = contents.width;
  state.kept_height = contents.height;
  state.reference.rest = contents.rest;
  state.reference.first = contents.first;
  state.reference.pitch = contents.pitch;
  state.imprint.empty = contents.empty;
  state.imprint.blind = 0;  // the earlier process could compare: its end is a gap
}

void tare(State& state) {
  const bool confirmed = state.reference.bent;
  forget(state);
  state.reference.confirmed = confirmed;
}

void forget(State& state) {
  state.resuming = state.resumed = false;
  light::forget(state.light);
  reference::forget(state.reference);
  state.reference.confirmed = false;
  features::forget(state.features);
  field_features::forget(state.field);
  imprint::forget(state.imprint);
  contact::forget(state.contact);
  state.judging = {};
  state.decision = {};
}

}  // namespace holdfast::pipeline
