// SPDX-License-Identifier: Apache-2.0
// Pictures to baseline JPEG as a UVC camera sends it: 4:2:2 (chroma halved across, not down), one scan,
// standard Huffman tables, no restart markers. Host only (libjpeg).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace holdfast::scene {

enum class JpegInput : std::uint8_t {
  kRgb,   // 3 interleaved bytes per pixel, sent as YCbCr 4:2:2
  kGrey,  // 1 byte per pixel, sent as a single component
};

// Shape: `pixels` holds height rows of width pixels without padding. Range: width and height 1..65500,
// quality 1..100. Empty result: a size out of range, too few pixels, or no memory.
[[nodiscard]] std::vector<std::uint8_t> encode_jpeg(std::span<const std::uint8_t> pixels, int width, int height,
                                                    JpegInput input, int quality);

}  // namespace holdfast::scene
