// SPDX-License-Identifier: Apache-2.0
// Camera frames from pictures, for tests that hand them in themselves.
#pragma once

#include <cstdint>
#include <span>

#include "hal/camera.hpp"
#include "tests/support/reference.hpp"
#include "vision/jpeg.hpp"

namespace holdfast::test {

// `picture` outlives the frame.
[[nodiscard]] inline hal::Frame frame_of(const reference_model::Picture& picture) {
  hal::Frame frame;
  frame.bytes = picture.pixels;
  frame.format = hal::PixelFormat::kLuma8;
  frame.width = picture.width;
  frame.height = picture.height;
  frame.stride = picture.width;
  return frame;
}

// Where every frame is luma.
class NoJpeg final : public JpegDecoder {
 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> /*bytes*/, DecodeScale /*scale*/,
                                 LumaBuffer& /*out*/) override {
    return {Reason::kJpegDamaged};
  }
};

}  // namespace holdfast::test
