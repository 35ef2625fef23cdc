// SPDX-License-Identifier: Apache-2.0
// Writes the film that the emulated camera shows: the scene sphere_slip as the sensor's 3280x2464 pictures, one behind
// the other. At rest until frame 12, pressed until 27, held until 38, sliding until 60, released until 70, at rest to
// the end.
//   system_film FILE.mjpg
//
// The emulated machine decodes about ten times more slowly than its host, so pictures have to be small: little noise, a
// low quality, and Huffman tables made for each picture (the standard ones cannot go below 158 kB at this size). The
// noise is not 0, because pictures of a gel at rest that do not differ are a frozen camera's. A picture over 150 kB is
// an error.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <vector>

#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/scene/picture/render.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/scene_pictures.hpp"
#include "tests/system/recode.hpp"

namespace {

using namespace holdfast;
using Jpeg = std::vector<std::uint8_t>;

constexpr std::size_t kMostBytes = 150'000;
constexpr double kNoise = 1.5;
constexpr int kQuality = 60;

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: system_film FILE.mjpg\n", stderr);
    return 2;
  }
  scene::PictureConfig config = scene::camera_3280x2464();
  config.noise_sigma = kNoise;
  std::ofstream file(argv[1], std::ios::binary);
  std::size_t total = 0, longest = 0;
  std::uint64_t frame = 0;
  std::vector<std::uint8_t> rgb;
  for (const test::SceneView& view : test::views_of(scene::sphere_slip(), config)) {
    scene::render_rgb(config, view.dots, &view.imprint, ++frame, rgb);
    const Jpeg jpeg =
        test::recoded(scene::encode_jpeg(rgb, config.width, config.height, scene::JpegInput::kRgb, kQuality), 0);
    file.write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size()));
    total += jpeg.size();
    longest = std::max(longest, jpeg.size());
  }
  file.close();
  if (!file || longest > kMostBytes) {
    std::fprintf(stderr, "error: %s: %s. Next: %s\n", argv[1],
                 file ? "a picture is longer than 150000 bytes" : "cannot be written (no such folder, or no space)",
                 file ? "lower noise or quality in tests/system/film_main.cpp" : "give a folder that can be written");
    return 1;
  }
  std::printf("%s: %llu pictures, %zu kB each, the longest %zu kB\n", argv[1], static_cast<unsigned long long>(frame),
              total / static_cast<std::size_t>(frame) / 1000, longest / 1000);
  return 0;
}
