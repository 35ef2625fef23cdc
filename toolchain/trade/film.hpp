// SPDX-License-Identifier: Apache-2.0
// The grasps on which settings are compared, made once and shown to every setting as the sensor's camera films them
// (3280x2464 JPEG, noise and all), truth beside. Chosen by hand: two that slip, two that do not although they are moved
// alike, one that is shaken and one that creeps.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "tactile/types.hpp"

namespace holdfast::trade {

struct Shot {
  Micros time{};
  std::vector<std::uint8_t> jpeg;
  std::vector<scene::PointPx> markers;  // true centres in pixels of the picture, index = row * cols + col
  DisplacementField moved;              // true
};
struct Film {
  int width = 0, height = 0;
  std::vector<Shot> shots;
};

inline constexpr int kFilms = 6;
inline constexpr int kPictureWidth = 3280;  // of the sensor's camera
[[nodiscard]] int picture_height(int width);
// `which`: 0 .. kFilms - 1; 90 MB each of the camera's size. `go_on` is asked before each picture; false ends the film
// there.
[[nodiscard]] Film shoot(int which, int picture_width = kPictureWidth, const std::function<bool()>& go_on = {});

}  // namespace holdfast::trade
