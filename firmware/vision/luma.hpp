// SPDX-License-Identifier: Apache-2.0
// 8-bit luma pictures: a borrowed view and a picture of fixed capacity.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace holdfast {

// The largest working image: the camera's 3280x2464 decoded at 1/2 (mode precise).
inline constexpr std::int32_t kMaxLumaWidth = 1640;
inline constexpr std::int32_t kMaxLumaHeight = 1232;
inline constexpr std::int32_t kMaxLumaPixels = kMaxLumaWidth * kMaxLumaHeight;
// Below this no lattice of dots can be told apart: a dot would be smaller than two pixels.
inline constexpr std::int32_t kMinLumaWidth = 64;
inline constexpr std::int32_t kMinLumaHeight = 48;

// Shape: height rows of width pixels, `stride` bytes from row to row. Borrowed, never owned.
struct LumaView {
  const std::uint8_t* data = nullptr;
  std::int32_t width = 0;
  std::int32_t height = 0;
  std::int32_t stride = 0;

  [[nodiscard]] const std::uint8_t* row(std::int32_t y) const { return data + static_cast<std::ptrdiff_t>(y) * stride; }
};

// A picture whose memory is part of the state that holds it.
struct LumaBuffer {
  std::int32_t width = 0;
  std::int32_t height = 0;
  std::array<std::uint8_t, kMaxLumaPixels> pixels;

  [[nodiscard]] LumaView view() const { return {pixels.data(), width, height, width}; }
};

}  // namespace holdfast
