// SPDX-License-Identifier: Apache-2.0
// Window sums against plain double loops, centres against pictures of known truth, and every edge of the picture.
#include "vision/window.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using reference_model::Picture;
using reference_model::Point;

namespace {

constexpr std::array<std::int32_t, 7> kSizes{16, 24, 32, 48, 64, 96, 128};

PixelsQ8 q8(double px) {
  return PixelsQ8::from_raw(static_cast<std::int32_t>(std::lround(px * 256.0)));
}
double px(PixelsQ8 q) {
  return q.raw() / 256.0;
}

// A picture that ends exactly where its heap block ends: the address sanitizer sees a read of one byte more,
// and memory before it belongs to the same exactly sized block.
struct TightPicture {
  std::unique_ptr<std::uint8_t[]> block;
  LumaView view;
  TightPicture(std::int32_t width, std::int32_t height, std::int32_t stride)
      : block(new std::uint8_t[static_cast<std::size_t>((height - 1) * stride + width)]),
        view{block.get(), width, height, stride} {}
  [[nodiscard]] std::size_t bytes() const {
    return static_cast<std::size_t>((view.height - 1) * view.stride + view.width);
  }
};

void check_sums(const LumaView& luma, std::int32_t left, std::int32_t top, std::int32_t size,
                const window::Plane& plane, std::uint8_t cap) {
  const window::Sums got = window::sums(luma.row(top) + left, luma.stride, size, plane, cap);
  // Shifts of negative numbers round down, as the header says.
  const auto tilt = [&](int slope_q9, int at) {
    return static_cast<int>(std::floor(slope_q9 * (2 * at - (size - 1)) / 512.0));
  };
  const auto level = [&](int x, int y) { return plane.level + tilt(plane.slope_x_q9, x) + tilt(plane.slope_y_q9, y); };
  const reference_model::WindowSums want = reference_model::window_sums(luma, left, top, size, level, cap);
  CHECK_TRUE(want.mass == static_cast<double>(got.mass));
  CHECK_TRUE(want.x == static_cast<double>(got.x));
  CHECK_TRUE(want.y == static_cast<double>(got.y));
  const window::Sums plain = window::sums_scalar(luma.row(top) + left, luma.stride, size, plane, cap);
  CHECK_TRUE(plain.mass == got.mass && plain.x == got.x && plain.y == got.y);
}

// t stays within 0..255, as the stage promises itself: at most `room` levels from the middle to a corner, less the
// level that each of the two shifts may round down. 63 levels to a side are what fits 16 bits.
window::Plane plane(std::mt19937_64& random, std::int32_t size, int level) {
  const int room = std::max(0, std::min(level, 255 - level) - 2);
  const int part = static_cast<int>(random() % static_cast<unsigned>(room + 1));
  const auto slope = [&](int levels) {
    return static_cast<std::int16_t>((random() % 2 == 0 ? 1 : -1) * std::min(levels, 63) * 512 / (size - 1));
  };
  return {static_cast<std::uint8_t>(level), slope(part), slope(room - part)};
}

scene::PictureConfig clean(int width = 320) {
  scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
  config.noise_sigma = 0.0;
  config.shading = 0.0;
  return config;
}

}  // namespace

TEST_GROUP(Window){};

TEST(Window, SumsEqualPlainLoopsOnRandomPictures) {
  std::mt19937_64 random(30);
  for (const std::int32_t size : kSizes) {
    for (int round = 0; round < 24; ++round) {
      const std::int32_t stride = size + 5;
      TightPicture picture(size + 3, size + 2, stride);
      const unsigned spread = 1U << (1 + random() % 8);
      for (std::size_t i = 0; i < picture.bytes(); ++i) {
        picture.block[i] = static_cast<std::uint8_t>(random() % spread + (256 - spread) * (random() % 2));
      }
      const auto left = static_cast<std::int32_t>(random() % 4);
      const auto top = static_cast<std::int32_t>(random() % 3);
      const int level = static_cast<int>(random() % 256);
      check_sums(picture.view, left, top, size, plane(random, size, level), static_cast<std::uint8_t>(random()));
    }
  }
}

// Largest sums of all: every weight 255. Smallest: no weight. Lanes must neither wrap nor round.
TEST(Window, SumsEqualPlainLoopsAtTheExtremes) {
  std::mt19937_64 random(31);
  for (const std::int32_t size : kSizes) {
    TightPicture picture(size, size, size);
    for (const int luma : {0, 1, 128, 254, 255}) {
      std::memset(picture.block.get(), luma, picture.bytes());
      for (const int level : {0, 1, 254, 255}) {
        const window::Plane threshold{static_cast<std::uint8_t>(level), 0, 0};
        for (const int cap : {0, 1, 255}) {
          check_sums(picture.view, 0, 0, size, threshold, static_cast<std::uint8_t>(cap));
        }
      }
    }
    // Black and white columns, then rows: the largest sums of x and of y that differ between the lanes.
    for (const bool columns : {true, false}) {
      for (std::size_t i = 0; i < picture.bytes(); ++i) {
        const auto n = static_cast<std::size_t>(size);
        picture.block[i] = (columns ? i % n : i / n) >= n / 2 ? 0 : 255;
      }
      const window::Plane threshold{255, 0, 0};
      check_sums(picture.view, 0, 0, size, threshold, 255);
    }
  }
}

// Against the pixel-exact truth of the renderer without noise. 0.012 px: quantisation of luma (0.3 levels
// over a rim of 75 levels) and of the position (1/512 px) leave less.
TEST(Window, FindsTheCentreOfACleanDot) {
  const scene::PictureConfig config = clean();
  std::mt19937_64 random(32);
  double worst = 0.0;
  for (int round = 0; round < 300; ++round) {
    const Point truth{100.0 + static_cast<double>(random() % 1000) / 1000.0,
                      90.0 + static_cast<double>(random() % 1000) / 1000.0};
    const std::array<Point, 1> dots{truth};
    const Picture picture = reference_model::picture_of(config, dots, 1);
    window::Dot dot{q8(truth.x + static_cast<double>(random() % 80) / 10.0 - 4.0),
                    q8(truth.y + static_cast<double>(random() % 80) / 10.0 - 4.0), 75, 0};
    CHECK_TRUE(window::measure(picture.view(), 24, 4, dot));
    worst = std::max(worst, reference_model::distance(truth, {px(dot.x), px(dot.y)}));
    // Diameter 16.6 px: area 216 px. Contrast 120 - 45 = 75 levels.
    CHECK_TRUE(std::abs(dot.area - 216) <= 20);
    CHECK_TRUE(std::abs(dot.contrast - 75) <= 3);
  }
  CHECK_TRUE(worst <= 0.012);
}

TEST(Window, PicksTheSmallestSizeThatLeavesRoomAroundADot) {
  for (double pitch = 4.0; pitch < 400.0; pitch += 0.37) {
    const std::int32_t size = window::size_for(q8(pitch));
    CHECK_TRUE(std::find(kSizes.begin(), kSizes.end(), size) != kSizes.end());
    for (const std::int32_t other : kSizes) {
      // 0.01 px: the pitch is rounded to 1/256 px.
      if (other < size) CHECK_TRUE(other < 0.70 * pitch + 0.01);
    }
    CHECK_TRUE(size >= 0.70 * pitch - 0.01 || size == window::kMaxSize);
  }
}

TEST(Window, MeasuresAContrastOnlyWhereADotIs) {
  const scene::PictureConfig config = clean();
  const std::array<Point, 1> dots{Point{160.0, 120.0}};
  const Picture picture = reference_model::picture_of(config, dots, 1);
  LONGS_EQUAL(75, window::contrast_at(picture.view(), 24, q8(160.0), q8(120.0)));
  LONGS_EQUAL(0, window::contrast_at(picture.view(), 24, q8(60.0), q8(60.0)));
}

// Nothing to see: false, and the dot untouched.
TEST(Window, RefusesFlatPictures) {
  for (const int level : {0, 1, 10, 127, 128, 254, 255}) {
    const Picture picture = reference_model::flat(320, 240, static_cast<std::uint8_t>(level));
    for (const std::int32_t size : kSizes) {
      for (const std::int32_t contrast : {10, 75, 255}) {
        window::Dot dot{q8(160.0), q8(120.0), contrast, 7};
        CHECK_FALSE(window::measure(picture.view(), size, 4, dot));
        LONGS_EQUAL(160 * 256, dot.x.raw());
        LONGS_EQUAL(120 * 256, dot.y.raw());
        LONGS_EQUAL(contrast, dot.contrast);
        LONGS_EQUAL(7, dot.area);
        LONGS_EQUAL(0, window::contrast_at(picture.view(), size, q8(160.0), q8(120.0)));
      }
    }
  }
}

// Dots on a saturated background (white clips at 255) and dots that clip at black: the rim still decides.
TEST(Window, FindsDotsInSaturatedPictures) {
  for (const double background : {75.0, 255.0, 290.0}) {
    scene::PictureConfig config = clean();
    config.background = background;
    config.dot_level = background > 100.0 ? 180.0 : 0.0;
    const Point truth{150.3, 110.7};
    const std::array<Point, 1> dots{truth};
    const Picture picture = reference_model::picture_of(config, dots, 1);
    window::Dot dot{q8(150.0), q8(111.0), 0, 0};
    dot.contrast = window::contrast_at(picture.view(), 24, dot.x, dot.y);
    CHECK_TRUE(window::measure(picture.view(), 24, 4, dot));
    CHECK_TRUE(reference_model::distance(truth, {px(dot.x), px(dot.y)}) <= 0.05);
  }
}

// Every size, in pictures hardly larger, at places on, beyond and far beyond each edge, over noise, flat and
// stripes. Any read outside the block is an error under the asan preset; everywhere the result must lie
// inside the picture.
TEST(Window, NeverReadsOutsideThePicture) {
  std::mt19937_64 random(33);
  const std::array<double, 9> places{-4096.0, -300.0, -1.0, -0.5, 0.0, 0.5, 1.0, 300.0, 4096.0};
  for (const std::int32_t size : kSizes) {
    for (const std::int32_t extra : {0, 1, 9}) {
      TightPicture picture(size + extra, size + extra / 2, size + extra + (extra == 9 ? 3 : 0));
      for (int kind = 0; kind < 3; ++kind) {
        for (std::size_t i = 0; i < picture.bytes(); ++i) {
          picture.block[i] = static_cast<std::uint8_t>(kind == 0 ? random() : kind == 1 ? 0 : (i / 7 % 2) * 255);
        }
        for (const double place_x : places) {
          for (const double place_y : places) {
            const bool from_far = random() % 2 == 0;
            const double x = std::clamp(from_far ? picture.view.width - 1.0 + place_x : place_x, -4096.0, 4096.0);
            const double y = std::clamp(from_far ? picture.view.height - 1.0 + place_y : place_y, -4096.0, 4096.0);
            window::Dot dot{q8(x), q8(y), static_cast<std::int32_t>(random() % 256), 0};
            const std::int32_t contrast = window::contrast_at(picture.view, size, dot.x, dot.y);
            CHECK_TRUE(contrast >= 0 && contrast <= 255);
            if (!window::measure(picture.view, size, 4, dot)) continue;
            CHECK_TRUE(dot.x.raw() >= 0 && px(dot.x) <= picture.view.width - 1.0);
            CHECK_TRUE(dot.y.raw() >= 0 && px(dot.y) <= picture.view.height - 1.0);
            CHECK_TRUE(dot.contrast >= 0 && dot.contrast <= 255);
          }
        }
      }
    }
  }
}

// A dot at the picture's edge is seen in part: its centre may be pulled inwards, never outside or to another place.
TEST(Window, StaysAtADotThatTheEdgeCuts) {
  const scene::PictureConfig config = clean();
  for (const Point truth :
       {Point{0.0, 100.0}, Point{319.0, 100.0}, Point{100.0, 0.0}, Point{100.0, 239.0}, Point{2.0, 2.0}}) {
    const std::array<Point, 1> dots{truth};
    const Picture picture = reference_model::picture_of(config, dots, 1);
    window::Dot dot{q8(truth.x), q8(truth.y), 75, 0};
    if (!window::measure(picture.view(), 24, 4, dot)) continue;
    CHECK_TRUE(reference_model::distance(truth, {px(dot.x), px(dot.y)}) <= 8.3);  // a radius
  }
}
