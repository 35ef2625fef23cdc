// SPDX-License-Identifier: Apache-2.0
// Pictures of a gel and camera frames of pictures, for tests that hand them in themselves; and what stands in for
// devices that are not looked at.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "hal/camera.hpp"
#include "tests/support/reference.hpp"
#include "vision/jpeg.hpp"

namespace holdfast::test {

// Something in the middle drags the gel along, so far.
[[nodiscard]] inline reference_model::Picture dragged_gel(double drag_mm, std::uint64_t seed) {
  const scene::PictureConfig view = scene::cropped_320x240();
  return reference_model::picture_of(
      view, reference_model::lattice_px({}, view, reference_model::gaussian({0.4, -0.3}, 4.0, drag_mm, 0.3 * drag_mm)),
      seed);
}

// Pictures of the empty gel, then those of a drag that grows over six of them and stays.
[[nodiscard]] inline std::vector<reference_model::Picture> drag_film(int still, int dragged = 0) {
  std::vector<reference_model::Picture> film;
  film.reserve(static_cast<std::size_t>(still + dragged));
  for (int k = 0; k < still + dragged; ++k) {
    film.push_back(dragged_gel(std::clamp(0.3 * (k - still + 1), 0.0, 1.8), 300 + static_cast<std::uint64_t>(k)));
  }
  return film;
}

// `pictures` outlive them.
[[nodiscard]] inline std::vector<LumaView> luma_views(const std::vector<reference_model::Picture>& pictures) {
  std::vector<LumaView> views;
  views.reserve(pictures.size());
  for (const reference_model::Picture& picture : pictures) views.push_back(picture.view());
  return views;
}

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

// Stands for a decoder: gives the picture that it is told to, and remembers what it was asked.
class PictureJpeg : public JpegDecoder {
 public:
  reference_model::Picture picture;
  Status status;
  DecodeScale asked = DecodeScale::kFull;
  int calls = 0;
  std::function<void()> meanwhile = [] {};

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> /*bytes*/, DecodeScale scale, LumaBuffer& out) override {
    asked = scale;
    ++calls;
    meanwhile();
    if (!status.ok()) return status;
    out.width = picture.width;
    out.height = picture.height;
    std::copy(picture.pixels.begin(), picture.pixels.end(), out.pixels.begin());
    return status;
  }
};

// Where every frame is luma.
class NoJpeg final : public JpegDecoder {
 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> /*bytes*/, DecodeScale /*scale*/,
                                 LumaBuffer& /*out*/) override {
    return {Reason::kJpegDamaged};
  }
};

// A camera that does not open.
class NoCamera final : public hal::Camera {
  [[nodiscard]] bool do_start() override { return false; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& /*frame*/, std::chrono::microseconds /*timeout*/) override {
    return hal::Capture::kGone;
  }
  void do_release(const hal::Frame& /*frame*/) override {}
  void do_stop() override {}
};

}  // namespace holdfast::test
