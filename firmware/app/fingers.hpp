// SPDX-License-Identifier: Apache-2.0
// A hand of one or two fingers: each with its own camera, tracker, features, rest position and health, and one decision
// for all (slip/fusion.hpp). One thread calls decide() with whichever camera's frame has come.
//
// GRIP_OK of the hand is HIGH only while every finger is OK; the worst state counts, with its reason. ALIVE toggles
// when every finger had an accepted frame since it last did, each still young enough to be confirmed; GRIP_OK rises
// with such an edge. A finger that is silent for `supervisor.hold` is at FAULT, whether its turn comes or not. With
// `one_may_be_lost` all this is asked of the fingers that are not at FAULT, unless all are.
// A contact that one finger loses is reported as with one finger, whatever the other touches.
// The JPEG decoder and its threads are shared: frames are decoded one after the other.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "app/pipeline.hpp"
#include "app/supervisor.hpp"
#include "hal/camera.hpp"
#include "slip/fusion.hpp"
#include "vision/jpeg.hpp"

namespace holdfast::fingers {

inline constexpr std::array<std::string_view, kMaxFingers> kNames{"left", "right"};

struct Config {
  pipeline::Config pipeline;  // of each finger
  fusion::Config fusion;      // fusion.fingers: how many there are
  supervisor::Config supervisor;
  bool one_may_be_lost = false;  // go on with one finger while the other is at FAULT
  Micros oldest_frame{150'000};  // as outputs::Config; older ones move no ALIVE
};
// The fusion decides by the model, and as steadily, as a finger would.
[[nodiscard]] Config config_of(int fingers, const pipeline::Config& pipeline, const supervisor::Config& supervisor);

// What decides for the hand, beside the fingers' own pipelines.
struct Hand {
  fusion::State fusion;
  GripRequest request = GripRequest::kHold;
  std::array<supervisor::State, kMaxFingers> supervisors{};
  std::uint32_t accepted = 0;                 // fingers with an accepted frame since ALIVE toggled, finger 0 in bit 0
  std::array<Micros, kMaxFingers> seen_at{};  // the start of exposure of each finger's last accepted frame
  bool grip_ok = false;                       // as it was decided last
};

struct State {
  std::array<pipeline::State, kMaxFingers> fingers;
  Hand hand;
};

struct Result {
  fusion::Result fused;
  supervisor::Outputs finger;  // what the finger's own state is now, with the hand's request
  supervisor::Outputs hand;    // what the lines say
  Micros oldest{};             // start of exposure of the oldest frame that `hand` follows from
};

// One frame of one camera, from picture to lines. `seen`: what the finger made of it. `inputs`: the finger's.
[[nodiscard]] Result update(State& state, const Config& config, int finger, JpegDecoder& jpeg, const hal::Frame& frame,
                            Micros now, pipeline::Result& seen, const supervisor::Inputs& inputs = {});

// The same from what a finger made of its frame. Range: 0 <= finger < fusion.fingers.
// Of one finger the verdict is its pipeline's own.
[[nodiscard]] Result decide(Hand& hand, const Config& config, int finger, pipeline::Result seen, Micros now,
                            const supervisor::Inputs& inputs = {});

// How a finger is now, its silence included: nobody calls for one whose camera is silent.
struct Condition {
  DeviceState state = DeviceState::kBoot;
  Reason reason = Reason::kNone;
};
[[nodiscard]] Condition condition_of(const Hand& hand, const Config& config, int finger, Micros now);

}  // namespace holdfast::fingers
