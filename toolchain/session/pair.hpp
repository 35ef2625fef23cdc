// SPDX-License-Identifier: Apache-2.0
// Two recordings of one grasp, of its left and its right finger, and what the hand decides. A finger's pipeline does
// not depend on the other finger, so that each recording is played by itself and the decision follows from what came
// out.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "app/fingers.hpp"
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

// What the hand made of a left frame, and of all right ones up to its time.
struct HandFrame {
  fingers::Result result;
  std::array<fusion::Seen, fingers::kMaxFingers> seen{};
  std::array<std::optional<pipeline::Result>, fingers::kMaxFingers> last{};  // accepted ones
  Micros now{};
};

// Feeds a hand in the order of time: the left's frames as they come, the right's from a recording whose frame
// i + offset shows what the left's frame i does. Of two frames at the same time the right one is first.
class HandPlayer {
 public:
  // `right` outlives the player.
  HandPlayer(const fingers::Config& config, std::span<const pipeline::Result> right, int offset)
      : config_(config), right_(right), offset_(offset) {}

  // `opening`: the gripper says that it opens.
  [[nodiscard]] const HandFrame& step(const pipeline::Result& left, bool opening = false);

 private:
  void give(int finger, pipeline::Result seen, bool opening);

  fingers::Config config_;
  std::span<const pipeline::Result> right_;
  int offset_;
  int left_frames_ = 0;
  std::size_t next_ = 0;         // of the right
  std::optional<Micros> later_;  // the left's clock over the right's
  fingers::Hand hand_;
  HandFrame out_;
};

// The hand's slip for each left frame.
[[nodiscard]] std::vector<std::uint8_t> fused_slip(const fingers::Config& config, const FingerTrack& left,
                                                   const FingerTrack& right, int offset);

// What the table of features says of both fingers in addition: ",left_strength,...".
[[nodiscard]] std::string hand_columns();
[[nodiscard]] std::string hand_cells(const HandFrame& frame, const classifier::Config& model);

}  // namespace holdfast::tool
