// SPDX-License-Identifier: Apache-2.0
#include "app/fingers.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

#include "app/app.hpp"
#include "base/math.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::fingers {

// Beside a device of one finger a hand has another pipeline and its own few bytes; the decoder is shared.
constexpr std::size_t kOneFinger = sizeof(App) + sizeof(EighthDecoder) + sizeof(jpeg_fast::Worker);
static_assert((kOneFinger + sizeof(State) - sizeof(pipeline::State)) * 10 <= kOneFinger * 19, "1.9 of one finger");

namespace {

// The hand's state is the last of these that a finger has: what a robot has to act on comes late.
constexpr std::array kOrder{DeviceState::kOk,   DeviceState::kDegraded, DeviceState::kReference,
                            DeviceState::kBoot, DeviceState::kSlip,     DeviceState::kFault};

bool is_worse(DeviceState one, DeviceState than) {
  return std::ranges::find(kOrder, one) > std::ranges::find(kOrder, than);
}

supervisor::Outputs worst_of(const Hand& hand, const Config& config, Micros now) {
  supervisor::Outputs out{.state = DeviceState::kOk};
  for (int i = 0; i < config.fusion.fingers; ++i) {
    const supervisor::State& one = hand.supervisors[idx(i)];
    // Nobody calls for a finger whose camera is silent.
    const bool silent =
        one.started && one.device != DeviceState::kFault && supervisor::is_silent(one, config.supervisor, now);
    const DeviceState state = silent ? DeviceState::kFault : one.device;
    if (i > 0 && !is_worse(state, out.state)) continue;
    out.state = state;
    out.reason = silent ? Reason::kNoFrame : one.reason;
  }
  return out;
}

}  // namespace

Config config_of(int fingers, const pipeline::Config& pipeline, const supervisor::Config& supervisor) {
  Config config{.pipeline = pipeline, .fusion = {}, .supervisor = supervisor};
  config.fusion.fingers = fingers;
  config.fusion.classifier = pipeline.classifier;
  config.fusion.decision = pipeline.decision;
  return config;
}

Result update(State& state, const Config& config, int finger, JpegDecoder& jpeg, const hal::Frame& frame, Micros now,
              pipeline::Result& seen, const supervisor::Inputs& inputs) {
  seen = pipeline::update(state.fingers[idx(finger)], config.pipeline, jpeg, frame);
  return decide(state.hand, config, finger, seen, now, inputs);
}

Result decide(Hand& hand, const Config& config, int finger, pipeline::Result seen, Micros now,
              const supervisor::Inputs& inputs) {
  Result out;
  if (seen.quality.ok()) {
    out.fused = fusion::update(hand.fusion, config.fusion, finger, seen.referenced, seen.features, seen.timestamp);
    hand.request = out.fused.request;
  }
  out.fused.request = seen.request = hand.request;
  out.finger = supervisor::update(hand.supervisors[idx(finger)], config.supervisor, seen, now, inputs);
  out.hand = worst_of(hand, config, now);
  out.hand.slip = hand.request == GripRequest::kTighten;
  out.hand.grip_ok = out.hand.state == DeviceState::kOk;  // who raised slip is in SLIP
  if (out.finger.accepted) hand.accepted |= 1U << finger;
  const std::uint32_t all = (1U << config.fusion.fingers) - 1;
  out.hand.accepted = hand.accepted == all;
  if (out.hand.accepted) hand.accepted = 0;
  return out;
}

}  // namespace holdfast::fingers
