// SPDX-License-Identifier: Apache-2.0
// The renderer is the ruler for every accuracy figure: it is measured with a plain centroid of its pixels.
#include "drivers/sim/scene/render.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;

namespace {

using Picture = std::vector<std::uint8_t>;

// Taken on x86-64; the aarch64 build under qemu-user found the same.
constexpr std::uint64_t kBytesHash = 11333400309386129361u;

PictureConfig flat(double noise_sigma) {
  PictureConfig config = cropped_320x240();
  config.shading = 0.0;
  config.noise_sigma = noise_sigma;
  return config;
}

struct Blob {
  double x = 0.0, y = 0.0, mass = 0.0;
};

// Mean place of what is darker than the background, within a square around `near`.
Blob centroid(const PictureConfig& config, const Picture& picture, PointPx near, int half) {
  Blob blob;
  const int cx = static_cast<int>(std::lround(near.x));
  const int cy = static_cast<int>(std::lround(near.y));
  for (int y = cy - half; y <= cy + half; ++y) {
    for (int x = cx - half; x <= cx + half; ++x) {
      const double dark = config.background - picture[static_cast<std::size_t>(y * config.width + x)];
      blob.mass += dark;
      blob.x += dark * x;
      blob.y += dark * y;
    }
  }
  blob.x /= blob.mass;
  blob.y /= blob.mass;
  return blob;
}

Picture luma(const PictureConfig& config, std::span<const PointPx> dots, const Imprint* contact = nullptr,
             std::uint64_t seed = 1) {
  Picture out;
  render_luma(config, dots, contact, seed, out);
  return out;
}

Picture rgb(const PictureConfig& config, std::span<const PointPx> dots, const Imprint* contact = nullptr,
            std::uint64_t seed = 1) {
  Picture out;
  render_rgb(config, dots, contact, seed, out);
  return out;
}

}  // namespace

TEST_GROUP(Render){};

TEST(Render, DotIsWhereItWasPut) {
  struct Case {
    double background, dot_level, rms_px, worst_px;
  };
  // Without rounding to 8 bits the sampled centroid is exact to 0.0003 px. Rounding a rim of about 100 pixels
  // adds 0.002 px rms at the contrast of a recording, and four times less at full contrast.
  for (const Case& c : {Case{120.0, 45.0, 0.002, 0.008}, Case{250.0, 5.0, 0.0008, 0.0025}}) {
    for (const double radius_px : {4.5, 6.1, 8.25}) {
      PictureConfig config = flat(0.0);
      config.background = c.background;
      config.dot_level = c.dot_level;
      config.dot_diameter_mm = 2.0 * radius_px / config.px_per_mm;
      double square = 0.0;
      constexpr int kSteps = 200;
      for (int step = 0; step < kSteps; ++step) {
        const PointPx center{100.0 + 0.137 * step, 80.0 + 0.291 * step};
        const Blob found = centroid(config, luma(config, {&center, 1}), center, 12);
        DOUBLES_EQUAL(center.x, found.x, c.worst_px);
        DOUBLES_EQUAL(center.y, found.y, c.worst_px);
        square += std::pow(found.x - center.x, 2) + std::pow(found.y - center.y, 2);
        // A blurred disc is larger by the blur's variance, (0.56 / r)^2 = 1.5 % at most.
        const double area = found.mass / (config.background - config.dot_level);
        DOUBLES_EQUAL(std::numbers::pi * radius_px * radius_px, area, 0.02 * area);
      }
      CHECK(std::sqrt(square / (2.0 * kSteps)) < c.rms_px);
    }
  }
}

TEST(Render, CameraPresetPutsDotsWhereItSays) {
  PictureConfig config = camera_3280x2464();
  config.shading = 0.0;
  config.noise_sigma = 0.0;
  const GraspConfig grasp;
  const auto dots = dot_centers_px(config, markers_at(grasp, at(grasp, 2.0), {}));
  const Picture picture = luma(config, dots);
  for (const std::size_t i : {0u, 31u, 62u}) {
    const Blob found = centroid(config, picture, dots[i], 90);
    // Rounding to 8 bits again, of 5000 rim pixels; 0.0007 px on the scale of 320.
    DOUBLES_EQUAL(dots[i].x, found.x, 0.005);
    DOUBLES_EQUAL(dots[i].y, found.y, 0.005);
  }
  // Pitch 233 px, the grid within the middle 70 %.
  const auto rest = dot_centers_px(config, markers_at(grasp, at(grasp, 0.0), {}));
  DOUBLES_EQUAL(233.0, rest[1].x - rest[0].x, 0.5);
  CHECK(rest[0].x > 0.15 * config.width);
  CHECK(rest[62].x < 0.85 * config.width);
  CHECK(rest[0].y > 0.15 * config.height);
  CHECK(rest[62].y < 0.85 * config.height);
}

TEST(Render, CroppedPresetLooksLikeARecording) {
  const PictureConfig config = cropped_320x240();
  const GraspConfig grasp;
  const auto dots = dot_centers_px(config, markers_at(grasp, at(grasp, 0.0), {}));
  DOUBLES_EQUAL(31.9, dots[1].x - dots[0].x, 0.05);  // px, measured on recordings
  DOUBLES_EQUAL(16.6, config.dot_diameter_mm * config.px_per_mm, 0.1);
  const Picture picture = luma(config, dots);
  DOUBLES_EQUAL(config.dot_level, picture[120 * 320 + 160], 5.0 * config.noise_sigma);
  // Between four dots in the middle, and at a corner.
  const int middle = picture[135 * 320 + 175];
  const int corner = picture[3 * 320 + 316];
  CHECK(middle > 110 && middle < 145);
  CHECK(corner > 60 && corner < middle);
}

TEST(Render, ScalingKeepsTheViewAtAnySize) {
  const PictureConfig full = camera_3280x2464();
  const PictureConfig eighth = scaled(full, 410);
  LONGS_EQUAL(308, eighth.height);
  for (const Vec2 mm : {Vec2{0, 0}, Vec2{-8.08, 6.06}, Vec2{3.3, -1.0}}) {
    // Pixel centres of 8x8 blocks: (x + 0.5) / 8 - 0.5, as a decoder at 1/8 places them.
    DOUBLES_EQUAL((to_px(full, mm).x + 0.5) / 8.0 - 0.5, to_px(eighth, mm).x, 1e-9);
    DOUBLES_EQUAL((to_px(full, mm).y + 0.5) / 8.0 - 0.5, to_px(eighth, mm).y, 1e-9);
  }
}

TEST(Render, NoiseHasTheSigmaAskedForAndNoPattern) {
  for (const double sigma : {2.5, 8.0}) {
    PictureConfig config = flat(sigma);
    config.width = 640;
    config.height = 480;
    const Picture picture = luma(config, {});
    double sum = 0.0;
    double square = 0.0;
    double beside = 0.0;
    double below = 0.0;
    double fourth = 0.0;
    int n = 0;
    for (int y = 0; y + 1 < config.height; ++y) {
      for (int x = 0; x + 1 < config.width; ++x, ++n) {
        const std::size_t i = static_cast<std::size_t>(y * config.width + x);
        const double d = picture[i] - config.background;
        sum += d;
        square += d * d;
        fourth += d * d * d * d;
        beside += d * (picture[i + 1] - config.background);
        below += d * (picture[i + static_cast<std::size_t>(config.width)] - config.background);
      }
    }
    const double variance = square / n;
    // Rounding to levels adds 1/12. Sampling error of sigma over 306 000 pixels is 0.13 %.
    DOUBLES_EQUAL(sigma, std::sqrt(variance - 1.0 / 12.0), 0.02 * sigma);
    // Five standard errors of a mean, of a correlation (1 / sqrt n = 0.0018), and a normal's kurtosis of 3.
    DOUBLES_EQUAL(0.0, sum / n, 5.0 * sigma / std::sqrt(n));
    DOUBLES_EQUAL(0.0, beside / square, 0.009);
    DOUBLES_EQUAL(0.0, below / square, 0.009);
    DOUBLES_EQUAL(3.0, fourth / n / (variance * variance), 0.15);
  }
}

TEST(Render, SeedsDecideTheNoise) {
  PictureConfig config = cropped_320x240();
  const PointPx dot{150.3, 90.6};
  const Picture first = rgb(config, {&dot, 1}, nullptr, 7);
  CHECK(first == rgb(config, {&dot, 1}, nullptr, 7));
  const Picture next = rgb(config, {&dot, 1}, nullptr, 8);
  config.seed = 2;
  const Picture other = rgb(config, {&dot, 1}, nullptr, 7);
  for (const Picture& picture : {next, other}) {
    std::size_t same = 0;
    for (std::size_t i = 0; i < first.size(); ++i) same += first[i] == picture[i] ? 1u : 0u;
    // Two roundings of independent noise of sigma 2.5 agree by chance in 11 %.
    CHECK(same < first.size() / 6);
  }
}

TEST(Render, TheBytesAreTheSameOnEveryMachine) {
  const PictureConfig config = cropped_320x240();
  const std::array<PointPx, 2> dots{{{100.25, 80.5}, {160.125, 121.75}}};
  const Imprint contact{{150.0, 110.0}, 64.0, 0.25};
  std::uint64_t hash = 0xcbf29ce484222325u;  // FNV-1a
  for (const std::uint8_t byte : rgb(config, dots, &contact, 3)) hash = (hash ^ byte) * 0x100000001b3u;
  CHECK_EQUAL(kBytesHash, hash);
}

TEST(Render, LumaIsTheSumOfTheColours) {
  PictureConfig config = cropped_320x240();
  config.noise_sigma = 0.0;
  const PointPx dot{150.3, 90.6};
  const Imprint contact{{170.0, 120.0}, 60.0, 0.3};
  const Picture grey = luma(config, {&dot, 1}, &contact);
  const Picture colour = rgb(config, {&dot, 1}, &contact);
  for (std::size_t i = 0; i < grey.size(); ++i) {
    const double y = 0.299 * colour[3 * i] + 0.587 * colour[3 * i + 1] + 0.114 * colour[3 * i + 2];
    DOUBLES_EQUAL(y, grey[i], 1.1);  // each of the two is rounded, and the imprint's integer steps
  }
}

TEST(Render, ImprintFacesTheLampsAndEndsAtTwiceTheRadius) {
  PictureConfig config = flat(0.0);
  const Imprint contact{{160.0, 120.0}, 40.0, 0.3};
  const Picture picture = rgb(config, {}, &contact);
  const auto level = [&](int x, int y, int channel) {
    return static_cast<int>(picture[static_cast<std::size_t>((y * 320 + x) * 3 + channel)]);
  };
  const int flat_level = static_cast<int>(config.background);
  // Green comes from the left, at the rim by gain * slope = 18 levels.
  LONGS_EQUAL(flat_level + 18, level(120, 120, 1));
  LONGS_EQUAL(flat_level - 18, level(200, 120, 1));
  CHECK(level(160, 160, 0) > flat_level + 10);  // red from below
  CHECK(level(160, 80, 2) > flat_level + 10);   // blue from above
  for (int c = 0; c < 3; ++c) {
    LONGS_EQUAL(flat_level, level(160, 120, c));
    LONGS_EQUAL(flat_level, level(160 - 81, 120, c));
    LONGS_EQUAL(flat_level, level(160, 120 + 81, c));
  }
  const Imprint none{};
  CHECK(rgb(config, {}, &none) == rgb(config, {}));
}

TEST(Render, LevelsClampAndDotsMayLeaveThePicture) {
  PictureConfig config = flat(20.0);
  config.background = 250.0;
  config.dot_level = 3.0;
  const std::array<PointPx, 6> dots{
      {{0.0, 0.0}, {319.4, 239.2}, {-8.0, 100.0}, {1e300, 100.0}, {50.0, -1e300}, {std::nan(""), 60.0}}};
  const Picture picture = luma(config, dots);
  // Wrapped values would show as dark pixels in the bright middle and bright ones in the dot.
  for (int y = 110; y < 130; ++y) {
    for (int x = 150; x < 170; ++x) CHECK(picture[static_cast<std::size_t>(y * 320 + x)] > 100);
  }
  for (int x = 0; x < 4; ++x) CHECK(picture[static_cast<std::size_t>(x)] < 150);
}

TEST(Render, OnePixelIsAPicture) {
  PictureConfig config = flat(0.0);
  config.width = 1;
  config.height = 1;
  const Picture picture = rgb(config, {});
  LONGS_EQUAL(3, picture.size());
  LONGS_EQUAL(120, picture[0]);
}
