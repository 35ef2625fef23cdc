// SPDX-License-Identifier: Apache-2.0
// What must hold of our JPEG decoder for any bytes at all; the same judge for the fuzzer, its seeds and its findings.
//
// 1. What we accept, libjpeg-turbo accepts without a warning, and every pixel is the same.
// 2. What we refuse, it refuses or warns of; or we know why we are stricter: see kStricter in jpeg_check.cpp.
// The decoder's state goes from input to input, as it goes from frame to frame in the camera.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "tests/support/host_jpeg_streams.hpp"
#include "vision/jpeg_dc.hpp"

namespace holdfast::test {

class JpegCheck {
 public:
  // What does not hold, in words; empty when all is well.
  [[nodiscard]] std::string check(std::span<const std::uint8_t> bytes);
  // Inputs that we accepted, so that a caller can tell whether anything was compared.
  [[nodiscard]] long accepted() const { return accepted_; }

 private:
  [[nodiscard]] std::string check_plain(std::span<const std::uint8_t> bytes, jpeg_dc::State& state);

  std::unique_ptr<jpeg_dc::State> state_ = std::make_unique<jpeg_dc::State>();
  std::unique_ptr<LumaBuffer> out_ = std::make_unique<LumaBuffer>();
  Oracle oracle_;
  long accepted_ = 0;
};

}  // namespace holdfast::test
