// SPDX-License-Identifier: Apache-2.0
// How others find the markers in the same pictures (knobs.hpp, Rival), and how far off a centre is, theirs or ours.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "toolchain/trade/film.hpp"
#include "toolchain/trade/knobs.hpp"
#include "vision/markers.hpp"

namespace holdfast::trade {

// Centres against the truth, in pixels of a picture 320 wide. `reduction`: pixels of the camera's picture a pixel of
// the working image; centres of pixels are whole numbers.
struct MarkerError {
  void add(scene::PointPx seen_at, scene::PointPx truth, double reduction, int width);
  void add(const MarkerField& field, std::span<const scene::PointPx> truth, double reduction, int width);
  [[nodiscard]] double rms() const;

  double square = 0.0;
  long seen = 0;
  long missed = 0;
};

class RivalTracker {
 public:
  explicit RivalTracker(Rival which);
  ~RivalTracker();
  RivalTracker(const RivalTracker&) = delete;
  RivalTracker& operator=(const RivalTracker&) = delete;

  // One in so many frames is enough for a method that takes that long.
  [[nodiscard]] int every() const;
  void begin(const Film& film);
  void update(std::span<const std::uint8_t> jpeg);
  [[nodiscard]] double decode_us() const;
  // The nearest that was seen counts, within 10 px of 320; missed otherwise.
  void judge(std::span<const scene::PointPx> truth, int width, MarkerError& error) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace holdfast::trade
