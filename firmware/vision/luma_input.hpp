// SPDX-License-Identifier: Apache-2.0
// From the camera's frame to the working image: decodes JPEG at the mode's scale, borrows luma as it is. Pictures in
// which a pixel is a block of the JPEG are asked whether they can be what was sent (picture_check).
#pragma once

#include <cstdint>

#include "base/status.hpp"
#include "hal/camera.hpp"
#include "vision/jpeg.hpp"
#include "vision/luma.hpp"
#include "vision/picture_check.hpp"

namespace holdfast::luma_input {

struct Config {
  DecodeScale scale = DecodeScale::kEighth;
  picture_check::Config check{};
};

struct State {
  LumaBuffer decoded;
  std::int32_t width = 0;  // of the first picture; a stream never changes its size, while the scale stays
  std::int32_t height = 0;
  picture_check::State check;
};

// Another scale.
inline void forget(State& state) {
  state.width = state.height = 0;
}

// Below this width the error of the centres grows fast (measured: it triples under 200 px), so small cameras are
// decoded at a finer scale than the mode asks for.
inline constexpr std::int32_t kLeastWorkingWidth = 300;

// A width that the driver does not know (0) leaves the mode's scale.
[[nodiscard]] constexpr DecodeScale scale_for(DecodeScale asked, std::int32_t full_width) {
  if (full_width <= 0) return asked;
  auto denominator = static_cast<std::int32_t>(asked);
  while (denominator > 1 && full_width / denominator < kLeastWorkingWidth) denominator /= 2;
  return static_cast<DecodeScale>(denominator);
}

// Pixels of the camera's picture per pixel of the working image.
[[nodiscard]] constexpr std::int32_t reduction(const Config& config, const hal::Frame& frame) {
  if (frame.format == hal::PixelFormat::kLuma8) return 1;
  return static_cast<std::int32_t>(scale_for(config.scale, frame.width));
}

// kJpegDamaged (refused by the decoder or by the check), kFrameFormat (size changed or inconsistent), kPictureTooSmall,
// kPictureTooLarge.
[[nodiscard]] inline Status update(State& state, const Config& config, JpegDecoder& jpeg, const hal::Frame& frame,
                                   LumaView& out) {
  const bool mjpeg = frame.format == hal::PixelFormat::kMjpeg;
  const DecodeScale scale = scale_for(config.scale, frame.width);
  if (mjpeg) {
    const Status status = jpeg.decode(frame.bytes, scale, state.decoded);
    if (!status.ok()) return status;
    out = state.decoded.view();
  } else {
    out = {frame.bytes.data(), frame.width, frame.height, frame.stride};
    const bool sound =
        frame.width > 0 && frame.height > 0 && frame.stride >= frame.width &&
        frame.bytes.size() >= static_cast<std::size_t>(frame.height - 1) * static_cast<std::size_t>(frame.stride) +
                                  static_cast<std::size_t>(frame.width);
    if (!sound) return {Reason::kFrameFormat};
  }
  if (out.width < kMinLumaWidth || out.height < kMinLumaHeight) return {Reason::kPictureTooSmall};
  if (out.width > kMaxLumaWidth || out.height > kMaxLumaHeight) return {Reason::kPictureTooLarge};
  if (state.width != 0 && (state.width != out.width || state.height != out.height)) return {Reason::kFrameFormat};
  state.width = out.width;
  state.height = out.height;
  if (!mjpeg || out.width < kLeastWorkingWidth) return kOkStatus;
  return picture_check::update(state.check, config.check, out, 8 / static_cast<std::int32_t>(scale));
}

}  // namespace holdfast::luma_input
