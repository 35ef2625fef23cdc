// SPDX-License-Identifier: Apache-2.0
// The seam for the JPEG decoder: bytes of one picture in, luma at 1/8, 1/4 or 1/2 out.
#pragma once

#include <cstdint>
#include <span>

#include "base/status.hpp"
#include "vision/luma.hpp"

namespace holdfast {

// Denominator of the decode scale. The decoded size is ceil(full size / denominator).
// Price: performance of the whole pipeline; see the modes table (params/modes.hpp).
enum class DecodeScale : std::uint8_t { kFull = 1, kHalf = 2, kQuarter = 4, kEighth = 8 };

class JpegDecoder {
 public:
  virtual ~JpegDecoder() = default;
  // Decodes one picture. kJpegDamaged on any error *or warning*: a decoder that carries on after lost payload
  // moves markers in 9 of 10 such frames (measured: 512 bytes lost, 92 %). kPictureTooSmall / kPictureTooLarge
  // when the result does not fit `out`. `out` is undefined unless ok().
  [[nodiscard]] Status decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) {
    return do_decode(bytes, scale, out);
  }

 private:
  [[nodiscard]] virtual Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) = 0;
};

}  // namespace holdfast
