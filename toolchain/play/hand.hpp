// SPDX-License-Identifier: Apache-2.0
// A hand's decision over what its fingers' cameras showed, one after the other or at once: a finger's pipeline does not
// depend on the other finger, so that each can be played by itself.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>

#include "app/fingers.hpp"

namespace holdfast::tool {

// What the hand made of a left frame, and of all right ones up to its time.
struct HandFrame {
  fingers::Result result;
  std::array<fusion::Seen, kMaxFingers> seen{};
  std::array<std::optional<pipeline::Result>, kMaxFingers> last{};  // accepted ones
  Micros now{};
};

// Feeds a hand in the order of time: the left's frames as they come, the right's from a recording whose frame
// i + offset shows what the left's frame i does. Of two frames at the same time the right one is first.
class HandPlayer {
 public:
  // `right` outlives the player. `later`: by which its frames come later than their partners.
  HandPlayer(const fingers::Config& config, std::span<const pipeline::Result> right, int offset, Micros later = {})
      : config_(config), right_(right), offset_(offset), later_(later) {}

  // `opening`: the gripper says that it opens.
  [[nodiscard]] const HandFrame& step(const pipeline::Result& left, bool opening = false);

 private:
  void give(int finger, pipeline::Result seen, bool opening);

  fingers::Config config_;
  std::span<const pipeline::Result> right_;
  int offset_;
  Micros later_;
  int left_frames_ = 0;
  std::size_t next_ = 0;         // of the right
  std::optional<Micros> clock_;  // to add to the right's times
  fingers::Hand hand_;
  HandFrame out_;
};

}  // namespace holdfast::tool
