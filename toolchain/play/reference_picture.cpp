// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/reference_picture.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>
#include <variant>

namespace holdfast::tool {

bool names_a_frame(const std::string& reference) {
  return reference == "first" || reference == "last" ||
         (!reference.empty() && reference.find_first_not_of("-+0123456789") == std::string::npos);
}

sim::Result<sim::RecordedFrame> reference_picture(const sim::Recording& recording, const std::string& reference,
                                                  const luma_input::Config& luma) {
  if (names_a_frame(reference)) return recording.at(reference);
  std::error_code ignored;
  if (!std::filesystem::exists(reference, ignored)) {
    return sim::Error{
        fmt::format("{}: no such file, and no name of a frame. Likely cause: a typing error in --reference. Next: give "
                    "first, last, a number from 0, or an image of the empty gel",
                    reference)};
  }
  const sim::RecordingInfo& about = recording.info();
  hal::Frame like{};
  like.format = about.mjpeg ? hal::PixelFormat::kMjpeg : hal::PixelFormat::kLuma8;
  like.width = about.width;
  const auto reduce = about.mjpeg ? luma_input::reduction(luma, like) : static_cast<int>(about.scale);
  auto picture = sim::read_picture(reference, reduce, like.format);
  const auto* frame = std::get_if<sim::RecordedFrame>(&picture);
  if (frame != nullptr && (frame->input_width != about.width || frame->input_height != about.height)) {
    return sim::Error{fmt::format(
        "{}: is {}x{} pixels, but the frames of {} are {}x{}. Likely cause: another sensor, or a picture cropped or "
        "scaled. Next: give a picture of that size, or a frame of the recording",
        reference, frame->input_width, frame->input_height, recording.path().string(), about.width, about.height)};
  }
  return picture;
}

}  // namespace holdfast::tool
