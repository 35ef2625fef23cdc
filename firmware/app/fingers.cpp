// SPDX-License-Identifier: Apache-2.0
#include "app/fingers.hpp"

#include <algorithm>
#include <array>

#include "base/math.hpp"

namespace holdfast::fingers {
namespace {

// The hand's state is the last of these that a finger has: what a robot has to act on comes late.
constexpr std::array kOrder{DeviceState::kOk,   DeviceState::kDegraded, DeviceState::kReference,
                            DeviceState::kBoot, DeviceState::kSlip,     DeviceState::kFault};

bool is_worse(DeviceState one, DeviceState than) {
  return std::ranges::find(kOrder, one) > std::ranges::find(kOrder, than);
}

// The fingers that the lines speak for, finger 0 in bit 0.
std::uint32_t counted(const Hand& hand, const Config& config, Micros now) {
  const std::uint32_t all = (1U << config.fusion.fingers) - 1;
  if (!config.one_may_be_lost) return all;
  std::uint32_t well = 0;
  for (int i = 0; i < config.fusion.fingers; ++i) {
    if (condition_of(hand, config, i, now).state != DeviceState::kFault) well |= 1U << i;
  }
  return well == 0 ? all : well;
}

void join(const Hand& hand, const Config& config, std::uint32_t of, Micros now, Result& out) {
  bool any = false;
  for (int i = 0; i < config.fusion.fingers; ++i) {
    if ((of >> i & 1U) == 0) continue;
    const Condition one = condition_of(hand, config, i, now);
    if (!any || is_worse(one.state, out.hand.state)) {
      out.hand.state = one.state;
      out.hand.reason = one.reason;
    }
    const Micros seen_at = hand.seen_at[idx(i)];
    out.oldest = any ? std::min(out.oldest, seen_at) : seen_at;
    any = true;
  }
}

}  // namespace

Condition condition_of(const Hand& hand, const Config& config, int finger, Micros now) {
  const supervisor::State& one = hand.supervisors[idx(finger)];
  const bool silent =
      one.started && one.device != DeviceState::kFault && supervisor::is_silent(one, config.supervisor, now);
  return silent ? Condition{DeviceState::kFault, Reason::kNoFrame} : Condition{one.device, one.reason};
}

Config config_of(int fingers, const pipeline::Config& pipeline, const supervisor::Config& supervisor) {
  Config config{.pipeline = pipeline, .fusion = {}, .supervisor = supervisor};
  config.fusion.fingers = fingers;
  config.fusion.classifier = pipeline.classifier;
  config.fusion.decision = pipeline.decision;
  return config;
}

Result update(State& state, const Config& config, int finger, JpegDecoder& jpeg, const hal::Frame& frame, Micros now,
              pipeline::Result& seen, const supervisor::Inputs& inputs) {
  seen = pipeline::update(state.fingers[idx(finger)], config.pipeline, jpeg, frame, state.hand.fusion.decision.raised);
  return decide(state.hand, config, finger, seen, now, inputs);
}

Result decide(Hand& hand, const Config& config, int finger, pipeline::Result seen, Micros now,
              const supervisor::Inputs& inputs) {
  Result out;
  if (config.fusion.fingers == 1) {
    hand.request = seen.request;
    out.fused.verdict = out.fused.step = seen.verdict;
  } else if (seen.quality.ok()) {
    out.fused = fusion::update(hand.fusion, config.fusion, finger, seen.referenced, seen.features, seen.timestamp);
    hand.request = out.fused.request;
  }
  out.fused.request = seen.request = hand.request;
  out.finger = supervisor::update(hand.supervisors[idx(finger)], config.supervisor, seen, now, inputs);
  if (out.finger.accepted) {
    hand.accepted |= 1U << finger;
    hand.seen_at[idx(finger)] = seen.timestamp;
  }
  const std::uint32_t of = counted(hand, config, now);
  join(hand, config, of, now, out);
  out.hand.slip = hand.request == GripRequest::kTighten;
  // A slip is the hand's, also where the finger that raised it is not counted.
  if (out.hand.slip && out.hand.state == DeviceState::kOk) {
    out.hand.state = DeviceState::kSlip;
    out.hand.reason = Reason::kSlipDetected;
  }
  // Of one finger the lines look at the age themselves; of two, the other's last frame may have grown old meanwhile.
  const bool young = config.fusion.fingers == 1 || now - out.oldest <= config.oldest_frame;
  out.hand.accepted = out.finger.accepted && (hand.accepted & of) == of && young;
  if (out.hand.accepted) hand.accepted = 0;
  // It rises with an edge of ALIVE only (outputs.hpp): when the finger whose frame comes first is the last to be well,
  // with the frame of the other.
  hand.grip_ok = out.hand.state == DeviceState::kOk && (hand.grip_ok || out.hand.accepted);
  out.hand.grip_ok = hand.grip_ok;
  return out;
}

}  // namespace holdfast::fingers
