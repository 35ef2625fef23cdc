// SPDX-License-Identifier: Apache-2.0
#include "link/evidence_frame.hpp"

#include <limits>

namespace holdfast::evidence_frame {
namespace {

template <typename Wire>
Wire cut(std::int64_t value) {
  using Limits = std::numeric_limits<Wire>;
  return static_cast<Wire>(std::clamp<std::int64_t>(value, Limits::min(), Limits::max()));
}

}  // namespace

EvidenceFrame frame_of(std::uint16_t sequence, const evidence::Shown& shown, const contact::Contact& contact,
                       const ImprintFeatures& imprint, std::int32_t run) {
  EvidenceFrame frame{};
  frame.sequence = sequence;
  frame.contact =
      contact.judged ? static_cast<std::uint8_t>(contact::phase_of(contact, imprint.growth)) : kContactUnknown;
  frame.evidence = static_cast<std::uint8_t>(shown.evidence);
  frame.unit = unit_of(shown.unit);
  frame.run = cut<std::uint8_t>(run);
  frame.patches = cut<std::uint16_t>(imprint.patches.raw());
  frame.value_milli = cut<std::int32_t>(shown.value_milli);
  frame.threshold_milli = cut<std::int32_t>(shown.threshold_milli);
  frame.motion_log2_um_q8 = cut<std::int16_t>(imprint.motion.raw());
  frame.coarse_log2_um_q8 = cut<std::int16_t>(imprint.coarse.raw());
  frame.growth_log2_q8 = cut<std::int16_t>(imprint.growth.raw());
  return frame;
}

std::size_t encode(const EvidenceFrame& frame, std::span<std::uint8_t, kWireBytes> wire) {
  return link::encode(kFields, frame, wire);
}

std::optional<EvidenceFrame> read(const link::Payload& payload) {
  EvidenceFrame frame;
  if (link::read(kFields, payload, frame) != link::DecodeError::kNone) return std::nullopt;
  return frame;
}

}  // namespace holdfast::evidence_frame
