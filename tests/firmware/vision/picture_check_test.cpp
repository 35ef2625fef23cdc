// SPDX-License-Identifier: Apache-2.0
// Which pictures are refused: steps as a misread JPEG leaves them, and nothing that a scene, light or dirt can do.
// The real decoder and real damage are the corruption campaign's (host/jpeg_corruption_test.cpp).
#include "vision/picture_check.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/scene_pictures.hpp"
#include "vision/luma_input.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;

namespace {

// 3280x2464 at 1/8: noise of sigma 8 becomes 1, rims as sharp as pixels.
scene::PictureConfig eighth() {
  scene::PictureConfig view = scene::scaled(scene::camera_3280x2464(), 410);
  view.noise_sigma = 1.0;
  return view;
}

void add(Picture& picture, int x, int y, int levels) {
  std::uint8_t& pixel = picture.pixels[static_cast<std::size_t>(y * picture.width + x)];
  pixel = static_cast<std::uint8_t>(std::clamp(pixel + levels, 0, 255));
}

// What follows a wrong brightness in the MCU at (x, y): MCUs of `tall` rows, sent row by row.
Picture with_step(Picture picture, int x, int y, int levels, int tall = 1) {
  for (int row = y; row < picture.height; ++row) {
    for (int column = row < y + tall ? x : 0; column < picture.width; ++column) add(picture, column, row, levels);
  }
  return picture;
}

// A line across the picture, as a hair or the housing's edge makes it.
Picture with_line(Picture picture, int y, int thick, int levels) {
  for (int row = y; row < y + thick; ++row) {
    for (int x = 0; x < picture.width; ++x) add(picture, x, row, levels);
  }
  return picture;
}

}  // namespace

TEST_GROUP(PictureCheck) {
  std::unique_ptr<picture_check::State> state = std::make_unique<picture_check::State>();
  picture_check::Config config;
  scene::PictureConfig view = eighth();
  std::uint64_t seed = 1;

  Picture picture(const Warp& warp = {}) {
    return picture_of(view, lattice_px({}, view, warp), ++seed);
  }
  bool accepts(const Picture& shown) {
    const Status status = picture_check::update(*state, config, shown.view(), 1);
    CHECK_TRUE(status.ok() || status.reason == Reason::kJpegDamaged);
    return status.ok();
  }
};

TEST(PictureCheck, RefusesAStepWhereverItBegins) {
  CHECK_TRUE(accepts(picture()));
  for (int y = 1; y < view.height - 2; y += 5) {
    for (const int x : {0, 1, 102, 205, 307, 409}) {
      for (const int levels : {-60, -28, 28, 60, 140}) {
        const int tall = 1 + (x + y) % 2;  // 4:2:2 and 4:2:0
        CHECK_FALSE(accepts(with_step(picture(), x, y, levels, tall)));
        CHECK_TRUE(accepts(picture()));
      }
    }
  }
}

// 400 columns count in full: 160 of them are 40 %.
TEST(PictureCheck, RefusesWhatExceedsTheLimit) {
  const Picture grey = flat(400, 300, 100);
  for (const int levels : {16, 90, -16, -90}) {
    CHECK_TRUE(accepts(grey));
    Picture shown = grey;
    for (int x = 0; x < 160; ++x) {
      for (int y = 150; y < 300; ++y) add(shown, x, y, levels);
    }
    CHECK_TRUE(accepts(shown));
    CHECK_TRUE(accepts(grey));
    for (int y = 150; y < 300; ++y) add(shown, 160, y, levels);
    CHECK_FALSE(accepts(shown));
  }
  for (const int levels : {-6, 6}) {  // 6 of 16 levels are 37.5 %, 7 are 43.8 %
    CHECK_TRUE(accepts(grey));
    CHECK_TRUE(accepts(with_step(grey, 0, 100, levels)));
    CHECK_TRUE(accepts(grey));
    CHECK_FALSE(accepts(with_step(grey, 0, 100, levels + levels / 6)));
  }
}

TEST(PictureCheck, AcceptsTheFirstPictureWhateverItIs) {
  CHECK_TRUE(accepts(with_step(picture(), 100, 100, 60)));
  CHECK_TRUE(accepts(picture()));
  CHECK_FALSE(accepts(with_step(picture(), 100, 100, 60)));
}

TEST(PictureCheck, AcceptsEveryFrameOfAScene) {
  const test::ScenePictures film = test::film(scene::sphere_slip(), view);
  for (const std::int32_t block : {1, 4, 8}) {
    *state = {};
    for (const LumaView& luma : film.views) CHECK_TRUE(picture_check::update(*state, config, luma, block).ok());
  }
}

// Of two blocks' width at least, and one or two blocks high: the next restart marker ends it. Not where a block is
// small; nor a line, nor what lies across the blocks; and what is there in each frame is the scene's.
TEST(PictureCheck, RefusesAStepThatARestartMarkerEnds) {
  const Picture grey = flat(320, 240, 100);
  const auto accepts_at = [&](std::int32_t block, const Picture& shown) {
    return picture_check::update(*state, config, shown.view(), block).ok();
  };
  const auto with_cell = [&](int x, int y, int wide, int tall, int levels) {
    Picture out = grey;
    for (int k = 0; k < wide * tall; ++k) add(out, x + k % wide, y + k / wide, levels);
    return out;
  };
  for (const std::int32_t block : {1, 2, 4, 8}) {
    for (const int levels : {-60, -16, 16, 140}) {
      for (const int rows : {1, 2}) {
        for (const auto& [x, y] : {std::pair{0, block}, {304, 240 - (rows + 1) * block}, {160, 14 * block}}) {
          *state = {};
          CHECK_TRUE(accepts_at(block, grey));
          const Picture shown = with_cell(x, y, 2 * block, rows * block, levels);
          CHECK_EQUAL(block < 4, accepts_at(block, shown));
          CHECK_TRUE(accepts_at(block, grey));
        }
      }
    }
  }
  *state = {};
  CHECK_TRUE(accepts_at(4, grey));
  CHECK_TRUE(accepts_at(4, with_cell(80, 101, 8, 4, 60)));   // a row lower than a block
  CHECK_TRUE(accepts_at(4, with_cell(80, 100, 8, 12, 60)));  // as high as three
  CHECK_TRUE(accepts_at(4, with_cell(80, 100, 3, 4, 60)));   // three of eight columns
  CHECK_TRUE(accepts_at(4, with_cell(80, 100, 8, 4, 6)));    // 6 of 16 levels
  const Picture scratched = with_cell(80, 100, 8, 4, 60);
  for (int frame = 0; frame < 6; ++frame) CHECK_EQUAL(frame >= config.patience, accepts_at(4, scratched));
}

// 6 px are 8.6 mm/s at 25 frames a second, in all dots at once; a jump may even be half a pitch.
TEST(PictureCheck, AcceptsAnyMotion) {
  for (const double step_px : {1.0, 6.0, 8.0, 14.6}) {
    for (int frame = 0; frame < 8; ++frame) {
      const double mm = step_px / view.px_per_mm * (frame % 4);
      CHECK_TRUE(accepts(picture(shifted(0.0, mm))));
      CHECK_TRUE(accepts(picture(shifted(mm, -mm))));
    }
  }
}

TEST(PictureCheck, AcceptsChangesOfLight) {
  CHECK_TRUE(accepts(picture()));
  for (const double gain : {0.5, 1.0, 2.0, 0.3, 1.7, 0.0, 1.0}) {
    Picture lit = picture();
    for (std::uint8_t& pixel : lit.pixels) pixel = static_cast<std::uint8_t>(std::min(255.0, pixel * gain));
    CHECK_TRUE(accepts(lit));
  }
  for (const int level : {0, 255, 128}) CHECK_TRUE(accepts(flat(view.width, view.height, static_cast<uint8_t>(level))));
}

// Edges that were there before hide nothing but a step of their own kind in their own rows. The gel's may move a row.
TEST(PictureCheck, AcceptsLinesThatAreInEveryFrame) {
  for (const int thick : {1, 2, 3, 5, 40}) {
    for (const int levels : {-50, 50}) {
      *state = {};
      const auto scratched = [&] { return with_line(picture(), 120, thick, levels); };
      for (int frame = 0; frame < 3; ++frame) CHECK_TRUE(accepts(scratched()));
      CHECK_FALSE(accepts(with_step(scratched(), 200, 60, 40)));
      CHECK_FALSE(accepts(with_step(scratched(), 200, 180, -levels)));
      CHECK_TRUE(accepts(scratched()));
      for (const int y : {121, 120, 119, 120}) CHECK_TRUE(accepts(with_line(picture(), y, thick, levels)));
      CHECK_TRUE(accepts(picture()));  // the hair is gone
    }
  }
}

// A thin line is as bright on both of its sides, so it is no step.
TEST(PictureCheck, BelievesAChangedSceneAfterItsPatience) {
  CHECK_TRUE(accepts(picture()));
  CHECK_TRUE(accepts(with_line(picture(), 120, 1, -50)));
  for (config.patience = 0; config.patience < 5; ++config.patience) {
    *state = {};
    CHECK_TRUE(accepts(picture()));
    for (int frame = 0; frame < config.patience; ++frame) CHECK_FALSE(accepts(with_line(picture(), 120, 30, -50)));
    for (int frame = 0; frame < 3; ++frame) CHECK_TRUE(accepts(with_line(picture(), 120, 30, -50)));
  }
  // An accepted picture ends the count.
  config.patience = 3;
  CHECK_TRUE(accepts(picture()));
  for (int round = 0; round < 3; ++round) {
    for (int frame = 0; frame < 3; ++frame) CHECK_FALSE(accepts(with_step(picture(), 10, 200, 50)));
    CHECK_TRUE(accepts(picture()));
  }
}

// What the header says it does not see, so that nobody relies on it.
TEST(PictureCheck, DoesNotSeeMisreadBlocksWithoutAStep) {
  CHECK_TRUE(accepts(picture()));
  Picture shown = picture();
  for (int x = 100; x < 130; ++x) add(shown, x, 150, x % 2 == 0 ? 80 : -80);
  CHECK_TRUE(accepts(shown));
  CHECK_TRUE(accepts(with_step(picture(), 0, 0, 60)));
}

TEST(PictureCheck, BeginsAnewWithAnotherSize) {
  CHECK_TRUE(accepts(picture()));
  const Picture other = with_step(flat(view.width, view.height - 1, 90), 0, 100, 60);
  CHECK_TRUE(accepts(other));
  CHECK_TRUE(accepts(flat(view.width, view.height - 1, 90)));
  CHECK_FALSE(accepts(other));
}

// Whatever is in them: no more than `patience` refusals in a row, and no row beyond the picture.
TEST(PictureCheck, TakesPicturesOfAnySizeAndContent) {
  std::mt19937 random(5);
  for (const auto& [width, height] :
       {std::pair{kMinLumaWidth, kMinLumaHeight}, {79, 49}, {80, 48}, {410, 308}, {kMaxLumaWidth, kMaxLumaHeight}}) {
    int refused = 0;
    for (int frame = 0; frame < 16; ++frame) {
      Picture shown = flat(width, height, 0);
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const auto noise = static_cast<int>(random() % 256);
          const std::array<int, 4> kinds{noise, y / (frame + 1) % 2 * 255, noise / 128 * 255, y < height / 2 ? 255 : 0};
          add(shown, x, y, kinds[static_cast<std::size_t>(frame % 4)]);
        }
      }
      refused = accepts(shown) ? 0 : refused + 1;
      CHECK_TRUE(refused <= config.patience);
    }
  }
}

TEST(PictureCheck, ReadsPaddedRows) {
  const Picture whole = picture();
  const Picture damaged = with_step(whole, 20, 90, 40);
  const auto padded = [&](const Picture& from, std::uint8_t padding) {
    Picture out = flat(from.width + 7, from.height, padding);
    for (int y = 0; y < from.height; ++y) {
      std::copy_n(from.pixels.begin() + y * from.width, from.width, out.pixels.begin() + y * out.width);
    }
    return out;
  };
  const auto check = [&](const Picture& from) {
    return picture_check::update(*state, config, {from.pixels.data(), view.width, view.height, from.width}, 1).ok();
  };
  CHECK_TRUE(check(padded(whole, 0)));
  CHECK_TRUE(check(padded(whole, 255)));
  CHECK_FALSE(check(padded(damaged, 0)));
}

TEST(PictureCheck, VectorFormGivesThePlainFormsIntegers) {
  std::mt19937 random(6);
  constexpr std::int32_t kMost = kMaxLumaWidth / picture_check::kGroup * picture_check::kGroup;
  std::array<std::array<std::uint8_t, kMost>, 4> rows{};
  const picture_check::Rows all{rows[0].data(), rows[1].data(), rows[2].data(), rows[3].data()};
  for (int round = 0; round < 600; ++round) {
    const unsigned spread = std::array{2u, 20u, 256u}[static_cast<std::size_t>(round % 3)];
    for (auto& row : rows) {
      for (std::uint8_t& pixel : row) pixel = static_cast<std::uint8_t>((100 + random() % spread) % 256);
      if (random() % 4 == 0) row.fill(random() % 2 == 0 ? 0 : 255);
    }
    const std::int32_t columns = round == 0 ? kMost : static_cast<std::int32_t>(random() % 102 + 1) * 16;
    const auto cap = static_cast<std::int32_t>(random() % picture_check::kMostCap) + 1;
    LONGS_EQUAL(picture_check::row_steps_scalar(all, columns, cap), picture_check::row_steps(all, columns, cap));
  }
  // The largest sums there are.
  rows[0].fill(0);
  rows[1].fill(0);
  rows[2].fill(255);
  rows[3].fill(255);
  LONGS_EQUAL(kMost * 16, picture_check::row_steps(all, kMost, 16));
  rows[0].fill(255);
  rows[1].fill(255);
  rows[2].fill(0);
  rows[3].fill(0);
  LONGS_EQUAL(-kMost * 16, picture_check::row_steps(all, kMost, 16));
}

// luma_input asks only where a pixel is a block and the dots are large enough.
TEST(PictureCheck, SeesAStepInTheMiddleOfARowAtEveryDecodeScale) {
  for (const std::int32_t block : {1, 2, 4, 8}) {
    for (const int rows_of_blocks : {1, 2}) {  // of an MCU: 4:2:2 and 4:2:0
      for (const int x : {0, 100, 200, 300}) {
        const auto accepts_after_whole = [&](int y) {
          const Picture damaged = with_step(picture(), x, y, 40, rows_of_blocks * block);
          picture_check::State fresh;
          const Picture whole = picture();
          CHECK_TRUE(picture_check::update(fresh, {}, whole.view(), block).ok());
          return picture_check::update(fresh, {}, damaged.view(), block).ok();
        };
        CHECK_FALSE(accepts_after_whole(80));
        CHECK_FALSE(accepts_after_whole(160));
        if (block > 2) CHECK_TRUE(accepts_after_whole(81));  // no fault of the decoder's begins inside a block
      }
    }
  }
}

TEST(PictureCheck, IsAskedAboutDecodedPicturesThatAreWideEnough) {
  const auto input = std::make_unique<luma_input::State>();
  test::PictureJpeg jpeg;
  LumaView out;
  const auto refuses = [&](hal::PixelFormat format, DecodeScale scale, std::int32_t announced, const Picture& whole) {
    const Picture damaged = with_step(whole, 30, 40, 60);
    input->width = input->height = 0;
    input->check = {};
    Reason reason = Reason::kNone;
    for (const Picture* shown : {&whole, &damaged}) {
      jpeg.picture = *shown;
      hal::Frame frame;
      frame.format = format;
      frame.bytes = shown->pixels;
      frame.width = announced;
      frame.height = frame.stride = shown->width;
      if (format == hal::PixelFormat::kLuma8) frame.height = shown->height;
      CHECK_TRUE(reason == Reason::kNone);
      reason = luma_input::update(*input, {scale, config}, jpeg, frame, out).reason;
    }
    CHECK_TRUE(reason == Reason::kNone || reason == Reason::kJpegDamaged);
    return reason == Reason::kJpegDamaged;
  };
  const Picture large = flat(410, 308, 100);
  const Picture small = flat(299, 224, 100);
  CHECK_TRUE(refuses(hal::PixelFormat::kMjpeg, DecodeScale::kEighth, 3280, large));
  CHECK_TRUE(refuses(hal::PixelFormat::kMjpeg, DecodeScale::kEighth, 0, large));  // not announced
  CHECK_FALSE(refuses(hal::PixelFormat::kMjpeg, DecodeScale::kEighth, 0, small));
  CHECK_TRUE(refuses(hal::PixelFormat::kMjpeg, DecodeScale::kEighth, 640, large));  // decoded at 1/2
  CHECK_TRUE(refuses(hal::PixelFormat::kMjpeg, DecodeScale::kQuarter, 3280, large));
  CHECK_FALSE(refuses(hal::PixelFormat::kLuma8, DecodeScale::kEighth, 410, large));
}
