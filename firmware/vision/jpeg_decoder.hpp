// SPDX-License-Identifier: Apache-2.0
// The firmware's JPEG decoder behind the seam: 1/8 by its own walks, other scales by another decoder.
#pragma once

#include <cstdint>
#include <span>

#include "base/status.hpp"
#include "hal/crew.hpp"
#include "vision/jpeg.hpp"
#include "vision/jpeg_dc.hpp"
#include "vision/jpeg_fast.hpp"
#include "vision/luma.hpp"

namespace holdfast {

class EighthDecoder final : public JpegDecoder {
 public:
  enum class Walk : std::uint8_t { kPlain, kFast };
  struct Config {
    // Both give the same samples. Fast takes 1.3 MB more and pays on cores that run several things at once.
    Walk walk = Walk::kFast;
    jpeg_fast::Config fast;
    jpeg_dc::Limits limits;
  };

  // All must outlive this object. `workers`: one for each member of the crew at least; none with the plain walk.
  EighthDecoder(const Config& config, JpegDecoder& other_scales, std::span<jpeg_fast::Worker> workers, hal::Crew& crew)
      : config_(config), other_scales_(other_scales), workers_(workers), crew_(crew) {}

  // Of the last picture at 1/8.
  [[nodiscard]] jpeg_dc::Error last_error() const { return state_.plain.error; }
  [[nodiscard]] const jpeg_fast::Counts& counts() const { return state_.counts; }

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) override {
    if (scale != DecodeScale::kEighth) return other_scales_.decode(bytes, scale, out);
    if (config_.walk == Walk::kPlain) return jpeg_dc::decode(state_.plain, bytes, out, config_.limits);
    return jpeg_fast::decode(state_, config_.fast, workers_, crew_, bytes, out, config_.limits);
  }

  Config config_;
  JpegDecoder& other_scales_;
  std::span<jpeg_fast::Worker> workers_;
  hal::Crew& crew_;
  jpeg_fast::State state_;
};

}  // namespace holdfast
