// SPDX-License-Identifier: Apache-2.0
// The renderer is the ruler for every accuracy figure: it is measured with a plain centroid of its pixels.
#include "drivers/sim/scene/picture/render.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/scene_pictures.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;

namespace {

using Pixels = std::vector<std::uint8_t>;

// Taken on x86-64; the aarch64 build under qemu-user finds the same.
constexpr std::uint64_t kBytesHash = 7908283152694949046u;
constexpr std::uint64_t kEffectsHash = 10028423893659909874u;
constexpr std::uint64_t kReliefHash = 457552031723510170u;
constexpr std::uint64_t kShapeHash = 1326837451475239263u;

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
Blob centroid(const PictureConfig& config, const Pixels& picture, PointPx near, int half) {
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

Pixels luma(const PictureConfig& config, std::span<const PointPx> dots, const Imprint* contact = nullptr,
            std::uint64_t seed = 1) {
  Pixels out;
  render_luma(config, dots, contact, seed, out);
  return out;
}

Pixels rgb(const PictureConfig& config, std::span<const PointPx> dots, const Imprint* contact = nullptr,
           std::uint64_t seed = 1) {
  Pixels out;
  render_rgb(config, dots, contact, seed, out);
  return out;
}

Pixels luma_of(const PictureConfig& config, const PictureFrame& frame) {
  Pixels out;
  render_luma(config, frame, out);
  return out;
}

Pixels rgb_of(const PictureConfig& config, const PictureFrame& frame) {
  Pixels out;
  render_rgb(config, frame, out);
  return out;
}

std::uint64_t fnv1a(const Pixels& picture) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const std::uint8_t byte : picture) hash = (hash ^ byte) * 0x100000001b3u;
  return hash;
}

// Levels before rounding, in 1/256: light that rises by 1/256 lifts each sample over its rounding step in one of 256
// pictures.
std::vector<int> exact_levels(const PictureConfig& config, PictureFrame frame) {
  // The sum over k of floor((q8 + k + 128) / 256) is q8 + 128.
  std::vector<int> sum(static_cast<std::size_t>(config.width * config.height), -128);
  for (int k = 0; k < 256; ++k) {
    frame.light_levels = k / 256.0;
    const Pixels picture = luma_of(config, frame);
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += picture[i];
  }
  return sum;
}

// Mass, centre and spread of what is darker than the background.
struct Moments {
  double mass = 0.0, x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
};

Moments moments(const PictureConfig& config, const std::vector<int>& q8) {
  Moments m;
  const auto each = [&](auto add) {
    for (int y = 0; y < config.height; ++y) {
      for (int x = 0; x < config.width; ++x) {
        add(x, y, config.background - q8[static_cast<std::size_t>(y * config.width + x)] / 256.0);
      }
    }
  };
  each([&](int x, int y, double dark) {
    m.mass += dark;
    m.x += dark * x;
    m.y += dark * y;
  });
  m.x /= m.mass;
  m.y /= m.mass;
  each([&](int x, int y, double dark) {
    m.xx += dark * (x - m.x) * (x - m.x) / m.mass;
    m.yy += dark * (y - m.y) * (y - m.y) / m.mass;
    m.xy += dark * (x - m.x) * (y - m.y) / m.mass;
  });
  return m;
}

// Room for one dot and its path.
PictureConfig small(int width = 48, int height = 40) {
  PictureConfig config = flat(0.0);
  config.width = width;
  config.height = height;
  config.center_x_px = 0.5 * (width - 1);
  config.center_y_px = 0.5 * (height - 1);
  return config;
}

std::vector<PointPx> dots_at_rest(const PictureConfig& config) {
  return dot_centers_px(config, Simulation({}).markers());
}

}  // namespace

TEST_GROUP(Render){};

TEST(Render, PlacesAreTheGelsAndTheImprintIsTheSpheres) {
  PictureConfig config = flat(0.0);
  config.px_per_mm = 10.0;
  const std::array<Vec2, 2> rest{{{0.0, 0.0}, {-2.0, 1.5}}};
  const std::array<Vec2, 2> motion{{{0.25, -0.5}, {0.0, 0.125}}};
  const auto still = dot_centers_px(config, rest);
  const auto moved = dot_centers_px(config, rest, motion);
  DOUBLES_EQUAL(139.5, still[1].x, 1e-12);
  DOUBLES_EQUAL(134.5, still[1].y, 1e-12);
  DOUBLES_EQUAL(162.0, moved[0].x, 1e-12);
  DOUBLES_EQUAL(135.75, moved[1].y, 1e-12);
  // R = 16 mm at a depth of 1 mm: a = 4 mm, and the rim's slope is a / R.
  ContactState contact;
  contact.depth_mm = 1.0;
  contact.contact_radius_mm = 4.0;
  contact.center_mm = {1.0, -1.0};
  const Imprint imprint = imprint_px(config, contact);
  DOUBLES_EQUAL(169.5, imprint.center.x, 1e-12);
  DOUBLES_EQUAL(109.5, imprint.center.y, 1e-12);
  DOUBLES_EQUAL(40.0, imprint.radius_px, 1e-12);
  DOUBLES_EQUAL(0.25, imprint.rim_slope, 1e-12);
  const Imprint none = imprint_px(config, {});
  DOUBLES_EQUAL(0.0, none.radius_px, 0.0);
  DOUBLES_EQUAL(0.0, none.rim_slope, 0.0);
}

TEST(Render, DotIsExactBeforeRounding) {
  for (const double radius_px : {4.5, 6.1, 8.25}) {
    PictureConfig config = small();
    config.dot_diameter_mm = 2.0 * radius_px / config.px_per_mm;
    for (int step = 0; step < 12; ++step) {
      const PointPx center{20.0 + 0.137 * step, 17.0 + 0.291 * step};
      const Moments m = moments(config, exact_levels(config, {.dots = {&center, 1}}));
      DOUBLES_EQUAL(center.x, m.x, 0.0003);
      DOUBLES_EQUAL(center.y, m.y, 0.0003);
    }
  }
}

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
  const auto dots = holdfast::test::views_of(sphere_slip(), config)[50].dots;  // at 2.0 s, sliding
  const Pixels picture = luma(config, dots);
  for (const std::size_t i : {0u, 31u, 62u}) {
    const Blob found = centroid(config, picture, dots[i], 90);
    // Rounding to 8 bits again, of 5000 rim pixels; 0.0007 px on the scale of 320.
    DOUBLES_EQUAL(dots[i].x, found.x, 0.005);
    DOUBLES_EQUAL(dots[i].y, found.y, 0.005);
  }
  // Pitch 233 px, the grid within the middle 70 %.
  const auto rest = dots_at_rest(config);
  DOUBLES_EQUAL(233.0, rest[1].x - rest[0].x, 0.5);
  CHECK(rest[0].x > 0.15 * config.width);
  CHECK(rest[62].x < 0.85 * config.width);
  CHECK(rest[0].y > 0.15 * config.height);
  CHECK(rest[62].y < 0.85 * config.height);
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
    const Pixels picture = luma(config, {});
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

TEST(Render, TheBytesAreTheSameOnEveryMachine) {
  const PictureConfig config = cropped_320x240();
  const std::array<PointPx, 2> dots{{{100.25, 80.5}, {160.125, 121.75}}};
  const Imprint contact{{150.0, 110.0}, 64.0, 0.25};
  CHECK_EQUAL(kBytesHash, fnv1a(rgb(config, dots, &contact, 3)));
}

TEST(Render, LumaIsTheSumOfTheColours) {
  PictureConfig config = cropped_320x240();
  config.noise_sigma = 0.0;
  const PointPx dot{150.3, 90.6};
  const Imprint contact{{170.0, 120.0}, 60.0, 0.3};
  const Pixels grey = luma(config, {&dot, 1}, &contact);
  const Pixels colour = rgb(config, {&dot, 1}, &contact);
  for (std::size_t i = 0; i < grey.size(); ++i) {
    const double y = 0.299 * colour[3 * i] + 0.587 * colour[3 * i + 1] + 0.114 * colour[3 * i + 2];
    DOUBLES_EQUAL(y, grey[i], 1.1);  // each of the two is rounded, and the imprint's integer steps
  }
}

TEST(Render, ImprintFacesTheLampsAndEndsAtTwiceTheRadius) {
  PictureConfig config = flat(0.0);
  const Imprint contact{{160.0, 120.0}, 40.0, 0.3};
  const Pixels picture = rgb(config, {}, &contact);
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
  const Pixels picture = luma(config, dots);
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
  const Pixels picture = rgb(config, {});
  LONGS_EQUAL(3, picture.size());
  LONGS_EQUAL(120, picture[0]);
}

// --- Effects ---

namespace {

PictureConfig soiled() {
  PictureConfig config = cropped_320x240();
  config.effects = {.exposure_ms = 8.0,
                    .rolling_shutter_ms = 15.0,
                    .dirt_specks = 12,
                    .worn_gel = 0.6,
                    .dot_shading = 9.0,
                    .gel_width_mm = 17.0,
                    .gel_height_mm = 13.0};
  return config;
}

}  // namespace

TEST(Render, EffectsAreTheSameBytesOnEveryMachine) {
  const PictureConfig config = soiled();
  const std::array<PointPx, 2> dots{{{100.25, 80.5}, {160.125, 121.75}}};
  const std::array<PointPx, 2> later{{{107.5, 77.25}, {160.125, 131.75}}};
  const Imprint contact{{150.0, 110.0}, 64.0, 0.25};
  const Imprint moved{{158.0, 112.0}, 66.0, 0.25};
  const PictureFrame frame{
      .dots = dots, .dots_end = later, .contact = &contact, .contact_end = &moved, .light_levels = -3.3, .seed = 3};
  CHECK_EQUAL(kEffectsHash, fnv1a(rgb_of(config, frame)));
}

TEST(Render, MotionBlurDrawsADotAlongItsPath) {
  PictureConfig config = small(64, 56);
  config.effects.exposure_ms = 10.0;
  const PointPx from{22.3, 21.1};
  const Moments still = moments(config, exact_levels(config, {.dots = {&from, 1}}));
  // The last one at rest within a sub-instant: hardly blurred, in the middle all the same.
  for (const PointPx path : {PointPx{12.0, 0.0}, PointPx{0.0, -9.0}, PointPx{6.0, 8.0}, PointPx{0.4, 0.3}}) {
    const PointPx to{from.x + path.x, from.y + path.y};
    const Moments m = moments(config, exact_levels(config, {.dots = {&from, 1}, .dots_end = {&to, 1}}));
    // A sampled disc is exact to 0.0003 px; the shares of the instants are rounded once more.
    DOUBLES_EQUAL(from.x + 0.5 * path.x, m.x, 0.001);
    DOUBLES_EQUAL(from.y + 0.5 * path.y, m.y, 0.001);
    DOUBLES_EQUAL(still.mass, m.mass, 0.001 * still.mass);
    // A path of even speed has the covariance path path' / 12; instants 1.5 sigmas apart (0.84 px) lack 1/12 of
    // that squared, 0.06 px^2, at most.
    DOUBLES_EQUAL(still.xx + path.x * path.x / 12.0, m.xx, 0.06);
    DOUBLES_EQUAL(still.yy + path.y * path.y / 12.0, m.yy, 0.06);
    DOUBLES_EQUAL(still.xy + path.x * path.y / 12.0, m.xy, 0.06);
  }
}

TEST(Render, RollingShutterSeesEachRowLater) {
  PictureConfig config = flat(0.0);
  // One dot each 40 rows, all going right by 12 px from the first row's start to the last row's end.
  std::vector<PointPx> dots;
  std::vector<PointPx> later;
  for (int y = 20; y < config.height; y += 40) {
    dots.push_back({100.0, static_cast<double>(y)});
    later.push_back({112.0, static_cast<double>(y)});
  }
  for (const double exposure_ms : {0.0, 10.0}) {
    config.effects.exposure_ms = exposure_ms;
    config.effects.rolling_shutter_ms = 30.0;
    const std::vector<int> q8 = exact_levels(config, {.dots = dots, .dots_end = later});
    for (const PointPx& dot : dots) {
      // Row by row, not only the dots' centres: a moving dot leans.
      for (int y = static_cast<int>(dot.y) - 6; y <= static_cast<int>(dot.y) + 6; ++y) {
        double mass = 0.0;
        double x_sum = 0.0;
        for (int x = 80; x < 132; ++x) {
          const double dark = config.background - q8[static_cast<std::size_t>(y * config.width + x)] / 256.0;
          mass += dark;
          x_sum += dark * x;
        }
        const double t_ms = 30.0 * y / (config.height - 1) + 0.5 * exposure_ms;
        // A single row through a rim has 4 or 6 samples on it, not 100.
        DOUBLES_EQUAL(100.0 + 12.0 * t_ms / (30.0 + exposure_ms), x_sum / mass, 0.005);
      }
    }
  }
}

TEST(Render, LightAddsToEverySampleAndClamps) {
  const PictureConfig config = cropped_320x240();
  const PointPx dot{150.3, 90.6};
  const Imprint contact{{170.0, 120.0}, 60.0, 0.3};
  PictureFrame frame{.dots = {&dot, 1}, .contact = &contact};
  const Pixels plain = rgb_of(config, frame);
  for (const int levels : {7, -5, 100, -200, 300}) {
    frame.light_levels = levels;
    const Pixels lit = rgb_of(config, frame);
    for (std::size_t i = 0; i < plain.size(); ++i) {
      // A sample that was clamped already says nothing about what lay beyond.
      if (plain[i] == 0 || plain[i] == 255) continue;
      LONGS_EQUAL(std::clamp(plain[i] + levels, 0, 255), lit[i]);
    }
  }
}

TEST(Render, DirtIsDarkStaysAndMovesWithTheSeedOnly) {
  PictureConfig config = flat(0.0);
  config.effects.dirt_specks = 20;
  const Pixels dirty = luma(config, {});
  CHECK(dirty == luma_of(config, PictureFrame{.seed = 99}));
  std::size_t dark = 0;
  for (const std::uint8_t level : dirty) {
    CHECK(level <= 120 && level >= 45);
    dark += level < 110 ? 1u : 0u;
  }
  // 20 specks of radius 0.8 .. 3.9 px: 17 pixels each in the mean, most of them darker by more than 10 levels.
  CHECK(dark > 100 && dark < 800);
  config.seed = 2;
  CHECK(dirty != luma(config, {}));
  // More specks leave the first where they were.
  config.seed = 1;
  config.effects.dirt_specks = 40;
  const Pixels dirtier = luma(config, {});
  for (std::size_t i = 0; i < dirty.size(); ++i) CHECK(dirtier[i] <= dirty[i] + 1);
  config.effects.dirt_specks = 0;
  for (const std::uint8_t level : luma(config, {})) LONGS_EQUAL(120, level);
}

TEST(Render, AWornGelLosesDotsInPatchesWithoutMovingThem) {
  PictureConfig config = flat(0.0);
  const auto dots = dots_at_rest(config);
  const auto contrast = [&](const Pixels& picture, std::size_t i) {
    const auto x = static_cast<std::size_t>(std::lround(dots[i].x));
    const auto y = static_cast<std::size_t>(std::lround(dots[i].y));
    return (120.0 - picture[y * 320 + x]) / 75.0;
  };
  config.effects.worn_gel = 0.5;
  const Pixels half = luma(config, dots);
  CHECK(half == luma_of(config, {.dots = dots, .seed = 99}));  // noise is off: nothing else depends on the frame
  config.effects.worn_gel = 1.0;
  const Pixels worn = luma(config, dots);
  double beside = 0.0;
  double apart = 0.0;
  for (std::size_t i = 0; i < dots.size(); ++i) {
    CHECK(contrast(half, i) >= 0.49 && contrast(half, i) <= 1.01);
    CHECK(contrast(worn, i) >= -0.01 && contrast(worn, i) <= 1.01);
    // Loss grows in proportion; a level is 0.013.
    DOUBLES_EQUAL(1.0 - contrast(worn, i), 2.0 * (1.0 - contrast(half, i)), 0.05);
    if (i % 9 != 8) beside += std::abs(contrast(worn, i) - contrast(worn, i + 1));
    apart += std::abs(contrast(worn, i) - contrast(worn, (i + 31) % dots.size()));
    if (contrast(half, i) < 0.3) continue;
    const Blob found = centroid(config, half, dots[i], 12);
    // Half the contrast, twice the error of rounding.
    DOUBLES_EQUAL(dots[i].x, found.x, 0.016);
    DOUBLES_EQUAL(dots[i].y, found.y, 0.016);
  }
  // Patches: neighbours fare alike. 56 pairs side by side, 63 far apart.
  CHECK(beside / 56.0 < 0.8 * apart / 63.0);
  config.seed = 2;
  CHECK(worn != luma(config, dots));
}

TEST(Render, ShadedDotsHaveALitAndADarkSide) {
  PictureConfig config = flat(0.0);
  config.effects.dot_shading = 20.0;
  const PointPx dot{160.0, 120.0};
  const Pixels shaded = rgb(config, {&dot, 1});
  config.effects.dot_shading = 0.0;
  const Pixels plain = rgb(config, {&dot, 1});
  const auto gain = [&](int x, int y, int channel) {
    const auto i = static_cast<std::size_t>((y * 320 + x) * 3 + channel);
    return shaded[i] - plain[i];
  };
  // At the rim, 8.3 px from the centre, where the profile is within 10 % of its top. Green comes from the left.
  CHECK(gain(152, 120, 1) >= 17 && gain(152, 120, 1) <= 20);
  LONGS_EQUAL(-gain(152, 120, 1), gain(168, 120, 1));
  LONGS_EQUAL(0, gain(160, 112, 1));
  CHECK(gain(160, 128, 0) > 13);  // red from below
  CHECK(gain(160, 112, 2) > 13);  // blue from above
  for (int c = 0; c < 3; ++c) {
    LONGS_EQUAL(0, gain(160, 120, c));
    LONGS_EQUAL(0, gain(149, 120, c));
  }
}

TEST(Render, TheGelMayEndWithinThePicture) {
  PictureConfig config = camera_3280x2464();
  config = scaled(config, 410);
  config.noise_sigma = 0.0;
  const PointPx dot{200.3, 150.6};
  const Pixels plain = luma(config, {&dot, 1});
  config.effects.gel_width_mm = 18.6;
  config.effects.gel_height_mm = 14.3;
  config.effects.margin_level = 9.0;
  const Pixels framed = luma(config, {&dot, 1});
  const double half_x = 9.3 * config.px_per_mm;
  const double half_y = 7.15 * config.px_per_mm;
  const double soft = 0.13 * config.px_per_mm;  // half of a quarter of a millimetre
  for (int y = 0; y < config.height; ++y) {
    for (int x = 0; x < config.width; ++x) {
      const auto i = static_cast<std::size_t>(y * config.width + x);
      const double out_x = std::abs(x - config.center_x_px) - half_x;
      const double out_y = std::abs(y - config.center_y_px) - half_y;
      if (out_x < -soft && out_y < -soft) LONGS_EQUAL(plain[i], framed[i]);
      if (out_x > soft || out_y > soft) LONGS_EQUAL(9, framed[i]);
    }
  }
}

// --- What lies under the gel ---

namespace {

const Shape kBall{};
const Relief kGrain{ReliefKind::kGrain, 200.0, 0.8};

// A ball's imprint with the ball's own place at its middle.
Imprint ball_at(PointPx place, double radius_px = 50.0, double turn_rad = 0.0) {
  return {place, radius_px, 0.2, place, turn_rad, 1.0};
}

}  // namespace

TEST(Render, WithoutReliefABallIsTheRoundBulge) {
  const PictureConfig config = cropped_320x240();
  const PointPx dot{150.3, 90.6};
  const Imprint contact = ball_at({170.0, 120.0});
  const Underside smooth(kBall, {}, 1);
  const Underside flat_grain(kBall, {ReliefKind::kGrain, 0.0, 0.8}, 1);
  const PictureFrame bulge{.dots = {&dot, 1}, .contact = &contact};
  for (const Underside* underside : {&smooth, &flat_grain}) {
    PictureFrame frame = bulge;
    frame.underside = underside;
    CHECK(rgb_of(config, bulge) == rgb_of(config, frame));
  }
  // Nor is there a relief without contact.
  const Underside rough(kBall, kGrain, 1);
  const Imprint none{};
  CHECK(luma(config, {&dot, 1}) == luma_of(config, {.dots = {&dot, 1}, .contact = &none, .underside = &rough}));
  CHECK(luma(config, {&dot, 1}) == luma_of(config, {.dots = {&dot, 1}, .underside = &rough}));
}

TEST(Render, ShadingIsTheSlopeTowardsTheLamp) {
  PictureConfig config = flat(0.0);
  config.imprint_gain = 100.0;
  const Shape box{.kind = ShapeKind::kBox, .half_x_mm = 4.0, .half_y_mm = 3.0, .rim_mm = 0.6, .yaw_rad = 0.3};
  const Underside underside(box, {ReliefKind::kGrain, 60.0, 0.8}, 4);
  const Imprint contact{{160.0, 120.0}, 3.9 * config.px_per_mm, 0.1, {163.0, 117.0}, 0.4, 0.3};
  const Pixels picture = rgb_of(config, {.contact = &contact, .underside = &underside});
  const Underside::Pose pose{{3.5 / config.px_per_mm, -2.5 / config.px_per_mm}, 0.4, 0.3, 3.9};
  const auto rise = [&](double x, double y) {
    return underside
        .surface(pose, {(x - config.center_x_px) / config.px_per_mm, (y - config.center_y_px) / config.px_per_mm})
        .rise_mm;
  };
  // Green comes from the left: a pixel is as bright as the surface rises to the left, by differences of the height.
  int steep = 0;
  int off = 0;
  for (int y = 60; y < 180; ++y) {
    for (int x = 80; x < 240; ++x) {
      const double slope = (rise(x + 0.05, y) - rise(x - 0.05, y)) / 0.1 * config.px_per_mm;
      const int level = picture[static_cast<std::size_t>((y * 320 + x) * 3 + 1)];
      off += std::abs(level - (120.0 - 100.0 * slope)) > 1.1 ? 1 : 0;  // truncated and rounded
      steep += std::abs(slope) > 0.05 ? 1 : 0;
    }
  }
  CHECK(steep > 2000);
  CHECK(off < 30);  // on the mitres of the rim, where the difference is of two sides
}

// Each lamp's law by hand on the walls of a box, whose slopes are differences of its height.
TEST(Render, WallsAreLitByTheLampThatTheyFace) {
  PictureConfig config = flat(0.0);
  config.imprint_gain = 0.0;
  const Shape box{.kind = ShapeKind::kBox, .half_x_mm = 4.0, .half_y_mm = 3.0, .rim_mm = 0.9};
  const Underside underside(box, {}, 4);
  const Imprint contact{{160.0, 120.0}, 3.9 * config.px_per_mm, 0.1, {160.0, 120.0}, 0.0, 0.3};
  const Underside::Pose pose{{0.5 / config.px_per_mm, 0.5 / config.px_per_mm}, 0.0, 0.3, 3.9};
  const auto slope_at = [&](int x) {
    const double y_mm = (120 - config.center_y_px) / config.px_per_mm;
    const auto rise = [&](double at) {
      return underside.surface(pose, {(at - config.center_x_px) / config.px_per_mm, y_mm}).rise_mm;
    };
    return (rise(x + 0.05) - rise(x - 0.05)) / 0.1 * config.px_per_mm;
  };
  const auto green_at = [](const Pixels& picture, int x) {
    return static_cast<int>(picture[static_cast<std::size_t>((120 * 320 + x) * 3 + 1)]) - 120;
  };
  config.walls = {.gain = 100.0};
  const Pixels lit = rgb_of(config, {.contact = &contact, .underside = &underside});
  config.walls = {.specular = 80.0};
  const Pixels mirrored = rgb_of(config, {.contact = &contact, .underside = &underside});
  config.walls = {.shadow = 50.0};
  const Pixels shaded = rgb_of(config, {.contact = &contact, .underside = &underside});
  int mirrors = 0;
  int shades = 0;
  for (int x = 40; x < 280; ++x) {
    const double facing = -slope_at(x);                                   // green comes from the left
    DOUBLES_EQUAL(100.0 * std::max(0.0, facing), green_at(lit, x), 1.1);  // truncated and rounded
    const double off = (facing - 0.3) / 0.25;
    const double mirror = 80.0 * std::pow(std::max(0.0, 1.0 - off * off), 2.0);
    DOUBLES_EQUAL(mirror, green_at(mirrored, x), 1.5);
    mirrors += mirror > 40.0 ? 1 : 0;
    if (facing > -0.07) LONGS_EQUAL(0, green_at(shaded, x));
    if (facing < -0.13) LONGS_EQUAL(-50, green_at(shaded, x));
    shades += facing < -0.13 ? 1 : 0;
  }
  CHECK(mirrors > 3);
  CHECK(shades > 3);
}

TEST(Render, ReliefsAndShapesAreTheSameBytesOnEveryMachine) {
  const PictureConfig config = soiled();
  const std::array<PointPx, 2> dots{{{100.25, 80.5}, {160.125, 121.75}}};
  const Imprint contact{{150.0, 110.0}, 64.0, 0.25, {151.0, 109.0}, 0.3, 1.1};
  const Imprint moved{{158.0, 112.0}, 66.0, 0.25, {158.5, 112.0}, 0.4, 1.0};
  PictureFrame frame{.dots = dots, .contact = &contact, .contact_end = &moved, .seed = 3};
  const Underside rough(kBall, {ReliefKind::kGrain, 60.0, 0.7}, 11, lens_sigma_mm(config));
  frame.underside = &rough;
  CHECK_EQUAL(kReliefHash, fnv1a(rgb_of(config, frame)));
  std::uint64_t shapes = 0;
  for (const ShapeKind kind : {ShapeKind::kEllipsoid, ShapeKind::kCylinder, ShapeKind::kCone, ShapeKind::kDisc,
                               ShapeKind::kBox, ShapeKind::kEdge}) {
    const Shape shape{.kind = kind,
                      .radius_y_mm = 9.0,
                      .yaw_rad = 0.2,
                      .texture = TextureKind::kBumps,
                      .texture_height_mm = 0.1,
                      .texture_pitch_mm = 2.2};
    const Underside underside(shape, {ReliefKind::kBumps, 40.0, 0.6}, 11, lens_sigma_mm(config));
    frame.underside = &underside;
    shapes = shapes * 31 + fnv1a(rgb_of(config, frame));
  }
  CHECK_EQUAL(kShapeHash, shapes);
}
