// SPDX-License-Identifier: Apache-2.0
// A hand of one or two fingers: each with its own camera, tracker, features, rest position and health, and one decision
// for all (slip/fusion.hpp). One thread calls update() with whichever camera's frame has come.
//
// GRIP_OK of the hand is HIGH only while every finger is OK; the worst state counts, with its reason. ALIVE toggles
// when every finger had an accepted frame since it last did, so that the receiver's 150 ms hold for each of them.
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

using fusion::kMaxFingers;
inline constexpr std::array<std::string_view, kMaxFingers> kNames{"left", "right"};

struct Config {
  pipeline::Config pipeline;  // of each finger
  fusion::Config fusion;      // fusion.fingers: how many there are
  supervisor::Config supervisor;
};
// The fusion decides by the model, and as steadily, as a finger would.
[[nodiscard]] Config config_of(int fingers, const pipeline::Config& pipeline, const supervisor::Config& supervisor);

// What decides for the hand, beside the fingers' own pipelines.
struct Hand {
  fusion::State fusion;
  GripRequest request = GripRequest::kHold;
  std::array<supervisor::State, kMaxFingers> supervisors{};
  std::uint32_t accepted = 0;  // fingers with an accepted frame since ALIVE toggled, finger 0 in bit 0
};

struct State {
  std::array<pipeline::State, kMaxFingers> fingers;
  Hand hand;
};

struct Result {
  fusion::Result fused;
  supervisor::Outputs finger;  // what the finger's own state is now, with the hand's request
  supervisor::Outputs hand;    // what the lines say
};

// One frame of one camera, from picture to lines. `seen`: what the finger made of it. `inputs`: the finger's.
[[nodiscard]] Result update(State& state, const Config& config, int finger, JpegDecoder& jpeg, const hal::Frame& frame,
                            Micros now, pipeline::Result& seen, const supervisor::Inputs& inputs = {});

// The same from what a finger made of its frame. Range: 0 <= finger < fusion.fingers.
[[nodiscard]] Result decide(Hand& hand, const Config& config, int finger, pipeline::Result seen, Micros now,
                            const supervisor::Inputs& inputs = {});

}  // namespace holdfast::fingers
