// SPDX-License-Identifier: Apache-2.0
// Two recordings of one grasp, of its left and its right finger, and what the hand decides. A finger's pipeline does
// not depend on the other finger, so that each recording is played by itself and the decision follows from what came
// out.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "app/fingers.hpp"
#include "toolchain/play/hand.hpp"
#include "toolchain/session/replay.hpp"

namespace holdfast::tool {

// What each frame of one finger's recording came to, without the other.
struct FingerTrack {
  std::vector<pipeline::Result> frames;
  std::vector<std::uint8_t> slip;  // the decision of this finger alone, one a frame
};
// Empty, or an error line.
[[nodiscard]] std::string play_finger(const ReplayOptions& options, FingerTrack& track);
// Of the markers' mean, um/s; 0 where it is not known.
[[nodiscard]] std::vector<double> speeds_of(std::span<const pipeline::Result> frames);

// The hand's slip for each left frame.
[[nodiscard]] std::vector<std::uint8_t> fused_slip(const fingers::Config& config, const FingerTrack& left,
                                                   const FingerTrack& right, int offset);

// What the table of features says of both fingers in addition: ",left_strength,...".
[[nodiscard]] std::string hand_columns();
[[nodiscard]] std::string hand_cells(const HandFrame& frame, const classifier::Config& model);

}  // namespace holdfast::tool
