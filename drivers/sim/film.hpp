// SPDX-License-Identifier: Apache-2.0
// Pictures of one gel, taken beforehand and shown again and again: empty, and with an object pressed on. Neighbours
// differ by noise, as a sensor's do.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "hal/camera.hpp"

namespace holdfast::sim {

struct Film {
  using Picture = std::vector<std::uint8_t>;

  hal::PixelFormat format = hal::PixelFormat::kLuma8;
  std::int32_t width = 0, height = 0;   // pixels
  std::vector<Picture> empty, held;     // at least one of each
  std::vector<scene::PointPx> markers;  // on the empty gel

  // The frame that shows picture `index` of them, going round. Time and number are the caller's. A sensor repeats no
  // picture: from the second round on luma has noise of its own, drawn into `room`, which the frame
  // borrows. JPEG is repeated as it is.
  [[nodiscard]] hal::Frame frame(bool is_held, std::size_t index, Picture& room) const;
};

// kLuma8: 410x308. kMjpeg: 3280x2464, a quarter of a second of work for each picture. At most `most` of each kind, and
// at most the 30 there are.
[[nodiscard]] Film shoot(hal::PixelFormat format, std::size_t most);

}  // namespace holdfast::sim
