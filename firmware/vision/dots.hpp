// SPDX-License-Identifier: Apache-2.0
// Finds dark blobs of the size of printed dots anywhere in the picture.
//
// Used to register the lattice at start and to find markers again that the windows lost; not once per frame.
// Method: shrink by block means to at most 512x400, subtract each pixel from its local mean (box filter: takes
// out shading from three coloured lights), threshold, connected components by runs, keep those that look like
// discs. The threshold comes from the picture itself, so contrast and exposure may differ between sensors.
// Centres are good to about 0.3 px; window.hpp refines them.
#pragma once

#include <array>
#include <cstdint>

#include "base/status.hpp"
#include "base/units.hpp"
#include "vision/luma.hpp"
#include "vision/markers.hpp"

namespace holdfast::dots {

inline constexpr std::int32_t kMaxWidth = 512;
inline constexpr std::int32_t kMaxHeight = 400;
inline constexpr int kMaxBlobs = 4096;

struct Config {
  // Radius of the local mean in parts of the picture's width; at least the radius of a dot, or dots turn hollow.
  // Price: none in time; too large lets shading through, too small hollows the dots.
  std::int32_t box_divisor = 20;
};

struct Dot {
  PixelsQ8 x;             // working image
  PixelsQ8 y;             // working image
  std::int32_t area = 0;  // pixels of the shrunken picture above the threshold
  bool cut = false;       // touches the edge of the picture: centre biased inwards
};

struct Dots {
  std::int32_t width = 0;  // of the picture that they were found in
  std::int32_t height = 0;
  int count = 0;
  std::array<Dot, kMaxDots> dots{};
};

struct Blob {
  std::int32_t area = 0;
  std::int32_t weight = 0;    // sum of (local mean - luma)
  std::int64_t weight_x = 0;  // the same times x
  std::int64_t weight_y = 0;
  std::int16_t left = 0, right = 0, top = 0, bottom = 0;
  std::int16_t parent = 0;  // union-find; parent == own index for a root
};

struct State {
  std::array<std::uint8_t, kMaxWidth * kMaxHeight> small;  // shrunken luma
  std::array<std::uint8_t, kMaxWidth * kMaxHeight> depth;  // local mean minus luma, clamped to 0..255
  std::array<std::uint32_t, kMaxWidth> columns;            // running column sums
  struct Run {
    std::int16_t begin = 0, end = 0;  // pixels [begin, end)
    std::int16_t blob = 0;
  };
  std::array<std::array<Run, kMaxWidth / 2 + 1>, 2> runs;  // this row's and the one above
  std::array<Blob, kMaxBlobs> blobs;
};

// Range: a picture of kMinLuma..kMaxLuma size. kDotsOverflow: more blobs than a gel can show.
[[nodiscard]] Status detect(State& state, const Config& config, const LumaView& luma, Dots& out);

}  // namespace holdfast::dots
