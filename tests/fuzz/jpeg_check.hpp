// SPDX-License-Identifier: Apache-2.0
// What must hold of our JPEG decoder for any bytes at all; the same judge for the fuzzer, its seeds and its findings.
//
// 1. What we accept, libjpeg-turbo accepts without a warning, and every pixel is the same.
// 2. What we refuse, it refuses or warns of; or we know why we are stricter: see kStricter in jpeg_check.cpp.
// 3. The fast walk says the same, however the picture is cut, and so it does of its upper rows alone.
// The decoder's state goes from input to input, as it goes from frame to frame in the camera.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "tests/support/host_jpeg_streams.hpp"
#include "vision/jpeg_dc.hpp"
#include "vision/jpeg_fast.hpp"

namespace holdfast::test {

class JpegCheck {
 public:
  // What does not hold, in words; empty when all is well.
  [[nodiscard]] std::string check(std::span<const std::uint8_t> bytes);
  // Inputs that we accepted, so that a caller can tell whether anything was compared.
  [[nodiscard]] long accepted() const { return accepted_; }

 private:
  [[nodiscard]] std::string check_plain(std::span<const std::uint8_t> bytes, jpeg_dc::State& state);
  // `out_` and `state_` hold the plain walk's answer.
  [[nodiscard]] std::string check_fast(std::span<const std::uint8_t> bytes);

  std::unique_ptr<jpeg_dc::State> state_ = std::make_unique<jpeg_dc::State>();
  std::unique_ptr<jpeg_fast::State> fast_state_ = std::make_unique<jpeg_fast::State>();
  std::vector<jpeg_fast::Worker> workers_ = std::vector<jpeg_fast::Worker>(2);
  std::unique_ptr<LumaBuffer> fast_out_ = std::make_unique<LumaBuffer>();
  std::unique_ptr<LumaBuffer> out_ = std::make_unique<LumaBuffer>();
  Oracle oracle_;
  long accepted_ = 0;
};

}  // namespace holdfast::test
