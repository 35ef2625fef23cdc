// SPDX-License-Identifier: Apache-2.0
// JPEG pictures to luma by libjpeg-turbo, behind the firmware's seam.
//
// Grey, YCbCr and RGB streams; anything else (CMYK, YCCK, two components) is kFrameFormat. Scaled by the
// library's reduced inverse transform (islow), which for luma needs neither upsampling nor smoothing.
// Every error and every *warning* is kJpegDamaged: see vision/jpeg.hpp for what carrying on costs.
// The decompressor is reused from picture to picture; the library allocates its pools on the host's heap.
#pragma once

#include <memory>

#include "vision/jpeg.hpp"

namespace holdfast::sim {

class TurboJpegDecoder final : public JpegDecoder {
 public:
  TurboJpegDecoder();
  ~TurboJpegDecoder() override;
  TurboJpegDecoder(const TurboJpegDecoder&) = delete;
  TurboJpegDecoder& operator=(const TurboJpegDecoder&) = delete;

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) override;

  struct Library;
  std::unique_ptr<Library> library_;
};

}  // namespace holdfast::sim
