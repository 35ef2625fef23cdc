// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/jpeg_turbo.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include <jpeglib.h>

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

using Bytes = std::vector<std::uint8_t>;

cv::Mat picture(int width, int height, int channels) {
  cv::Mat image(height, width, CV_MAKETYPE(CV_8U, channels));
  cv::RNG rng(7);
  rng.fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, cv::Size(9, 9), 2);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

Bytes encode(const cv::Mat& image, std::vector<int> options = {}) {
  Bytes bytes;
  cv::imencode(".jpg", image, bytes, options);
  return bytes;
}

// Raw components as they are, in the colour space told (imencode knows grey and YCbCr only).
Bytes encode_as(int width, int height, int components, J_COLOR_SPACE space) {
  jpeg_compress_struct encoder{};
  jpeg_error_mgr errors{};
  encoder.err = jpeg_std_error(&errors);
  jpeg_create_compress(&encoder);
  unsigned char* memory = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&encoder, &memory, &size);
  encoder.image_width = static_cast<JDIMENSION>(width);
  encoder.image_height = static_cast<JDIMENSION>(height);
  encoder.input_components = components;
  encoder.in_color_space = space;
  jpeg_set_defaults(&encoder);
  jpeg_set_colorspace(&encoder, space);
  jpeg_start_compress(&encoder, TRUE);
  Bytes row(static_cast<std::size_t>(width * components));
  for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<std::uint8_t>(i * 3);
  JSAMPROW rows = row.data();
  while (encoder.next_scanline < encoder.image_height) jpeg_write_scanlines(&encoder, &rows, 1);
  jpeg_finish_compress(&encoder);
  Bytes bytes(memory, memory + size);
  jpeg_destroy_compress(&encoder);
  std::free(memory);
  return bytes;
}

// The straight use of the library, as in its own example.c, from stdio instead of memory.
cv::Mat straight_decode(const Bytes& bytes, unsigned denominator) {
  std::FILE* file = std::tmpfile();
  std::fwrite(bytes.data(), 1, bytes.size(), file);
  std::rewind(file);
  jpeg_decompress_struct decoder{};
  jpeg_error_mgr errors{};
  decoder.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&decoder);
  jpeg_stdio_src(&decoder, file);
  jpeg_read_header(&decoder, TRUE);
  decoder.out_color_space = JCS_GRAYSCALE;
  decoder.scale_num = 1;
  decoder.scale_denom = denominator;
  jpeg_start_decompress(&decoder);
  cv::Mat grey(static_cast<int>(decoder.output_height), static_cast<int>(decoder.output_width), CV_8UC1);
  while (decoder.output_scanline < decoder.output_height) {
    JSAMPROW row = grey.ptr<std::uint8_t>(static_cast<int>(decoder.output_scanline));
    jpeg_read_scanlines(&decoder, &row, 1);
  }
  jpeg_finish_decompress(&decoder);
  jpeg_destroy_decompress(&decoder);
  std::fclose(file);
  return grey;
}

}  // namespace

TEST_GROUP(TurboJpegDecoder) {
  sim::TurboJpegDecoder decoder;
  std::unique_ptr<LumaBuffer> out = std::make_unique<LumaBuffer>();

  Reason decode(const Bytes& bytes, DecodeScale scale = DecodeScale::kFull) {
    return decoder.decode(bytes, scale, *out).reason;
  }
  void check_equals_straight(const Bytes& bytes, DecodeScale scale) {
    CHECK(decode(bytes, scale) == Reason::kNone);
    const cv::Mat expected = straight_decode(bytes, static_cast<unsigned>(scale));
    LONGS_EQUAL(expected.cols, out->width);
    LONGS_EQUAL(expected.rows, out->height);
    MEMCMP_EQUAL(expected.data, out->pixels.data(), expected.total());
  }
};

TEST(TurboJpegDecoder, EqualsAStraightDecodeAtEveryScale) {
  const cv::Mat colour = picture(1283, 963, 3), grey = picture(1283, 963, 1);
  const Bytes streams[] = {encode(colour), encode(grey), encode(colour, {cv::IMWRITE_JPEG_RST_INTERVAL, 5}),
                           encode(colour, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), encode_as(1283, 963, 3, JCS_RGB)};
  for (const Bytes& bytes : streams) {
    for (const auto scale : {DecodeScale::kFull, DecodeScale::kHalf, DecodeScale::kQuarter, DecodeScale::kEighth}) {
      check_equals_straight(bytes, scale);
    }
  }
}

TEST(TurboJpegDecoder, DecodesTheCamerasFullSizeAtOneEighth) {
  check_equals_straight(encode(picture(3280, 2464, 3)), DecodeScale::kEighth);
  LONGS_EQUAL(410, out->width);
  LONGS_EQUAL(308, out->height);
}

TEST(TurboJpegDecoder, LumaIsThePictureItself) {
  const cv::Mat grey = picture(320, 240, 1);
  CHECK(decode(encode(grey, {cv::IMWRITE_JPEG_QUALITY, 100})) == Reason::kNone);
  int worst = 0;
  for (int i = 0; i < 320 * 240; ++i) {
    worst = std::max(worst, std::abs(grey.data[i] - out->pixels[static_cast<std::size_t>(i)]));
  }
  CHECK(worst <= 2);  // quality 100 quantises each of 64 coefficients to 1: a grey level or two in the worst pixel
}

TEST(TurboJpegDecoder, RefusesTruncationAnywhere) {
  for (const auto& options : {std::vector<int>{}, std::vector<int>{cv::IMWRITE_JPEG_PROGRESSIVE, 1},
                              std::vector<int>{cv::IMWRITE_JPEG_RST_INTERVAL, 2}}) {
    const Bytes whole = encode(picture(640, 480, 3), options);
    for (const auto scale : {DecodeScale::kFull, DecodeScale::kEighth}) {
      for (std::size_t sixteenth = 0; sixteenth < 16; ++sixteenth) {
        CHECK(decode(Bytes(whole.begin(), whole.begin() + static_cast<long>(whole.size() * sixteenth / 16)), scale) ==
              Reason::kJpegDamaged);
      }
      CHECK(decode(Bytes(whole.begin(), whole.end() - 2), scale) == Reason::kJpegDamaged);  // only EOI is missing
      CHECK(decode(whole, scale) == Reason::kNone);  // the decoder is as good as new after each failure
    }
  }
}

TEST(TurboJpegDecoder, RefusesLostPayload) {
  const Bytes whole = encode(picture(640, 480, 3));
  std::mt19937 random(3);
  int refused = 0;
  for (int round = 0; round < 100; ++round) {
    Bytes torn = whole;
    const auto at = static_cast<long>(700 + random() % (whole.size() - 1300));
    torn.erase(torn.begin() + at, torn.begin() + at + 512);
    refused += decode(torn) == Reason::kJpegDamaged ? 1 : 0;
  }
  CHECK(refused >= 90);  // the library notices nearly all; the tracker must survive the rest
}

TEST(TurboJpegDecoder, RefusesGarbageAndEmptyInput) {
  CHECK(decode({}) == Reason::kJpegDamaged);
  CHECK(decode({0xFF}) == Reason::kJpegDamaged);
  CHECK(decode({0xFF, 0xD8, 0xFF, 0xD9}) == Reason::kJpegDamaged);
  std::mt19937 random(4);
  const Bytes whole = encode(picture(160, 120, 3));
  for (int round = 0; round < 500; ++round) {
    Bytes bytes(1000);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    CHECK(decode(bytes) == Reason::kJpegDamaged);
    Bytes flipped = whole;  // any verdict is allowed here, a crash is not
    flipped[random() % flipped.size()] = static_cast<std::uint8_t>(random());
    (void)decode(flipped);
  }
  CHECK(decode(whole) == Reason::kNone);
}

TEST(TurboJpegDecoder, RefusesWhatDoesNotFit) {
  const Bytes big = encode(picture(1641, 100, 3));
  CHECK(decode(big) == Reason::kPictureTooLarge);
  CHECK(decode(big, DecodeScale::kHalf) == Reason::kNone);
  CHECK(decode(encode(picture(100, 1233, 3))) == Reason::kPictureTooLarge);
  CHECK(decode(encode(picture(kMaxLumaWidth, kMaxLumaHeight, 1))) == Reason::kNone);
  CHECK(decode(encode(picture(63, 48, 1))) == Reason::kPictureTooSmall);
  CHECK(decode(encode(picture(64, 47, 1))) == Reason::kPictureTooSmall);
  CHECK(decode(encode(picture(64, 48, 1))) == Reason::kNone);
  CHECK(decode(encode(picture(1, 1, 3))) == Reason::kPictureTooSmall);
  CHECK(decode(encode(picture(320, 240, 3)), DecodeScale::kEighth) == Reason::kPictureTooSmall);
}

TEST(TurboJpegDecoder, RefusesOtherColourSpaces) {
  CHECK(decode(encode_as(320, 240, 4, JCS_CMYK)) == Reason::kFrameFormat);
  CHECK(decode(encode_as(320, 240, 4, JCS_YCCK)) == Reason::kFrameFormat);
  CHECK(decode(encode_as(320, 240, 2, JCS_UNKNOWN)) == Reason::kFrameFormat);
  CHECK(decode(encode_as(320, 240, 1, JCS_GRAYSCALE)) == Reason::kNone);
}
