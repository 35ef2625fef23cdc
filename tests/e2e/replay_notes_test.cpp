// SPDX-License-Identifier: Apache-2.0
// What replay says of pictures in which a compression can pass for a motion.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/picture_clip.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;

TEST_GROUP(ReplayNotes) {
  test::TempDir dir;
  test::ScenePictures drawn = test::film(test::press_scene(0.4), scene::cropped_320x240());

  // A gel that nothing touches: cut to so many columns, each pixel `times` as wide and high, JPEG of this quality.
  std::string said_of(int columns, int times, int quality) {
    const test::Finished run = replay(columns, times, quality);
    STRCMP_EQUAL("", run.err.c_str());
    return run.out;
  }
  test::Finished replay(int columns, int times, int quality) {
    const std::filesystem::path clip = dir / "clip.mjpg";
    std::ofstream out(clip, std::ios::binary);
    for (const LumaView& view : drawn.views) {
      const int width = columns * times, height = view.height * times;
      std::vector<std::uint8_t> pixels;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) pixels.push_back(view.data[y / times * view.stride + x / times]);
      }
      const std::vector<std::uint8_t> jpeg =
          scene::encode_jpeg(pixels, width, height, scene::JpegInput::kGrey, quality);
      out.write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size()));
    }
    out.close();
    return test::run({test::kTool, "replay", clip.string(), "--reference", "first"});
  }
};

TEST(ReplayNotes, OfASmallPicture) {
  STRCMP_CONTAINS("The pictures are 316 x 240: below 320 x 240", said_of(316, 1, 95).c_str());
  CHECK(said_of(320, 1, 95).find("The pictures") == std::string::npos);
}

// libjpeg's number of the quality, read back from the quantisation.
TEST(ReplayNotes, OfAStrongCompression) {
  for (const auto& [times, quality] : std::vector<std::pair<int, int>>{{1, 84}, {1, 40}, {2, 69}, {2, 30}}) {
    const std::string said = "JPEG of quality " + std::to_string(quality) + " of 100";
    STRCMP_CONTAINS(said.c_str(), said_of(320, times, quality).c_str());
  }
  for (const auto& [times, quality] : std::vector<std::pair<int, int>>{{1, 86}, {1, 95}, {2, 71}}) {
    CHECK(said_of(320, times, quality).find("JPEG of quality") == std::string::npos);
  }
}

// Each picture with more noise of its own, uniform in +-`most`: a standard deviation of most / sqrt(3), 3.7 for 6. The
// camera's is 2.5: the root of the sum of squares is 4.5.
TEST(ReplayNotes, OfANoisyPicture) {
  const auto said_with = [&](int most) {
    auto noisy = test::film(test::press_scene(0.4), scene::cropped_320x240());
    std::mt19937 random(1);
    for (auto& picture : noisy.pixels) {
      for (std::uint8_t& pixel : picture) {
        const int off = static_cast<int>(random() % static_cast<unsigned>(2 * most + 1)) - most;
        pixel = static_cast<std::uint8_t>(std::clamp(pixel + off, 0, 255));
      }
    }
    std::swap(drawn, noisy);
    std::string said = said_of(320, 1, 100);
    std::swap(drawn, noisy);
    return said;
  };
  STRCMP_CONTAINS("a pixel strays by 4.5 grey levels", said_with(6).c_str());
  CHECK(said_with(1).find("noisy") == std::string::npos);
}

// The markers in the middle are painted over. "Another size than configured" would be the wrong word.
TEST(ReplayNotes, OfALatticeWithGaps) {
  const LumaView& view = drawn.views[0];
  for (int y = 60; y < 180; ++y) {
    for (int x = 100; x < 220; ++x) drawn.pixels[0][static_cast<std::size_t>(y * view.stride + x)] = drawn.pixels[0][0];
  }
  const test::Finished run = replay(320, 1, 95);
  LONGS_EQUAL(1, run.status);
  STRCMP_CONTAINS("a lattice of 9x7 is there, with too many gaps", run.err.c_str());
}
