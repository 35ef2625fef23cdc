// SPDX-License-Identifier: Apache-2.0
// The oracle is libjpeg-turbo, used straight: a new decompressor per picture, any warning counted as a refusal.
#include "vision/jpeg_dc.hpp"

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdlib>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include <jpeglib.h>

#include "drivers/sim/jpeg_turbo.hpp"
#include "drivers/sim/scene/jpeg_encode.hpp"
#include "drivers/sim/scene/render.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using jpeg_dc::Error;

namespace {

using Bytes = std::vector<std::uint8_t>;
using Random = std::mt19937;

int in_range(Random& random, int low, int high) {
  return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
}

// ---- libjpeg-turbo, decoding and encoding; errors and warnings leave by longjmp, so objects live in these structs
// ----

struct Oracle {
  jpeg_error_mgr errors{};
  std::jmp_buf escape{};
  jpeg_decompress_struct decoder{};
  int width = 0;
  int height = 0;
  Bytes pixels;

  // True: accepted without a warning.
  bool decode(const Bytes& bytes) {
    decoder.err = jpeg_std_error(&errors);
    errors.error_exit = [](j_common_ptr info) { std::longjmp(reinterpret_cast<Oracle*>(info->err)->escape, 1); };
    errors.emit_message = [](j_common_ptr info, int level) {
      if (level < 0) info->err->error_exit(info);
    };
    errors.output_message = [](j_common_ptr) {};
    jpeg_create_decompress(&decoder);
    const bool clean = setjmp(escape) == 0 && run(bytes);
    jpeg_destroy_decompress(&decoder);
    return clean;
  }

 private:
  bool run(const Bytes& bytes) {
    jpeg_mem_src(&decoder, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&decoder, TRUE);
    decoder.out_color_space = JCS_GRAYSCALE;
    decoder.scale_num = 1;
    decoder.scale_denom = 8;
    jpeg_start_decompress(&decoder);
    width = static_cast<int>(decoder.output_width);
    height = static_cast<int>(decoder.output_height);
    pixels.assign(std::size_t{decoder.output_width} * decoder.output_height, 0);
    while (decoder.output_scanline < decoder.output_height) {
      JSAMPROW row = pixels.data() + std::size_t{decoder.output_scanline} * decoder.output_width;
      jpeg_read_scanlines(&decoder, &row, 1);
    }
    jpeg_finish_decompress(&decoder);
    return true;
  }
};

struct Sampling {
  int across = 1;
  int down = 1;
};

enum class Tables { kStandard, kOptimised, kShuffled };
enum class Content { kFlat, kRamp, kNoise, kDots, kCoefficients };

struct Recipe {
  int width = 64;
  int height = 48;
  std::vector<Sampling> sampling{{2, 1}, {1, 1}, {1, 1}};  // one entry: grey
  Content content = Content::kDots;
  Tables tables = Tables::kStandard;
  int quality = 85;
  bool own_quant = false;    // random divisors instead of those of `quality`
  int max_quant = 255;       // above 255: 16-bit DQT
  int restart_interval = 0;  // MCUs
  int table_offset = 0;      // Huffman ids 2 and 3 instead of 0 and 1
  bool progressive = false;
  bool scan_per_component = false;
  J_COLOR_SPACE space = JCS_UNKNOWN;  // JCS_UNKNOWN: grey or YCbCr by the number of components
};

// A random prefix code with room left for the reserved code of all ones, for symbols in random order.
void shuffle_table(JHUFF_TBL& table, Bytes symbols, Random& random) {
  std::shuffle(symbols.begin(), symbols.end(), random);
  int rest = static_cast<int>(symbols.size());
  std::int64_t free_codes = 1;
  for (int length = 1; length <= 16; ++length) {
    free_codes *= 2;
    std::int64_t most = length == 16 ? rest : 0;
    while (length < 16 && most < rest && ((free_codes - most - 1) << (16 - length)) > rest - most) ++most;
    const int count = length == 16 ? rest : in_range(random, 0, static_cast<int>(std::min<std::int64_t>(most, 40)));
    table.bits[length] = static_cast<UINT8>(count);
    free_codes -= count;
    rest -= count;
  }
  std::copy(symbols.begin(), symbols.end(), table.huffval);
}

struct Encoder {
  jpeg_error_mgr errors{};
  jpeg_compress_struct encoder{};
  unsigned char* memory = nullptr;
  unsigned long size = 0;
  // The library keeps the addresses of these until jpeg_finish_compress.
  std::array<jpeg_scan_info, 4> scans{};
  std::array<jvirt_barray_ptr, 4> arrays{};

  Bytes encode(const Recipe& recipe, Random& random) {
    encoder.err = jpeg_std_error(&errors);
    errors.emit_message = [](j_common_ptr, int) {};  // it would tell that 16-bit divisors are no baseline
    jpeg_create_compress(&encoder);
    jpeg_mem_dest(&encoder, &memory, &size);
    set_up(recipe, random);
    if (recipe.content == Content::kCoefficients) {
      write_coefficients(random);
    } else {
      write_picture(recipe, random);
    }
    jpeg_finish_compress(&encoder);
    Bytes bytes(memory, memory + size);
    jpeg_destroy_compress(&encoder);
    std::free(memory);
    return bytes;
  }

 private:
  void set_up(const Recipe& recipe, Random& random) {
    const int components = static_cast<int>(recipe.sampling.size());
    encoder.image_width = static_cast<JDIMENSION>(recipe.width);
    encoder.image_height = static_cast<JDIMENSION>(recipe.height);
    encoder.input_components = components;
    encoder.in_color_space = recipe.space != JCS_UNKNOWN ? recipe.space
                             : components == 1           ? JCS_GRAYSCALE
                             : components == 3           ? JCS_YCbCr
                                                         : JCS_UNKNOWN;
    jpeg_set_defaults(&encoder);
    jpeg_set_colorspace(&encoder, encoder.in_color_space);
    jpeg_set_quality(&encoder, recipe.quality, TRUE);
    if (recipe.own_quant) {
      for (int id = 0; id < 2; ++id) {
        std::array<unsigned, 64> divisors{};
        for (unsigned& divisor : divisors) divisor = static_cast<unsigned>(in_range(random, 1, recipe.max_quant));
        jpeg_add_quant_table(&encoder, id, divisors.data(), 100, FALSE);
      }
    }
    for (int i = 0; i < components; ++i) {
      jpeg_component_info& component = encoder.comp_info[i];
      component.h_samp_factor = recipe.sampling[static_cast<std::size_t>(i)].across;
      component.v_samp_factor = recipe.sampling[static_cast<std::size_t>(i)].down;
      component.dc_tbl_no += recipe.table_offset;
      component.ac_tbl_no += recipe.table_offset;
    }
    encoder.restart_interval = static_cast<unsigned>(recipe.restart_interval);
    encoder.optimize_coding = recipe.tables == Tables::kOptimised ? TRUE : FALSE;
    if (recipe.tables == Tables::kShuffled) shuffle_tables(recipe.table_offset, random);
    if (recipe.progressive) jpeg_simple_progression(&encoder);
    if (recipe.scan_per_component) {
      for (int i = 0; i < components; ++i) scans[static_cast<std::size_t>(i)] = {1, {i, 0, 0, 0}, 0, 63, 0, 0};
      encoder.scan_info = scans.data();
      encoder.num_scans = components;
    }
  }

  void shuffle_tables(int offset, Random& random) {
    Bytes dc(12), ac{0x00, 0xF0};
    std::iota(dc.begin(), dc.end(), std::uint8_t{0});
    for (int run = 0; run < 16; ++run) {
      for (int bits = 1; bits <= 10; ++bits) ac.push_back(static_cast<std::uint8_t>(run * 16 + bits));
    }
    for (int id = offset; id < offset + 2; ++id) {
      for (JHUFF_TBL** table : {&encoder.dc_huff_tbl_ptrs[id], &encoder.ac_huff_tbl_ptrs[id]}) {
        if (*table == nullptr) *table = jpeg_alloc_huff_table(reinterpret_cast<j_common_ptr>(&encoder));
        shuffle_table(**table, table == &encoder.dc_huff_tbl_ptrs[id] ? dc : ac, random);
      }
    }
  }

  void write_picture(const Recipe& recipe, Random& random) {
    const auto components = recipe.sampling.size();
    jpeg_start_compress(&encoder, TRUE);
    Bytes row(static_cast<std::size_t>(recipe.width) * components);
    const int slope = in_range(random, -5, 5), noise = in_range(random, 0, 40), level = in_range(random, 0, 255);
    while (encoder.next_scanline < encoder.image_height) {
      const int y = static_cast<int>(encoder.next_scanline);
      for (std::size_t i = 0; i < row.size(); ++i) {
        const int x = static_cast<int>(i / components);
        int value = level;
        if (recipe.content == Content::kRamp) value += slope * (x + y);
        if (recipe.content == Content::kNoise) value = static_cast<int>(random() % 256);
        if (recipe.content == Content::kDots) {
          const bool dot = (x % 32 - 16) * (x % 32 - 16) + (y % 32 - 16) * (y % 32 - 16) < 70;
          value = (dot ? 40 : 150) + x / 8 + in_range(random, -noise, noise);
        }
        row[i] = static_cast<std::uint8_t>(std::clamp(value, 0, 255));
      }
      JSAMPROW rows = row.data();
      jpeg_write_scanlines(&encoder, &rows, 1);
    }
  }

  // Any coefficients at all: long runs, full blocks, values up to what the format can say.
  void write_coefficients(Random& random) {
    std::array<int, 4> across{}, down{};
    int most_across = 1, most_down = 1;
    for (int i = 0; i < encoder.num_components; ++i) {
      most_across = std::max(most_across, encoder.comp_info[i].h_samp_factor);
      most_down = std::max(most_down, encoder.comp_info[i].v_samp_factor);
    }
    for (int i = 0; i < encoder.num_components; ++i) {
      const jpeg_component_info& component = encoder.comp_info[i];
      const int h = component.h_samp_factor, v = component.v_samp_factor;
      const auto index = static_cast<std::size_t>(i);
      across[index] = (static_cast<int>(encoder.image_width) + 8 * most_across - 1) / (8 * most_across) * h;
      down[index] = (static_cast<int>(encoder.image_height) + 8 * most_down - 1) / (8 * most_down) * v;
      arrays[index] = encoder.mem->request_virt_barray(
          reinterpret_cast<j_common_ptr>(&encoder), JPOOL_IMAGE, TRUE, static_cast<JDIMENSION>(across[index]),
          static_cast<JDIMENSION>(down[index]), static_cast<JDIMENSION>(v));
    }
    jpeg_write_coefficients(&encoder, arrays.data());
    const int dc_reach = in_range(random, 0, 1) != 0 ? 1023 : 60;
    for (std::size_t i = 0; i < static_cast<std::size_t>(encoder.num_components); ++i) {
      for (int y = 0; y < down[i]; ++y) {
        JBLOCKARRAY rows = encoder.mem->access_virt_barray(reinterpret_cast<j_common_ptr>(&encoder), arrays[i],
                                                           static_cast<JDIMENSION>(y), 1, TRUE);
        for (int x = 0; x < across[i]; ++x) fill_block(rows[0][x], dc_reach, random);
      }
    }
  }

  static void fill_block(JBLOCK& block, int dc_reach, Random& random) {
    block[0] = static_cast<JCOEF>(in_range(random, -dc_reach, dc_reach));
    const int density = std::array{0, 1, 8, 40, 100}[random() % 5];  // percent of coefficients that are not 0
    const int reach = std::array{1, 3, 60, 1023}[random() % 4];
    for (int k = 1; k < 64; ++k) {
      if (in_range(random, 1, 100) <= density) block[k] = static_cast<JCOEF>(in_range(random, -reach, reach));
    }
    if (random() % 4 == 0) block[63] = 1;  // ends without an end-of-block code
  }
};

Bytes encode(const Recipe& recipe, unsigned seed = 1) {
  Random random(seed);
  return Encoder{}.encode(recipe, random);
}

// ---- Bytes of a stream ----

struct Segment {
  std::uint8_t marker = 0;
  std::size_t at = 0;    // of its 0xFF
  std::size_t size = 0;  // with marker and length
};

// SOI to SOS of a stream that libjpeg wrote.
std::vector<Segment> segments(const Bytes& bytes) {
  std::vector<Segment> found{{0xD8, 0, 2}};
  while (found.back().marker != 0xDA) {
    const std::size_t at = found.back().at + found.back().size;
    found.push_back({bytes[at + 1], at, 2 + (std::size_t{bytes[at + 2]} << 8 | bytes[at + 3])});
  }
  return found;
}

std::size_t data_begin(const Bytes& bytes) {
  return segments(bytes).back().at + segments(bytes).back().size;
}

// Of the first such segment.
std::size_t find(const Bytes& bytes, std::uint8_t marker) {
  for (const Segment& segment : segments(bytes)) {
    if (segment.marker == marker) return segment.at;
  }
  FAIL("no such marker");
  return 0;
}

Bytes changed(Bytes bytes, std::size_t at, int value) {
  bytes[at] = static_cast<std::uint8_t>(value);
  return bytes;
}

Bytes inserted(Bytes bytes, std::size_t at, const Bytes& more) {
  bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), more.begin(), more.end());
  return bytes;
}

Bytes erased(Bytes bytes, std::size_t at, std::size_t count) {
  bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.begin() + static_cast<std::ptrdiff_t>(at + count));
  return bytes;
}

Bytes without(Bytes bytes, std::uint8_t marker) {
  std::vector<Segment> all = segments(bytes);
  std::reverse(all.begin(), all.end());
  for (const Segment& segment : all) {
    if (segment.marker == marker) bytes = erased(bytes, segment.at, segment.size);
  }
  return bytes;
}

// What encoders and transports may add without changing the picture: fill bytes, comments, padding.
Bytes with_noise(const Bytes& bytes, Random& random) {
  const auto fill = [&](Bytes& out) { out.insert(out.end(), random() % 4 == 0 ? random() % 4 : 0, 0xFF); };
  Bytes out;
  for (const Segment& segment : segments(bytes)) {
    if (segment.marker != 0xD8 && random() % 6 == 0) {
      const int length = in_range(random, 2, 40);
      const std::uint8_t marker = std::array<std::uint8_t, 4>{0xE1, 0xE5, 0xEF, 0xFE}[random() % 4];
      fill(out);
      out.insert(out.end(), {0xFF, marker, 0, static_cast<std::uint8_t>(length)});
      for (int i = 2; i < length; ++i) out.push_back(static_cast<std::uint8_t>(random() % 3 == 0 ? 0xFF : random()));
    }
    if (segment.marker != 0xD8) fill(out);
    const auto from = bytes.begin() + static_cast<std::ptrdiff_t>(segment.at);
    out.insert(out.end(), from, from + static_cast<std::ptrdiff_t>(segment.size));
  }
  for (std::size_t i = data_begin(bytes); i < bytes.size(); ++i) {
    if (bytes[i] == 0xFF && bytes[i + 1] != 0) fill(out);
    out.push_back(bytes[i]);
    if (bytes[i] == 0xFF) out.push_back(bytes[++i]);
  }
  if (random() % 3 == 0) {
    const bool zeros = random() % 2 == 0;
    for (int i = in_range(random, 0, 9000); i > 0; --i) out.push_back(zeros ? 0 : static_cast<std::uint8_t>(random()));
  }
  return out;
}

const std::array<std::vector<Sampling>, 12> kSamplings{{
    {{1, 1}},
    {{2, 2}},  // grey with factors that mean nothing
    {{1, 1}, {1, 1}, {1, 1}},
    {{2, 1}, {1, 1}, {1, 1}},
    {{2, 1}, {1, 1}, {1, 1}},
    {{2, 2}, {1, 1}, {1, 1}},
    {{2, 2}, {1, 1}, {1, 1}},
    {{1, 2}, {1, 1}, {1, 1}},
    {{4, 1}, {1, 1}, {1, 1}},
    {{1, 4}, {1, 1}, {1, 1}},
    {{2, 2}, {2, 1}, {1, 2}},
    {{4, 2}, {1, 1}, {1, 1}},
}};

Recipe any_recipe(Random& random) {
  Recipe recipe;
  recipe.width = in_range(random, 1, random() % 8 == 0 ? 400 : 90);
  recipe.height = in_range(random, 1, random() % 8 == 0 ? 300 : 90);
  recipe.sampling = kSamplings[random() % kSamplings.size()];
  recipe.content = static_cast<Content>(random() % 5);
  if (recipe.content == Content::kCoefficients && recipe.sampling.size() == 3 && random() % 8 == 0) {
    recipe.sampling = {{3, 1}, {2, 1}, {1, 1}};  // libjpeg's encoder cannot shrink pictures so, but writes the blocks
  }
  recipe.tables = static_cast<Tables>(random() % 3);
  recipe.quality = in_range(random, 1, 100);
  recipe.own_quant = random() % 3 == 0;
  // libjpeg's encoder divides by 8 times the divisor in 16 bits, so pictures cannot have all.
  recipe.max_quant = std::array{20, 255, 4000, 32767}[random() % (recipe.content == Content::kCoefficients ? 4 : 3)];
  if (random() % 3 == 0) recipe.restart_interval = in_range(random, 1, 20);
  if (recipe.tables != Tables::kStandard && random() % 3 == 0) recipe.table_offset = 2;
  return recipe;
}

// A grey picture of one row of blocks, written bit by bit with the standard tables: "00" is a DC difference of 0,
// "1010" ends the block.
Bytes grey_by_hand(int blocks, const std::string& bits, const Bytes& extra_segment = {}) {
  Bytes bytes{0xFF, 0xD8, 0xFF, 0xDB, 0, 67, 0};
  bytes.insert(bytes.end(), 64, 8);
  bytes.insert(bytes.end(), extra_segment.begin(), extra_segment.end());
  const auto width = static_cast<unsigned>(blocks * 8);
  bytes.insert(bytes.end(), {0xFF, 0xC0, 0, 11, 8, 0, 8, static_cast<std::uint8_t>(width >> 8),
                             static_cast<std::uint8_t>(width), 1, 1, 0x11, 0});
  bytes.insert(bytes.end(), {0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0});
  std::string padded = bits;
  while (padded.size() % 8 != 0) padded += '1';
  for (std::size_t i = 0; i < padded.size(); i += 8) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(padded.substr(i, 8), nullptr, 2)));
    if (bytes.back() == 0xFF) bytes.push_back(0);
  }
  bytes.insert(bytes.end(), {0xFF, 0xD9});
  return bytes;
}

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
  for (unsigned seed = 1; seed <= 6000; ++seed) {
    Random random(seed);
    const Recipe recipe = any_recipe(random);
    Bytes bytes = Encoder{}.encode(recipe, random);
    if (recipe.tables == Tables::kStandard && random() % 2 == 0) bytes = without(bytes, 0xC4);
    if (random() % 2 == 0) bytes = with_noise(bytes, random);
    check_identical(bytes, seed);
  }
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
    check_identical(scene::encode_jpeg(rgb, config.width, config.height, scene::JpegInput::kRgb, quality));
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
  const std::size_t frame = find(bytes, 0xC0);
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
    for (std::size_t at = find(with_tables, 0xC4); at < data_begin(with_tables); ++at) {
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
    Bytes zeroed = whole;
    std::fill_n(zeroed.begin() + static_cast<std::ptrdiff_t>(at), count, std::uint8_t{0});
    check_safe(zeroed, at);
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
  const std::size_t frame = find(whole, 0xC0), scan = find(whole, 0xDA), quant = find(whole, 0xDB);
  const std::size_t huffman = find(whole, 0xC4), app0 = find(whole, 0xE0);
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
  recipe.space = JCS_CMYK;
  check_error(Error::kComponents, encode(recipe));
  recipe.sampling = {{1, 1}, {1, 1}, {1, 1}};
  recipe.space = JCS_RGB;
  const Bytes rgb = encode(recipe);  // tells so in an Adobe segment and in the names of its components
  check_error(Error::kColourSpace, rgb);
  check_error(Error::kColourSpace, without(rgb, 0xEE));
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

TEST(JpegDc, ServesOneEighthAndPassesOtherScalesOn) {
  auto turbo = std::make_unique<sim::TurboJpegDecoder>();
  const auto ours = std::make_unique<jpeg_dc::Decoder>(*turbo);
  Recipe recipe;
  recipe.width = 1000;
  recipe.height = 700;
  const Bytes bytes = encode(recipe);
  const auto expected = std::make_unique<LumaBuffer>();
  for (const auto scale : {DecodeScale::kFull, DecodeScale::kHalf, DecodeScale::kQuarter, DecodeScale::kEighth}) {
    CHECK(turbo->decode(bytes, scale, *expected).ok());
    CHECK(ours->decode(bytes, scale, *out).ok());
    LONGS_EQUAL(expected->width, out->width);
    LONGS_EQUAL(expected->height, out->height);
    MEMCMP_EQUAL(expected->pixels.data(), out->pixels.data(), static_cast<std::size_t>(out->width * out->height));
  }
  recipe.progressive = true;  // the library takes these, we do not: so it is seen who decodes
  const Bytes progressive = encode(recipe);
  CHECK(ours->decode(progressive, DecodeScale::kQuarter, *out).ok());
  CHECK(ours->decode(progressive, DecodeScale::kEighth, *out).reason == Reason::kFrameFormat);
  CHECK(ours->last_error() == Error::kProcess);
}
