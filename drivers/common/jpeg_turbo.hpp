// SPDX-License-Identifier: Apache-2.0
// JPEG pictures to luma by libjpeg-turbo, behind the firmware's seam: the modes balanced and precise.
//
// Grey, YCbCr and RGB pictures of one scan, sequential, Huffman coded, 8 bits; anything else (CMYK, YCCK, two
// components, progressive, several scans, arithmetic coding, 12 bits) is kFrameFormat. Scaled by the library's reduced
// inverse transform (islow), which for luma needs neither upsampling nor smoothing. Every error and every *warning* is
// kJpegDamaged: see vision/jpeg.hpp for what carrying on costs.
//
// No picture leaves anything to the next: tables that a picture does not bring are the library's standard ones (T.81
// annex K, as UVC cameras leave them out), never those of a picture before, which may have been damaged.
//
// Memory: all in the object. The constructor uses the heap, decode() does not, on the thread that made the object (the
// library probes the processor once per thread, on aarch64 through the heap); its pools are two arenas of fixed size.
// Why two: the library itself gives back what the decoding of a picture took, but keeps tables and source. It asks for
// strips of the picture, not for whole ones, so its need is bounded by the width, and the width by kMaxLumaWidth. A
// full arena is kPictureTooLarge.
#pragma once

#include <cstddef>
#include <memory>

#include "vision/jpeg.hpp"

namespace holdfast::drivers {

class TurboJpegDecoder final : public JpegDecoder {
 public:
  // Bytes of the arena for what the headers bring, and of that for what the decoding of a picture needs.
  struct Memory {
    std::size_t tables = 0;
    std::size_t picture = 0;
  };
  static constexpr Memory kMemory{8 * 1024, 256 * 1024};

  // The library ends the process with its own words when it cannot start: no memory, or not the version built for.
  TurboJpegDecoder();
  ~TurboJpegDecoder() override;
  TurboJpegDecoder(const TurboJpegDecoder&) = delete;
  TurboJpegDecoder& operator=(const TurboJpegDecoder&) = delete;

  // The most that any picture has taken, at most kMemory.
  [[nodiscard]] Memory most_used() const;

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) override;

  struct Library;
  std::unique_ptr<Library> library_;
};

}  // namespace holdfast::drivers
