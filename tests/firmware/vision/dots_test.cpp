// SPDX-License-Identifier: Apache-2.0
// The full-frame detector against rendered truth: it must see every dot and little else, at every size of
// picture, and survive pictures that show no gel at all.
#include "vision/dots.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using reference_model::Picture;
using reference_model::Point;

namespace {

double px(PixelsQ8 q) {
  return q.raw() / 256.0;
}

// How many of `truth` have a dot within `reach` px, each dot counted once.
int seen(const std::vector<Point>& truth, const dots::Dots& found, double reach) {
  int n = 0;
  for (const Point& t : truth) {
    const auto near = [&](const dots::Dot& d) { return reference_model::distance(t, {px(d.x), px(d.y)}) <= reach; };
    n += std::count_if(found.dots.begin(), found.dots.begin() + found.count, near) == 1 ? 1 : 0;
  }
  return n;
}

}  // namespace

TEST_GROUP(Dots) {
  std::unique_ptr<dots::State> state = std::make_unique<dots::State>();
  dots::Dots found;
  Status detect(const Picture& picture) {
    return dots::detect(*state, {}, picture.view(), found);
  }
};

// Within a quarter of a pixel of the shrunken picture, plus noise: 0.3 px times the reduction.
TEST(Dots, SeesEveryDotAtEverySize) {
  for (const int width : {96, 128, 160, 240, 320, 410, 512, 513, 640, 820, 1024, 1025, 1640}) {
    const scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
    const auto truth = reference_model::lattice_px({}, config, reference_model::shifted(0.13, -0.21));
    CHECK_TRUE(detect(reference_model::picture_of(config, truth, 5)).ok());
    const int step = std::max((config.width + 511) / 512, (config.height + 399) / 400);
    LONGS_EQUAL_TEXT(63, seen(truth, found, 0.35 * step), StringFromFormat("%d columns", width).asCharString());
    LONGS_EQUAL_TEXT(63, found.count, StringFromFormat("%d columns", width).asCharString());
    for (int i = 0; i < found.count; ++i) CHECK_FALSE(found.dots[static_cast<std::size_t>(i)].cut);
  }
}

TEST(Dots, SeesDotsOfEveryPrintedSizeLightAndNoise) {
  for (const double diameter : {0.57, 0.77, 1.05}) {
    for (const double shading : {0.0, 20.0}) {
      for (const double sigma : {0.0, 2.5, 6.0}) {
        scene::PictureConfig config;
        config.dot_diameter_mm = diameter;
        config.shading = shading;
        config.noise_sigma = sigma;
        const auto truth = reference_model::lattice_px({}, config);
        CHECK_TRUE(detect(reference_model::picture_of(config, truth, 6)).ok());
        LONGS_EQUAL(63, seen(truth, found, 1.0));
        CHECK_TRUE(found.count <= 66);
      }
    }
  }
}

// Exposure and gain may differ by 3 between sensors: the threshold comes from the picture. Below about 20
// levels the floor of the threshold (8 levels above the local mean) begins to cost dots.
TEST(Dots, SeesDotsOfWeakContrast) {
  for (const double contrast : {25.0, 40.0, 120.0, 200.0}) {
    scene::PictureConfig config;
    config.background = 120.0 + contrast / 2;
    config.dot_level = 120.0 - contrast / 2;
    config.noise_sigma = 1.5;
    config.shading = 10.0;
    const auto truth = reference_model::lattice_px({}, config);
    CHECK_TRUE(detect(reference_model::picture_of(config, truth, 7)).ok());
    LONGS_EQUAL_TEXT(63, seen(truth, found, 1.0), StringFromFormat("contrast %.0f", contrast).asCharString());
  }
}

TEST(Dots, MarksDotsThatTheEdgeCuts) {
  scene::PictureConfig config;
  config.noise_sigma = 0.0;
  const std::vector<Point> truth{{0.0, 60.0},    {100.0, 0.0},   {319.0, 120.0},
                                 {160.0, 239.0}, {160.0, 120.0}, {80.0, 80.0}};
  CHECK_TRUE(detect(reference_model::picture_of(config, truth, 8)).ok());
  int cut = 0;
  for (int i = 0; i < found.count; ++i) cut += found.dots[static_cast<std::size_t>(i)].cut ? 1 : 0;
  LONGS_EQUAL(2, found.count - cut);
  CHECK_TRUE(cut >= 2);  // half a disc may fail the test of roundness, but never pass as a whole one
}

TEST(Dots, SeesNothingInFlatPictures) {
  for (const int level : {0, 1, 127, 255}) {
    for (const auto& [width, height] : {std::pair{64, 48}, {320, 240}, {1640, 1232}, {1640, 48}, {64, 1232}}) {
      CHECK_TRUE(detect(reference_model::flat(width, height, static_cast<std::uint8_t>(level))).ok());
      LONGS_EQUAL(0, found.count);
    }
  }
}

// Checkerboards from 1 px to 40 px, stripes, single pixels, salt and pepper: any answer but a crash or a read
// outside (asan), and never more dots than the fixed memory holds.
TEST(Dots, SurvivesTexturesThatAreNoGel) {
  std::mt19937 random(9);
  for (const auto& size : {std::pair{64, 48}, {320, 240}, {512, 400}, {1640, 1232}}) {
    const int width = size.first;
    const int height = size.second;
    Picture picture = reference_model::flat(width, height, 0);
    const auto fill = [&](auto level) {
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x)
          picture.pixels[static_cast<std::size_t>(y * width + x)] = static_cast<std::uint8_t>(level(x, y));
      }
      const Status status = detect(picture);
      CHECK_TRUE(status.ok() || status.reason == Reason::kDotsOverflow);
      CHECK_TRUE(found.count >= 0 && found.count <= kMaxDots);
    };
    for (const int cell : {1, 2, 3, 4, 8, 13, 40}) {
      fill([&](int x, int y) { return (x / cell + y / cell) % 2 * 255; });
      fill([&](int x, int) { return x / cell % 2 * 255; });
      fill([&](int, int y) { return y / cell % 2 * 255; });
      fill([&](int x, int y) { return x % (2 * cell) < cell && y % (2 * cell) < cell ? 0 : 255; });
    }
    fill([&](int, int) { return random() % 256; });
    fill([&](int, int) { return random() % 16 == 0 ? 0 : 200; });
    fill([&](int x, int) { return x * 255 / width; });
    fill([&](int x, int y) { return x == 0 || y == 0 || x == width - 1 || y == height - 1 ? 0 : 255; });
  }
}

// One dot too many is an overflow, never a silent cut.
TEST(Dots, SaysWhenThereAreTooMany) {
  scene::PictureConfig config;
  config.width = 512;
  config.height = 400;
  config.shading = 0.0;
  const auto grid_of = [&](int count) {
    std::vector<Point> dots;
    dots.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) dots.push_back({16.0 + 30.0 * (i % 16), 16.0 + 28.0 * std::floor(i / 16.0)});
    return dots;
  };
  config.dot_diameter_mm = 0.7;
  CHECK_TRUE(detect(reference_model::picture_of(config, grid_of(192), 1)).ok());
  LONGS_EQUAL(192, found.count);
  LONGS_EQUAL(static_cast<int>(Reason::kDotsOverflow),
              static_cast<int>(detect(reference_model::picture_of(config, grid_of(193), 1)).reason));
}

TEST(Dots, DropsBlobsUnlikeTheOthers) {
  scene::PictureConfig config;
  const auto truth = reference_model::lattice_px({}, config);
  Picture picture = reference_model::picture_of(config, truth, 3);
  const auto blot = [&](int left, int top, int width, int height) {
    for (int y = top; y < top + height; ++y) {
      for (int x = left; x < left + width; ++x) picture.pixels[static_cast<std::size_t>(y * 320 + x)] = 30;
    }
  };
  blot(5, 5, 3, 3);     // a speck
  blot(2, 100, 4, 60);  // a hair
  blot(300, 5, 14, 3);  // a scratch
  CHECK_TRUE(detect(picture).ok());
  LONGS_EQUAL(63, seen(truth, found, 1.0));
  LONGS_EQUAL(63, found.count);
}

// A dark disc of 2.4 times a dot's area is something else, though it is round and not too large for a small print.
TEST(Dots, DropsADiscTwiceAsLargeAsTheOthers) {
  scene::PictureConfig config;
  auto truth = reference_model::lattice_px({}, config);
  const Point large = truth[31];
  truth.erase(truth.begin() + 31);
  Picture picture = reference_model::picture_of(config, truth, 3);
  const double radius = 0.5 * config.dot_diameter_mm * config.px_per_mm * std::sqrt(2.4);
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const Point at{static_cast<double>(x), static_cast<double>(y)};
      if (reference_model::distance(large, at) <= radius) {
        picture.pixels[static_cast<std::size_t>(y * picture.width + x)] = 45;
      }
    }
  }
  CHECK_TRUE(detect(picture).ok());
  LONGS_EQUAL(62, seen(truth, found, 1.0));
  LONGS_EQUAL(62, found.count);
}

// Two dots that touch are one blob: neither centre is right, so there is no dot of that name or it is left
// out.
TEST(Dots, DoesNotSplitTouchingDots) {
  scene::PictureConfig config;
  auto truth = reference_model::lattice_px({}, config);
  truth[31].x -= 17.0;  // towards 30, rims merged
  CHECK_TRUE(detect(reference_model::picture_of(config, truth, 3)).ok());
  CHECK_TRUE(seen(truth, found, 1.0) >= 61);
}

TEST(Dots, ReadsNotAByteBehindThePicture) {
  std::mt19937 random(10);
  for (const auto& [width, height] : {std::pair{64, 48}, {65, 49}, {511, 399}, {513, 401}, {1639, 1231}}) {
    const int stride = width + 7;
    const auto bytes = static_cast<std::size_t>((height - 1) * stride + width);
    std::unique_ptr<std::uint8_t[]> block(new std::uint8_t[bytes]);
    for (std::size_t i = 0; i < bytes; ++i) block[i] = static_cast<std::uint8_t>(random() % 200);
    const Status status = dots::detect(*state, {}, {block.get(), width, height, stride}, found);
    CHECK_TRUE(status.ok() || status.reason == Reason::kDotsOverflow);
  }
}
