// SPDX-License-Identifier: Apache-2.0
// The grasps on which settings are compared, made once and shown to every setting: some as the sensor's camera films
// them (3280x2464 JPEG, noise and all), many as the markers that a perfect tracker would hand on. Truth beside both.
//
// Which: the filmed ones are chosen by hand, two that slip, two that do not although they are moved alike, one that is
// shaken and one that creeps; the others are every so many-th of a plan (learn/plan.hpp) with seeds that no committed
// tree has learned from.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "tactile/types.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/learn/plan.hpp"
#include "vision/markers.hpp"

namespace holdfast::trade {

struct Shot {
  Micros time{};
  std::vector<std::uint8_t> jpeg;
  std::vector<scene::PointPx> markers;  // true centres in pixels of the picture, index = row * cols + col
  DisplacementField moved;              // true
};
struct Film {
  learn::Trial trial;
  std::vector<learn::Label> labels;  // one a shot
  int width = 0, height = 0;
  std::vector<Shot> shots;
};

struct Sight {
  Micros time{};
  MarkerField markers;  // pixels of the working image of mode fast, Q8
  DisplacementField moved;
};
struct Grasp {
  learn::Trial trial;
  std::vector<learn::Label> labels;
  std::vector<Sight> sights;
};

inline constexpr int kFilms = 6;
inline constexpr int kPictureWidth = 3280;  // of the sensor's camera
[[nodiscard]] int picture_height(int width);
// `which`: 0 .. kFilms - 1; 90 MB each of the camera's size. `go_on` is asked before each picture; false ends the film
// there.
[[nodiscard]] Film shoot(int which, int picture_width = kPictureWidth, const std::function<bool()>& go_on = {});

// The names of every so many-th of the planned grasps, and of others for who learns (learned.hpp); one of them played.
[[nodiscard]] std::vector<learn::PlannedGrasp> planned_grasps(int every);
[[nodiscard]] std::vector<learn::PlannedGrasp> grasps_to_learn_from(int every);
[[nodiscard]] Grasp play(const learn::PlannedGrasp& grasp);

}  // namespace holdfast::trade
