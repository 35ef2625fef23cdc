// SPDX-License-Identifier: Apache-2.0
// jpeg_cost PICTURE WALK N: decodes one picture to luma at 1/8 N times; for the instruction counter, which takes the
// difference of two runs. PICTURE is a file (jpeg_bench --write makes some), or "scene": what the simulated sensor
// sees, 3280x2464, 4:2:2, quality 85, noise 3. WALK is plain, the lanes of the fast walk on one thread (1, 2, 3), or
// library (libjpeg-turbo). Prints a checksum of the luma, which is the same for all walks and on all processors, and
// the mean CPU time.
//
// Exit status: 0 all decoded, 1 not, 2 wrong arguments.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/scene/picture/render.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "toolchain/play/thread_time.hpp"
#include "vision/jpeg_dc.hpp"
#include "vision/jpeg_fast.hpp"

namespace {

using namespace holdfast;

// Empty: it cannot be read.
std::vector<std::uint8_t> picture(const std::string& name) {
  if (name != "scene") {
    std::ifstream file(name, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  scene::PictureConfig config = scene::camera_3280x2464();
  config.noise_sigma = 3;
  const auto dots = scene::dot_centers_px(config, scene::Simulation({}).markers());
  std::vector<std::uint8_t> rgb;
  scene::render_rgb(config, dots, nullptr, 1, rgb);
  return scene::encode_jpeg(rgb, config.width, config.height, scene::JpegInput::kRgb, 85);
}

// Adler-32.
std::uint32_t checksum(const LumaBuffer& luma) {
  std::uint32_t a = 1, b = 0;
  for (std::int32_t i = 0; i < luma.width * luma.height; ++i) {
    a = (a + luma.pixels[static_cast<std::size_t>(i)]) % 65521;
    b = (b + a) % 65521;
  }
  return b << 16 | a;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view walk = argc == 4 ? argv[2] : "";
  constexpr std::array<std::string_view, 5> kWalks{"plain", "1", "2", "3", "library"};
  if (std::find(kWalks.begin(), kWalks.end(), walk) == kWalks.end()) {
    std::fputs("usage: jpeg_cost FILE|scene plain|1|2|3|library N\n", stderr);
    return 2;
  }
  const std::vector<std::uint8_t> bytes = picture(argv[1]);
  if (bytes.empty()) {
    std::fprintf(stderr, "error: %s: cannot be read (not there, or empty). Next: give a JPEG file, or \"scene\"\n",
                 argv[1]);
    return 1;
  }
  const long n = std::atol(argv[3]);
  const auto out = std::make_unique<LumaBuffer>();
  const auto plain = std::make_unique<jpeg_dc::State>();
  const auto fast = std::make_unique<jpeg_fast::State>();
  std::vector<jpeg_fast::Worker> workers(1);
  jpeg_fast::Config config;
  config.lanes = std::max(1, std::atoi(argv[2]));
  hal::Alone alone;
  drivers::TurboJpegDecoder library;
  const double start = tool::thread_us();
  for (long i = 0; i < n; ++i) {
    const Status status = walk == "plain"     ? jpeg_dc::decode(*plain, bytes, *out)
                          : walk == "library" ? library.decode(bytes, DecodeScale::kEighth, *out)
                                              : jpeg_fast::decode(*fast, config, workers, alone, bytes, *out);
    if (!status.ok()) {
      std::fprintf(stderr, "error: %s: refused (%s). Next: give a whole JPEG file, or \"scene\"\n", argv[1],
                   std::string(info(status.reason).what).c_str());
      return 1;
    }
  }
  const double us = (tool::thread_us() - start) / static_cast<double>(std::max(1L, n));
  std::printf("%zu bytes to %dx%d, checksum %08x, by the plain walk %u; %.1f us each\n", bytes.size(), out->width,
              out->height, checksum(*out), fast->counts.by_plain_walk, us);
  return 0;
}
