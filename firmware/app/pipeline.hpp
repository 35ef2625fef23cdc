// SPDX-License-Identifier: Apache-2.0
// The whole product in one call: a camera frame in, a grip request out. pipeline.cpp spells it in three steps:
// update() to the markers, measure() to the features, classify() to the request.
#pragma once

#include "app/freshness.hpp"
#include "app/timing.hpp"
#include "base/status.hpp"
#include "base/units.hpp"
#include "hal/camera.hpp"
#include "slip/classifier.hpp"
#include "slip/decision.hpp"
#include "slip/evidence.hpp"
#include "store/checkpoint.hpp"
#include "tactile/contact.hpp"
#include "tactile/displacement.hpp"
#include "tactile/features.hpp"
#include "tactile/field_features.hpp"
#include "tactile/imprint.hpp"
#include "tactile/load.hpp"
#include "tactile/reference.hpp"
#include "tactile/types.hpp"
#include "vision/jpeg.hpp"
#include "vision/light.hpp"
#include "vision/luma_input.hpp"
#include "vision/tracker.hpp"

namespace holdfast::pipeline {

struct Config {
  luma_input::Config luma;
  light::Config light;
  tracker::Config tracker;
  reference::Config reference;
  displacement::Config displacement;
  features::Config features;
  field_features::Config field;
  imprint::Config imprint;
  contact::Config contact;
  load::Config load;
  bool with_load = true;  // read the forces: Result::load; nothing else depends on them
  // Compute Features::field and Features::imprint; price: tests/checks/frame_cost.cpp.
  bool with_field = classifier::needs({}, Stage::kField);
  bool with_imprint = classifier::needs({}, Stage::kImprint);
  // Contact gates the verdict, and the empty gel is learned on and followed, where the model reads the picture: not
  // where its features are only recorded.
  bool judges_contact = classifier::needs({}, Stage::kImprint);
  classifier::Config classifier;
  decision::Config decision;
  // Let the rest position follow a gel that nobody touches (reference::follow). Not in a recording, whose reference
  // somebody has chosen.
  bool follow_drift = false;
  // Refuse a picture that was shown before. Not of a recording, which may be played again.
  bool must_be_fresh = false;
  // Fewer valid markers than this share of the grid: the frame tells nothing about the grip.
  int fault_markers_pct = 71;  // 45 of 63
};

// Everything that lives from frame to frame. One static object; its size is the firmware's memory (app.hpp).
struct State {
  luma_input::State luma;
  light::State light;
  tracker::State tracker;
  freshness::State freshness;
  reference::State reference;
  DisplacementField displacement;
  features::State features;
  field_features::State field;
  imprint::State imprint;
  contact::State contact;
  classifier::State judging;
  decision::State decision;
  Saturations saturations;
  Saturations load_saturations;  // of what is only shown: apart, so that the other one is the decision's
  bool opening = false;
  std::int32_t kept_width = 0, kept_height = 0;  // of the picture that it was learned from
  bool resuming = false;  // reference.rest is an earlier process's and waits for a picture that fits it
  bool resumed = false;   // it is an earlier process's, as far as is known
  Micros last_timestamp{};
  bool any_frame = false;
  timing::Stopwatch stopwatch;  // without a clock (App gives it one) it counts nothing
};

// What one frame said. `quality` not ok: the frame was rejected and everything below it but `request` is void.
struct Result {
  Micros timestamp{};
  std::uint32_t sequence = 0;
  Status quality;
  bool referenced = false;     // displacement and features refer to a learned rest position
  bool light_changed = false;  // learning began anew because of it, and has not ended yet
  bool bent = false;           // the rest position was refused, because something presses on the gel
  int markers = 0;             // valid now
  GridSize grid;
  Features features;
  contact::Contact contact;
  load::Load load;
  bool empty = false;  // nothing touches the gel, and has not for half a second; false where nobody can tell
  Verdict verdict = Verdict::kHold;          // of this frame; while slip is raised, whether the grip is to step further
  Evidence evidence = Evidence::kNone;       // that decided this frame's slip
  int run = 0;                               // frames in a row that said slip, up to Config::decision.raise_frames
  GripRequest request = GripRequest::kHold;  // kept from the frame before when this one is rejected
};

// `hand_slips`: the slip of a hand is raised, by whichever finger.
[[nodiscard]] Result update(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame,
                            bool hand_slips = false);

// The same from the markers on, or from the features on: for a simulation that leaves the picture out. Markers in
// pixels of any picture; they become `state.tracker.field`.
[[nodiscard]] Result update_markers(State& state, const Config& config, const MarkerField& field, Micros timestamp,
                                    std::uint32_t sequence);
[[nodiscard]] Result update_features(State& state, const Config& config, const Features& features, GridSize grid,
                                     Micros timestamp, std::uint32_t sequence);

// Takes this one frame as the picture of the empty gel (tool `holdfast replay --reference`): registers the lattice
// anew and learns the rest position from it.
[[nodiscard]] Status learn(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame);

// The gripper opens, until it says that it no longer does (OPENING): what moves now is let go, not lost. No verdict but
// hold, and the end of the contact is a release.
void opening(State& state, bool is_opening);

// What another process needs to go on with this one's rest position and empty gel. Range: a rest position is known.
void remember(const State& state, const Config& config, checkpoint::Contents& contents);
// Goes on with what an earlier process learned, once a picture shows the same lattice not far from there; the first one
// that does not ends the attempt, and the rest position is learned.
void resume(State& state, const checkpoint::Contents& contents);

// Forgets the rest position (TARE): the next still frames teach it anew. Where one was refused as bent, whoever says
// TARE confirms that the gel is empty, and the next one is taken as it is.
void tare(State& state);
// The same where nobody says that the gel is empty: the rest position is learned with other settings.
void forget(State& state);

}  // namespace holdfast::pipeline
