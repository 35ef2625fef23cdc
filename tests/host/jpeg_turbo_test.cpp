// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/jpeg_turbo.hpp"

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

#include "drivers/sim/media.hpp"
#include "tests/support/host_jpeg_streams.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::test;

namespace {

constexpr DecodeScale kScales[] = {DecodeScale::kFull, DecodeScale::kHalf, DecodeScale::kQuarter, DecodeScale::kEighth};
// Of frame header (SOF0) and scan header (SOS), counted from the marker.
constexpr std::size_t kPrecision = 4, kHeight = 5, kWidth = 7, kComponents = 9;

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
  (void)sim::media().encode(".jpg", image, bytes, options);
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
cv::Mat straight_decode(const Bytes& bytes, unsigned denominator, boolean fancy_upsampling) {
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
  decoder.do_fancy_upsampling = fancy_upsampling;
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
  drivers::TurboJpegDecoder decoder;
  std::unique_ptr<LumaBuffer> out = std::make_unique<LumaBuffer>();

  Reason decode(const Bytes& bytes, DecodeScale scale = DecodeScale::kFull) {
    return decoder.decode(bytes, scale, *out).reason;
  }
  // The library's default is fancy upsampling. Luma that is the finest component is not upsampled at all.
  void check_equals_straight(const Bytes& bytes, DecodeScale scale, boolean fancy_upsampling = TRUE) {
    CHECK(decode(bytes, scale) == Reason::kNone);
    const cv::Mat expected = straight_decode(bytes, static_cast<unsigned>(scale), fancy_upsampling);
    LONGS_EQUAL(expected.cols, out->width);
    LONGS_EQUAL(expected.rows, out->height);
    CHECK(std::equal(expected.data, expected.data + expected.total(), out->pixels.data()));  // MEMCMP_EQUAL would print
  }
};

TEST(TurboJpegDecoder, EqualsAStraightDecodeAtEveryScale) {
  const cv::Mat colour = picture(1283, 963, 3), grey = picture(1283, 963, 1);
  const Bytes streams[] = {encode(colour), encode(grey), encode(colour, {cv::IMWRITE_JPEG_RST_INTERVAL, 5}),
                           encode_as(1283, 963, 3, JCS_RGB)};
  for (const Bytes& bytes : streams) {
    for (const auto scale : kScales) check_equals_straight(bytes, scale);
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
  for (const auto& options : {std::vector<int>{}, std::vector<int>{cv::IMWRITE_JPEG_RST_INTERVAL, 2}}) {
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

TEST(TurboJpegDecoder, RefusesWhatNeedsThePictureTwiceOrIsOfAnotherKind) {
  Recipe recipe;
  recipe.width = recipe.height = 600;
  const Bytes whole = test::encode(recipe);
  recipe.progressive = true;
  const Bytes progressive = test::encode(recipe);
  recipe.progressive = false;
  recipe.scan_per_component = true;
  const Bytes three_scans = test::encode(recipe);
  const std::size_t frame = find_segment(whole, 0xC0);
  for (const auto scale : kScales) {
    CHECK(decode(progressive, scale) == Reason::kFrameFormat);
    CHECK(decode(three_scans, scale) == Reason::kFrameFormat);
    // Lossless, hierarchical, arithmetic, and their mixtures; 0xC4, 0xC8 and 0xCC are other markers.
    for (const int marker : {0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}) {
      CHECK(decode(changed(whole, frame + 1, marker), scale) == Reason::kFrameFormat);
    }
    for (const int bits : {2, 7, 12, 16}) {
      CHECK(decode(changed(whole, frame + kPrecision, bits), scale) == Reason::kFrameFormat);
    }
    for (const int sampling : {0x01, 0x10, 0x51, 0x15, 0x44}) {  // 0x44: 18 blocks to the MCU
      CHECK(decode(changed(whole, frame + kComponents + 2, sampling), scale) == Reason::kFrameFormat);
    }
    check_equals_straight(whole, scale);
    check_equals_straight(changed(whole, frame + 1, 0xC1), scale);  // extended sequential: no difference at 8 bits
  }
}

TEST(TurboJpegDecoder, RefusesHostileSizesBeforeItTakesMemoryForThem) {
  const Bytes whole = test::encode({});
  const std::size_t frame = find_segment(whole, 0xC0);
  const auto sized = [&](int width, int height) {
    return changed(changed(changed(changed(whole, frame + kWidth, width >> 8), frame + kWidth + 1, width & 255),
                           frame + kHeight, height >> 8),
                   frame + kHeight + 1, height & 255);
  };
  for (const auto scale : kScales) {
    CHECK(decode(sized(65500, 65500), scale) == Reason::kPictureTooLarge);
    CHECK(decode(sized(65501, 64), scale) == Reason::kPictureTooLarge);
    CHECK(decode(sized(65535, 65535), scale) == Reason::kPictureTooLarge);
    CHECK(decode(sized(65500, 1), scale) == Reason::kPictureTooLarge);
    CHECK(decode(sized(1, 65500), scale) == Reason::kPictureTooLarge);
    CHECK(decode(sized(0, 48), scale) == Reason::kJpegDamaged);
    CHECK(decode(sized(64, 0), scale) == Reason::kJpegDamaged);
  }
  // As many components as a byte can say; each costs the library 96 bytes before it refuses.
  Bytes crowd = changed(changed(changed(whole, frame + 2, (8 + 255 * 3) >> 8), frame + 3, (8 + 255 * 3) & 255),
                        frame + kComponents, 255);
  crowd = inserted(crowd, frame + 19, Bytes(252 * 3, 0x11));
  CHECK(decode(crowd) == Reason::kFrameFormat);
  CHECK(decoder.most_used().picture < 32 * 1024);
  check_equals_straight(whole, DecodeScale::kFull);
}

TEST(TurboJpegDecoder, HasRoomForTheWidestStripThatTheFormatAllows) {
  Recipe recipe;
  recipe.content = Content::kRamp;
  recipe.height = 512;
  for (const auto& sampling :
       {std::vector<Sampling>{{1, 4}, {1, 4}, {1, 2}}, std::vector<Sampling>{{2, 1}, {4, 1}, {4, 1}},
        std::vector<Sampling>{{1, 4}, {1, 1}, {1, 1}}, std::vector<Sampling>{{4, 4}},
        std::vector<Sampling>{{1, 1}, {2, 2}, {2, 2}}, std::vector<Sampling>{{2, 4}, {1, 1}, {1, 1}}}) {
    recipe.sampling = sampling;
    for (const auto colours : {Colours::kGreyOrYcbcr, Colours::kRgb}) {
      if (sampling.size() == 1 && colours == Colours::kRgb) continue;
      recipe.colours = colours;
      for (const auto scale : kScales) {
        recipe.width = kMaxLumaWidth * static_cast<int>(scale);
        check_equals_straight(test::encode(recipe), scale, FALSE);
      }
    }
  }
  // The strip of the first: ten blocks of 64 samples for every 8 of 1640 pixels, in rows of 1664.
  CHECK(decoder.most_used().picture > 80 * 1664);
  CHECK(decoder.most_used().picture < drivers::TurboJpegDecoder::kMemory.picture * 3 / 4);
}

TEST(TurboJpegDecoder, MemoryDoesNotGrowFromPictureToPicture) {
  const auto fresh_out = std::make_unique<LumaBuffer>();
  Random random(8);
  for (unsigned round = 0; round < 1000; ++round) {
    Recipe recipe;
    if (round % 3 != 0) {
      recipe.tables = Tables::kShuffled;
      recipe.table_offset = static_cast<int>(round % 2) * 2;
    }
    recipe.own_quant = round % 5 != 0;
    if (round % 7 == 0) recipe.sampling = {{1, 1}};
    const Bytes bytes = test::encode(recipe, random);
    CHECK(decode(bytes) == Reason::kNone);
    drivers::TurboJpegDecoder fresh;
    CHECK(fresh.decode(bytes, DecodeScale::kFull, *fresh_out).ok());
    MEMCMP_EQUAL(fresh_out->pixels.data(), out->pixels.data(), 64 * 48);
    CHECK(decode(Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(random() % bytes.size()))) ==
          Reason::kJpegDamaged);
  }
  // Eight Huffman tables, for the standard ones fill the slots that a picture leaves empty; two divisors; the source.
  LONGS_EQUAL(8 * 320 + 2 * 192 + 64, decoder.most_used().tables);
}

TEST(TurboJpegDecoder, HasRoomForEveryTableThatTheFormatKnows) {
  const Bytes whole = test::encode({});
  Bytes bytes = whole;
  for (const Segment& segment : segments(whole)) {
    if (segment.marker != 0xDB && segment.marker != 0xC4) continue;
    const auto begin = whole.begin() + static_cast<std::ptrdiff_t>(segment.at);
    Bytes copy(begin, begin + static_cast<std::ptrdiff_t>(segment.size));
    copy[4] = static_cast<std::uint8_t>(copy[4] + 2);  // slots 0 and 1 become 2 and 3
    for (int times = 0; times < 3; ++times) bytes = inserted(bytes, find_segment(whole, 0xDB), copy);
  }
  check_equals_straight(bytes, DecodeScale::kFull);
  LONGS_EQUAL(8 * 320 + 4 * 192 + 64, decoder.most_used().tables);
  CHECK(decoder.most_used().tables <= drivers::TurboJpegDecoder::kMemory.tables / 2);
}

TEST(TurboJpegDecoder, ForgetsThePictureBefore) {
  Recipe recipe;
  const Bytes standard = test::encode(recipe);
  const Bytes without_codes = without(standard, 0xC4), without_divisors = without(standard, 0xDB);
  recipe.tables = Tables::kShuffled;
  const Bytes shuffled = test::encode(recipe);
  CHECK(decode(standard) == Reason::kNone);
  const Bytes expected(out->pixels.begin(), out->pixels.begin() + 64 * 48);
  for (const Bytes& before : {standard, shuffled, Bytes(shuffled.begin(), shuffled.begin() + 400)}) {
    (void)decode(before);
    CHECK(decode(without_divisors) == Reason::kJpegDamaged);
    (void)decode(before);
    CHECK(decode(without_codes) == Reason::kNone);  // as cameras send it: the standard codes
    MEMCMP_EQUAL(expected.data(), out->pixels.data(), expected.size());
  }
}
