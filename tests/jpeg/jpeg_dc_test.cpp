// SPDX-License-Identifier: Apache-2.0
// The plain decoder against libjpeg-turbo: equal where it accepts, and every reason of refusal by name.
#include "vision/jpeg_dc.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/scene/picture/render.hpp"
#include "tests/support/host_jpeg_streams.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::test;
using jpeg_dc::Error;

namespace {

constexpr jpeg_dc::Limits kAnySize{1, 1};

}  // namespace

TEST_GROUP(JpegDc) {
  std::unique_ptr<jpeg_dc::State> state = std::make_unique<jpeg_dc::State>();
  std::unique_ptr<LumaBuffer> out = std::make_unique<LumaBuffer>();

  Error decode(const Bytes& bytes) {
    const Status status = jpeg_dc::decode(*state, bytes, *out, kAnySize);
    CHECK(status.reason == jpeg_dc::info(state->error).reason);
    return state->error;
  }
  void check_error(Error expected, const Bytes& bytes) {
    STRCMP_EQUAL(std::string(jpeg_dc::info(expected).name).c_str(),
                 std::string(jpeg_dc::info(decode(bytes)).name).c_str());
  }
  bool equals(const Oracle& oracle) const {
    return oracle.width == out->width && oracle.height == out->height &&
           std::equal(oracle.pixels.begin(), oracle.pixels.end(), out->pixels.begin());
  }
  // Both accept, and every pixel is the same.
  void check_identical(const Bytes& bytes, unsigned seed = 0) {
    Oracle oracle;
    const bool clean = oracle.decode(bytes);
    const Error error = decode(bytes);
    if (clean && error == Error::kNone && equals(oracle)) return;
    FAIL(StringFromFormat("seed %u: library %s, ours %s, pixels %s", seed, clean ? "accepts" : "refuses",
                          std::string(jpeg_dc::info(error).name).c_str(), equals(oracle) ? "equal" : "differ")
             .asCharString());
  }
  // Refused, or accepted by the library without a warning and equal to it. Returns whether it was accepted.
  bool check_safe(const Bytes& bytes, std::size_t position) {
    if (decode(bytes) != Error::kNone) return false;
    Oracle oracle;
    if (!oracle.decode(bytes) || !equals(oracle)) {
      FAIL(StringFromFormat("accepted, but not as the library does: byte %u", static_cast<unsigned>(position))
               .asCharString());
    }
    return true;
  }
};

TEST(JpegDc, EqualsTheLibraryOnGeneratedStreams) {
  for (unsigned seed = 1; seed <= 6000; ++seed) check_identical(any_stream(seed), seed);
}

TEST(JpegDc, EqualsTheLibraryOnEverySmallSize) {
  for (const Sampling luma : {Sampling{1, 1}, {2, 1}, {2, 2}, {1, 2}, {4, 1}}) {
    Recipe recipe;
    recipe.sampling = {luma, {1, 1}, {1, 1}};
    for (recipe.width = 1; recipe.width <= 34; recipe.width += 3) {
      for (recipe.height = 1; recipe.height <= 34; recipe.height += 3) {
        out->pixels.fill(77);
        check_identical(encode(recipe));
        const std::uint8_t* beyond = out->pixels.data() + static_cast<std::ptrdiff_t>(out->width) * out->height;
        CHECK(std::all_of(beyond, beyond + 100, [](std::uint8_t pixel) { return pixel == 77; }));
      }
    }
  }
}

TEST(JpegDc, EqualsTheLibraryOnTheCamerasPictures) {
  const scene::PictureConfig config = scene::camera_3280x2464();
  Bytes rgb;
  for (const int quality : {50, 85, 92}) {
    scene::render_rgb(config, {}, nullptr, static_cast<std::uint64_t>(quality), rgb);
    check_identical(encode_rgb(rgb, config.width, config.height, quality, 0));
    LONGS_EQUAL(410, out->width);
    LONGS_EQUAL(308, out->height);
  }
}

TEST(JpegDc, TakesTheLargestPicture) {
  std::string bits;
  for (int i = 0; i < kMaxLumaWidth * 4; ++i) bits += "001010";
  Bytes bytes = grey_by_hand(kMaxLumaWidth, bits);
  const std::size_t begin = data_begin(bytes);
  const Bytes four_rows(bytes.begin() + static_cast<std::ptrdiff_t>(begin), bytes.end() - 2);
  bytes.resize(begin);
  for (int row = 0; row < kMaxLumaHeight; row += 4) bytes.insert(bytes.end(), four_rows.begin(), four_rows.end());
  bytes.insert(bytes.end(), {0xFF, 0xD9});
  const std::size_t frame = find_segment(bytes, 0xC0);
  const auto with_height = [&](int height) {
    return changed(changed(bytes, frame + 5, height >> 8), frame + 6, height & 255);
  };
  check_identical(with_height(kMaxLumaHeight * 8));
  check_error(Error::kTooLarge, with_height(kMaxLumaHeight * 8 + 1));
  check_error(Error::kTooLarge, changed(with_height(8), frame + 8, 0x41));  // a pixel wider
  check_error(Error::kTooLarge, changed(with_height(65535), frame + 7, 0xFF));
}

TEST(JpegDc, KeepsTheSeamsLeastSize) {
  const auto reason = [&](int width, int height) {
    Recipe recipe;
    recipe.width = width;
    recipe.height = height;
    return jpeg_dc::decode(*state, encode(recipe), *out).reason;
  };
  CHECK(reason(8 * kMinLumaWidth - 7, 8 * kMinLumaHeight - 7) == Reason::kNone);
  CHECK(reason(8 * kMinLumaWidth - 8, 8 * kMinLumaHeight) == Reason::kPictureTooSmall);
  CHECK(reason(8 * kMinLumaWidth, 8 * kMinLumaHeight - 8) == Reason::kPictureTooSmall);
}

TEST(JpegDc, RefusesEveryTruncation) {
  for (const int interval : {0, 3}) {
    Recipe recipe;
    recipe.restart_interval = interval;
    const Bytes whole = encode(recipe);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      // A span of exactly this memory, so that a sanitizer sees a read beyond it.
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      const Error error = decode(cut);
      CHECK(error == Error::kTruncated || (size < 2 && error == Error::kNoPicture));
    }
    check_identical(whole);
  }
}

TEST(JpegDc, EveryChangedByteIsRefusedOrDecodedAsTheLibraryDoes) {
  std::vector<Recipe> recipes(4);
  recipes[1].restart_interval = 2;
  recipes[2].sampling = {{1, 1}};
  recipes[3].sampling = {{2, 2}, {1, 1}, {1, 1}};
  recipes[3].content = Content::kCoefficients;
  int accepted = 0;
  for (Recipe& recipe : recipes) {
    recipe.width = 40;
    recipe.height = 24;
    const Bytes with_tables = encode(recipe);
    const Bytes whole = without(with_tables, 0xC4);  // a changed table costs a thousand changed bytes elsewhere
    for (std::size_t at = 0; at < whole.size(); ++at) {
      for (int value = 0; value < 256; ++value) {
        if (at < data_begin(whole) || (value ^ whole[at]) % 7 == 1)
          accepted += check_safe(changed(whole, at, value), at) ? 1 : 0;
      }
    }
    for (std::size_t at = find_segment(with_tables, 0xC4); at < data_begin(with_tables); ++at) {
      for (int bit = 0; bit < 8; bit += 3) check_safe(changed(with_tables, at, with_tables[at] ^ 1 << bit), at);
    }
    check_identical(whole);
  }
  CHECK(accepted > 1000);  // otherwise this test compares nothing
}

TEST(JpegDc, EveryLostOrZeroedSpanIsRefusedOrDecodedAsTheLibraryDoes) {
  Recipe recipe;
  recipe.width = recipe.height = 200;
  const Bytes whole = encode(recipe);
  Random random(5);
  for (int round = 0; round < 3000; ++round) {
    const std::size_t at = random() % (whole.size() - 1);
    const std::size_t count = std::min<std::size_t>(1 + random() % 600, whole.size() - at);
    check_safe(zeroed(whole, at, count), at);
    check_safe(erased(whole, at, count), at);
    Bytes flipped = whole;
    for (int i = in_range(random, 1, 50); i > 0; --i)
      flipped[random() % whole.size()] ^= std::uint8_t(1U << random() % 8);
    check_safe(flipped, at);
  }
  check_identical(whole);
}

TEST(JpegDc, SurvivesGarbage) {
  Random random(6);
  const Bytes headers = without(encode({}), 0xC4);
  check_error(Error::kNoPicture, {});
  for (int round = 0; round < 3000; ++round) {
    Bytes bytes(random() % 400);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random() % 5 == 0 ? 0xFF : random());
    CHECK(decode(bytes) != Error::kNone);
    check_safe(
        inserted(bytes, 0, {headers.begin(), headers.begin() + static_cast<std::ptrdiff_t>(data_begin(headers))}), 0);
    if (bytes.size() < 2) continue;
    bytes[0] = 0xFF;
    bytes[1] = 0xD8;
    CHECK(decode(bytes) != Error::kNone);
  }
  check_identical(headers);
}

TEST(JpegDc, MakesTablesOnlyWhenTheyChange) {
  Recipe recipe;
  const Bytes standard = encode(recipe);
  check_identical(standard);
  LONGS_EQUAL(4, state->tables_made);
  check_identical(without(standard, 0xC4));
  check_identical(standard);
  recipe.sampling = {{1, 1}};
  check_identical(encode(recipe));  // the luma tables are there
  LONGS_EQUAL(4, state->tables_made);
  recipe.tables = Tables::kShuffled;
  check_identical(encode(recipe));  // grey needs two
  LONGS_EQUAL(6, state->tables_made);
  check_identical(encode(recipe));
  LONGS_EQUAL(6, state->tables_made);
  check_identical(without(standard, 0xC4));  // what the picture before brought is forgotten
  LONGS_EQUAL(8, state->tables_made);
}

TEST(JpegDc, NamesWhatIsWrongWithTheHeaders) {
  const Bytes whole = encode({});
  const std::size_t frame = find_segment(whole, 0xC0), scan = find_segment(whole, 0xDA),
                    quant = find_segment(whole, 0xDB);
  const std::size_t huffman = find_segment(whole, 0xC4), app0 = find_segment(whole, 0xE0);
  check_error(Error::kNoPicture, changed(whole, 0, 0));
  check_error(Error::kNoMarker, changed(whole, 2, 0));
  check_error(Error::kNoMarker, inserted(whole, frame, {0}));
  check_error(Error::kNoMarker, inserted(whole, frame, {0xFF, 0x00}));
  for (const int marker : {0x01, 0x02, 0xBF, 0xC8, 0xD0, 0xD8, 0xD9, 0xDC, 0xDE, 0xF0}) {
    check_error(Error::kStrayMarker, inserted(whole, frame, {0xFF, static_cast<std::uint8_t>(marker), 0, 4, 0, 8}));
  }
  check_error(Error::kSegmentLength, inserted(whole, frame, {0xFF, 0xFE, 0, 1}));
  check_error(Error::kSegmentLength, inserted(whole, frame, {0xFF, 0xDD, 0, 5, 0, 0, 0}));
  check_error(Error::kSegmentLength, changed(whole, quant + 3, 66));
  check_error(Error::kSegmentLength, changed(whole, huffman + 3, 30));
  check_error(Error::kSegmentLength, changed(whole, frame + 3, 18));
  check_error(Error::kSegmentLength, changed(whole, scan + 3, 13));
  check_error(Error::kJfifVersion, changed(whole, app0 + 9, 2));
  check_error(Error::kHuffmanTable, changed(whole, huffman + 4, 0x20));
  check_error(Error::kHuffmanTable, changed(whole, huffman + 4, 0x04));
  const Bytes overfull = changed(changed(whole, huffman + 5, 2), huffman + 7, 3);  // two codes of one bit and more
  check_identical(whole);
  check_error(Error::kHuffmanTable, overfull);
  check_error(Error::kHuffmanTable, overfull);  // a table that could not be made is not taken for made
  check_error(Error::kHuffmanTable, changed(whole, huffman + 21, 0x10));  // a DC difference of 16 bits
  check_error(Error::kNoHuffmanTable, changed(whole, scan + 6, 0x20));
  check_error(Error::kNoHuffmanTable, changed(whole, scan + 6, 0x04));
  check_error(Error::kQuantTable, changed(whole, quant + 4, 0x20));
  check_error(Error::kQuantTable, changed(whole, quant + 4, 0x04));
  check_error(Error::kQuantTable, changed(whole, quant + 5, 0));
  Bytes wide(2 + 2 + 1 + 2 * 64, 1);  // of 16 bits: 32767 is the most that libjpeg knows
  const Bytes dqt{0xFF, 0xDB, 0, 131, 0x10, 0x7F, 0xFF};
  std::copy(dqt.begin(), dqt.end(), wide.begin());
  check_identical(inserted(whole, frame, wide));
  check_error(Error::kQuantTable, inserted(whole, frame, changed(changed(wide, 5, 0x80), 6, 0)));
  check_error(Error::kNoQuantTable, without(whole, 0xDB));
  check_error(Error::kNoQuantTable, changed(whole, frame + 12, 2));
  check_error(Error::kNoQuantTable, changed(whole, frame + 12, 4));
  const Bytes header(whole.begin() + static_cast<std::ptrdiff_t>(frame),
                     whole.begin() + static_cast<std::ptrdiff_t>(frame + 19));
  check_error(Error::kTwoFrames, inserted(whole, frame, header));
  check_error(Error::kNoFrame, without(whole, 0xC0));
  check_error(Error::kEmptyPicture, changed(changed(whole, frame + 5, 0), frame + 6, 0));
  check_error(Error::kEmptyPicture, changed(changed(whole, frame + 7, 0), frame + 8, 0));
  check_error(Error::kTooLarge, changed(whole, frame + 5, 0xFF));
  check_error(Error::kTooLarge, changed(whole, frame + 7, 0xFF));
  for (const int marker : {0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCC, 0xCD, 0xCE, 0xCF}) {
    check_error(Error::kProcess, changed(whole, frame + 1, marker));
  }
  check_error(Error::kPrecision, changed(whole, frame + 4, 12));
  check_error(Error::kSampling, changed(whole, frame + 11, 0x01));
  check_error(Error::kSampling, changed(whole, frame + 11, 0x15));
  check_error(Error::kSampling, changed(whole, frame + 11, 0x43));  // 14 blocks
  check_error(Error::kSampling, changed(whole, frame + 14, 0x41));  // Cb finer than luma
  check_error(Error::kScanHeader, changed(whole, scan + 5, 9));
  check_error(Error::kScanHeader, changed(whole, scan + 7, 1));
  check_error(Error::kScanHeader, changed(whole, scan + 11, 1));
  check_error(Error::kScanHeader, changed(whole, scan + 12, 5));
  check_error(Error::kScanHeader, changed(whole, scan + 13, 1));
  Bytes grey = grey_by_hand(1, "001010");
  const std::size_t grey_scan = find_segment(grey, 0xDA);
  grey = inserted(changed(changed(grey, grey_scan + 3, 10), grey_scan + 4, 2), grey_scan + 7, {2, 0});
  check_error(Error::kScanHeader, grey);  // two components, of which the frame has one
  check_identical(whole);
  check_identical(changed(whole, frame + 1, 0xC1));
}

TEST(JpegDc, RefusesOtherKindsOfPictures) {
  Recipe recipe;
  recipe.progressive = true;
  check_error(Error::kProcess, encode(recipe));
  recipe.progressive = false;
  recipe.scan_per_component = true;
  check_error(Error::kManyScans, encode(recipe));
  recipe.scan_per_component = false;
  recipe.sampling = {{1, 1}, {1, 1}};
  check_error(Error::kComponents, encode(recipe));
  recipe.sampling = {{1, 1}, {1, 1}, {1, 1}, {1, 1}};
  recipe.colours = Colours::kCmyk;
  check_error(Error::kComponents, encode(recipe));
  recipe.sampling = {{1, 1}, {1, 1}, {1, 1}};
  recipe.colours = Colours::kRgb;
  const Bytes rgb = encode(recipe);  // tells so in an Adobe segment and in the names of its components
  check_error(Error::kColourSpace, rgb);
  check_error(Error::kColourSpace, without(rgb, 0xEE));
  // Other names than these three are YCbCr, as libjpeg takes them.
  const Bytes named = without(rgb, 0xEE);
  const std::size_t frame = find_segment(named, 0xC0), scan = find_segment(named, 0xDA);
  check_identical(changed(changed(named, frame + 13, 'g'), scan + 7, 'g'));
  check_identical(changed(changed(named, frame + 16, 'b'), scan + 9, 'b'));
  const Bytes plain = without(encode({}), 0xE0);
  const auto adobe = [&](std::uint8_t transform) {
    return inserted(plain, 2, {0xFF, 0xEE, 0, 14, 'A', 'd', 'o', 'b', 'e', 0, 100, 0, 0, 0, 0, transform});
  };
  check_identical(plain);
  check_identical(adobe(1));
  check_error(Error::kColourSpace, adobe(0));
  check_error(Error::kColourSpace, adobe(2));
}

TEST(JpegDc, NamesWhatIsWrongWithTheData) {
  const std::string zeros16 = "11111111001", dc2047 = "11111111011111111111", end = "1010";
  check_identical(grey_by_hand(2, "00" + end + "00" + end));
  check_identical(grey_by_hand(1, "00" + zeros16 + zeros16 + zeros16 + end));
  check_identical(grey_by_hand(2, dc2047 + end + "00" + end));
  // Past the last coefficient: by zeros alone, and by a run and a value.
  check_error(Error::kPastLastCoefficient, grey_by_hand(1, "00" + zeros16 + zeros16 + zeros16 + zeros16 + end));
  check_error(Error::kPastLastCoefficient,
              grey_by_hand(1, "00" + zeros16 + zeros16 + zeros16 + "1111111111110101" + "1" + end));
  check_error(Error::kDcRange, grey_by_hand(2, dc2047 + end + "0101" + end));
  check_error(Error::kBadCode, grey_by_hand(4, "111111111111111111111111" + end + end));
  check_error(Error::kBadCode, grey_by_hand(4,
                                            "00"
                                            "1111111111111111" +
                                                end + end));
  check_error(Error::kMarkerInData, grey_by_hand(3, "00" + end + "00" + end));
  check_error(Error::kSpareData, grey_by_hand(1, "00" + end + "00" + end));
  // A symbol (1,0) that only progressive pictures know.
  const Bytes table{0xFF, 0xC4, 0, 21, 0x10, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x00, 0x10};
  check_identical(grey_by_hand(1, "000", table));
  check_error(Error::kBadCode, grey_by_hand(1,
                                            "0010"
                                            "11111",
                                            table));
  // Two codes of one bit, the second of them all ones.
  const Bytes all_ones{0xFF, 0xC4, 0, 21, 0x10, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x00, 0x01};
  check_error(Error::kHuffmanTable, grey_by_hand(1, "000", all_ones));
  const Bytes one = grey_by_hand(1, "00" + end);
  check_error(Error::kNoEnd, changed(one, one.size() - 1, 0xD0));
  check_error(Error::kNoEnd, changed(one, one.size() - 1, 0xDC));  // DNL
  check_identical(inserted(one, one.size(), {0, 1, 2, 0xFF, 0xD8}));
}

TEST(JpegDc, RestartMarkersMustComeInOrder) {
  Recipe recipe;
  recipe.width = 640;
  recipe.restart_interval = 5;
  const Bytes whole = encode(recipe);
  check_identical(whole);
  std::vector<std::size_t> restarts;
  for (std::size_t i = data_begin(whole); i + 1 < whole.size(); ++i) {
    if (whole[i] == 0xFF && whole[i + 1] >= 0xD0 && whole[i + 1] <= 0xD7) restarts.push_back(i);
  }
  CHECK(restarts.size() > 9);  // so that the numbers wrap
  for (const std::size_t at : restarts) {
    check_error(Error::kRestartOrder, changed(whole, at + 1, whole[at + 1] ^ 1));
    check_error(Error::kRestartOrder, changed(whole, at + 1, 0xD9));
    check_error(Error::kMarkerInData, inserted(erased(whole, at, 2), at - 3, {0xFF, 0xD0}));
    check_error(Error::kSpareData, inserted(whole, at, {0x55}));
    CHECK(decode(erased(whole, at, 2)) != Error::kNone);
  }
  const Bytes none = without(whole, 0xDD);
  check_error(Error::kMarkerInData, none);
}
