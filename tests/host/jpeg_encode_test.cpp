// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/picture/jpeg_encode.hpp"

#include <cmath>
#include <cstddef>
#include <cstdio>

#include <jpeglib.h>

#include "drivers/sim/scene/picture/render.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/scene_pictures.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;

namespace {

using Bytes = std::vector<std::uint8_t>;

struct Header {
  int sof = -1, width = 0, height = 0;
  std::vector<int> sampling;  // H * 16 + V of each component
  bool restarts = false;
};

// Reads the markers up to the scan, by the standard's section B.1.1.4.
Header parse(const Bytes& jpeg) {
  Header header;
  for (std::size_t i = 2; i + 4 <= jpeg.size() && jpeg[i] == 0xff;) {
    const int marker = jpeg[i + 1];
    const std::size_t length = static_cast<std::size_t>(jpeg[i + 2]) * 256 + jpeg[i + 3];
    if (marker >= 0xc0 && marker <= 0xc2) {
      header.sof = marker - 0xc0;
      header.height = jpeg[i + 5] * 256 + jpeg[i + 6];
      header.width = jpeg[i + 7] * 256 + jpeg[i + 8];
      for (int c = 0; c < jpeg[i + 9]; ++c) header.sampling.push_back(jpeg[i + 11 + static_cast<std::size_t>(c) * 3]);
    }
    if (marker == 0xdd) header.restarts = true;
    if (marker == 0xda) break;
    i += 2 + length;
  }
  return header;
}

Bytes decode(const Bytes& jpeg) {
  jpeg_decompress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&info);
  jpeg_mem_src(&info, jpeg.data(), static_cast<unsigned long>(jpeg.size()));
  jpeg_read_header(&info, TRUE);
  jpeg_start_decompress(&info);
  const std::size_t stride =
      static_cast<std::size_t>(info.output_width) * static_cast<std::size_t>(info.output_components);
  Bytes pixels(stride * info.output_height);
  while (info.output_scanline < info.output_height) {
    JSAMPROW row = pixels.data() + info.output_scanline * stride;
    jpeg_read_scanlines(&info, &row, 1);
  }
  jpeg_finish_decompress(&info);
  jpeg_destroy_decompress(&info);
  return pixels;
}

double psnr_db(const Bytes& a, const Bytes& b) {
  double square = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) square += (a[i] - b[i]) * (a[i] - b[i]);
  return 10.0 * std::log10(255.0 * 255.0 * static_cast<double>(a.size()) / square);
}

}  // namespace

TEST_GROUP(JpegEncode){};

TEST(JpegEncode, ColourIsBaseline422AndDecodes) {
  PictureConfig config = cropped_320x240();
  config.noise_sigma = 0.0;
  const auto sliding = holdfast::test::views_of(sphere_slip(), config)[50];  // at 2.0 s
  Bytes pixels;
  render_rgb(config, sliding.dots, nullptr, 1, pixels);
  const Bytes jpeg = encode_jpeg(pixels, config.width, config.height, JpegInput::kRgb, 85);
  const Header header = parse(jpeg);
  LONGS_EQUAL(0, header.sof);
  LONGS_EQUAL(320, header.width);
  LONGS_EQUAL(240, header.height);
  CHECK((header.sampling == std::vector<int>{0x21, 0x11, 0x11}));
  CHECK_FALSE(header.restarts);
  const Bytes back = decode(jpeg);
  LONGS_EQUAL(pixels.size(), back.size());
  CHECK(psnr_db(pixels, back) > 34.0);  // dB; quality 85 on soft edges, chroma halved
  CHECK(psnr_db(pixels, decode(encode_jpeg(pixels, 320, 240, JpegInput::kRgb, 30))) < psnr_db(pixels, back));
}

TEST(JpegEncode, GreyIsOneComponent) {
  PictureConfig config = cropped_320x240();
  Bytes pixels;
  render_luma(config, {}, nullptr, 1, pixels);
  const Bytes jpeg = encode_jpeg(pixels, config.width, config.height, JpegInput::kGrey, 95);
  CHECK((parse(jpeg).sampling == std::vector<int>{0x11}));
  CHECK(psnr_db(pixels, decode(jpeg)) > 38.0);  // dB; noise of sigma 2.5 quantised in steps of 1 to 10
}

TEST(JpegEncode, PictureThatDoesNotCompressStillFits) {
  Bytes pixels(std::size_t{3} * 640 * 480);
  std::uint32_t state = 1;
  for (std::uint8_t& p : pixels) p = static_cast<std::uint8_t>((state = state * 1664525u + 1013904223u) >> 24);
  const Bytes jpeg = encode_jpeg(pixels, 640, 480, JpegInput::kRgb, 100);
  CHECK(jpeg.size() > pixels.size() / 4);
  LONGS_EQUAL(pixels.size(), decode(jpeg).size());
}

TEST(JpegEncode, RefusesWhatIsNoPicture) {
  const Bytes pixels(300);
  CHECK(encode_jpeg(pixels, 10, 11, JpegInput::kRgb, 85).empty());
  CHECK(encode_jpeg(pixels, 0, 10, JpegInput::kRgb, 85).empty());
  CHECK(encode_jpeg(pixels, 10, -1, JpegInput::kRgb, 85).empty());
  CHECK(encode_jpeg(pixels, 10, 10, JpegInput::kRgb, 0).empty());
  CHECK(encode_jpeg(pixels, 10, 10, JpegInput::kRgb, 101).empty());
  CHECK(encode_jpeg(pixels, 70000, 1, JpegInput::kGrey, 85).empty());
  CHECK_FALSE(encode_jpeg(pixels, 10, 10, JpegInput::kRgb, 85).empty());
}
