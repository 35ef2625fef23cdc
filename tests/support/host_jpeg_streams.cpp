// SPDX-License-Identifier: Apache-2.0
#include "tests/support/host_jpeg_streams.hpp"

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numeric>

#include <jpeglib.h>

#include "vision/luma.hpp"

namespace holdfast::test {
namespace {

// Errors and warnings leave by longjmp, so what lives longer than that is a member.
struct Library {
  jpeg_error_mgr errors{};
  std::jmp_buf escape{};
  jpeg_decompress_struct decoder{};

  // False: refused, or a warning.
  bool decode(std::span<const std::uint8_t> bytes, Oracle& out) {
    decoder.err = jpeg_std_error(&errors);
    errors.error_exit = [](j_common_ptr info) { std::longjmp(reinterpret_cast<Library*>(info->err)->escape, 1); };
    errors.emit_message = [](j_common_ptr info, int level) {
      if (level < 0) info->err->error_exit(info);
    };
    errors.output_message = [](j_common_ptr) {};
    jpeg_create_decompress(&decoder);
    const bool clean = setjmp(escape) == 0 && run(bytes, out);
    jpeg_destroy_decompress(&decoder);
    return clean;
  }

 private:
  bool run(std::span<const std::uint8_t> bytes, Oracle& out) {
    jpeg_mem_src(&decoder, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&decoder, TRUE);
    decoder.out_color_space = JCS_GRAYSCALE;
    decoder.scale_num = 1;
    decoder.scale_denom = 8;
    jpeg_calc_output_dimensions(&decoder);
    if (decoder.output_width > kMaxLumaWidth || decoder.output_height > kMaxLumaHeight) return false;
    jpeg_start_decompress(&decoder);
    out.width = static_cast<int>(decoder.output_width);
    out.height = static_cast<int>(decoder.output_height);
    out.pixels.assign(std::size_t{decoder.output_width} * decoder.output_height, 0);
    while (decoder.output_scanline < decoder.output_height) {
      JSAMPROW row = out.pixels.data() + std::size_t{decoder.output_scanline} * decoder.output_width;
      jpeg_read_scanlines(&decoder, &row, 1);
    }
    jpeg_finish_decompress(&decoder);
    return true;
  }
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
    if (recipe.content == Content::kCoefficients || recipe.content == Content::kSpecks) {
      write_coefficients(recipe.content == Content::kSpecks ? speck_block : fill_block, random);
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
    encoder.in_color_space = recipe.colours == Colours::kRgb    ? JCS_RGB
                             : recipe.colours == Colours::kCmyk ? JCS_CMYK
                             : components == 1                  ? JCS_GRAYSCALE
                             : components == 3                  ? JCS_YCbCr
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
    if (recipe.cr_as_luma) {
      encoder.comp_info[2].dc_tbl_no = encoder.comp_info[0].dc_tbl_no;
      encoder.comp_info[2].ac_tbl_no = encoder.comp_info[0].ac_tbl_no;
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

  void write_coefficients(void (*fill)(JBLOCK& block, int dc_reach, Random& random), Random& random) {
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
        for (int x = 0; x < across[i]; ++x) fill(rows[0][x], dc_reach, random);
      }
    }
  }

  // Any coefficients at all: long runs, full blocks, values up to what the format can say.
  static void fill_block(JBLOCK& block, int dc_reach, Random& random) {
    block[0] = static_cast<JCOEF>(in_range(random, -dc_reach, dc_reach));
    const int density = std::array{0, 1, 8, 40, 100}[random() % 5];  // percent of coefficients that are not 0
    const int reach = std::array{1, 3, 60, 1023}[random() % 4];
    for (int k = 1; k < 64; ++k) {
      if (in_range(random, 1, 100) <= density) block[k] = static_cast<JCOEF>(in_range(random, -reach, reach));
    }
    if (random() % 4 == 0) block[63] = 1;  // ends without an end-of-block code
  }

  // Nearly all blocks are empty.
  static void speck_block(JBLOCK& block, int dc_reach, Random& random) {
    block[0] = static_cast<JCOEF>(random() % 16 == 0 ? in_range(random, -dc_reach, dc_reach) : 20);
    if (random() % 16 == 0) block[in_range(random, 1, 63)] = static_cast<JCOEF>(in_range(random, -3, 3));
    if (random() % 64 == 0) block[63] = 1;  // ends without an end-of-block code
  }
};

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

Bytes stream(const Recipe& recipe, Random& random) {
  Bytes bytes = encode(recipe, random);
  if (recipe.tables == Tables::kStandard && random() % 2 == 0) bytes = without(bytes, 0xC4);
  if (random() % 2 == 0) bytes = with_noise(bytes, random);
  return bytes;
}

}  // namespace

int in_range(Random& random, int low, int high) {
  return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
}

bool Oracle::decode(std::span<const std::uint8_t> bytes) {
  return Library{}.decode(bytes, *this);
}

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

Bytes encode(const Recipe& recipe, Random& random) {
  return Encoder{}.encode(recipe, random);
}

Bytes encode(const Recipe& recipe, unsigned seed) {
  Random random(seed);
  return encode(recipe, random);
}

Bytes any_stream(unsigned seed) {
  Random random(seed);
  return stream(any_recipe(random), random);
}

Bytes small_stream(unsigned seed) {
  Random random(seed);
  while (true) {
    Recipe recipe = any_recipe(random);
    recipe.width = 1 + recipe.width % 40;
    recipe.height = 1 + recipe.height % 40;
    Bytes bytes = stream(recipe, random);
    if (bytes.size() <= kSmallStream) return bytes;
  }
}

Bytes encode_rgb(std::span<const std::uint8_t> rgb, int width, int height, int quality, int restart_interval) {
  jpeg_error_mgr errors{};
  jpeg_compress_struct encoder{};
  unsigned char* memory = nullptr;
  unsigned long size = 0;
  encoder.err = jpeg_std_error(&errors);
  jpeg_create_compress(&encoder);
  jpeg_mem_dest(&encoder, &memory, &size);
  encoder.image_width = static_cast<JDIMENSION>(width);
  encoder.image_height = static_cast<JDIMENSION>(height);
  encoder.input_components = 3;
  encoder.in_color_space = JCS_RGB;
  jpeg_set_defaults(&encoder);
  jpeg_set_quality(&encoder, quality, TRUE);
  encoder.comp_info[0].h_samp_factor = 2;
  encoder.comp_info[0].v_samp_factor = 1;
  encoder.restart_interval = static_cast<unsigned>(restart_interval);
  jpeg_start_compress(&encoder, TRUE);
  while (encoder.next_scanline < encoder.image_height) {
    auto* row = const_cast<JSAMPLE*>(rgb.data()) + std::size_t{encoder.next_scanline} * encoder.image_width * 3;
    jpeg_write_scanlines(&encoder, &row, 1);
  }
  jpeg_finish_compress(&encoder);
  Bytes bytes(memory, memory + size);
  jpeg_destroy_compress(&encoder);
  std::free(memory);
  return bytes;
}

Bytes grey_by_hand(int blocks, const std::string& bits, const Bytes& extra_segment) {
  Bytes bytes(7 + 64, 8);  // every divisor 8
  const Bytes start{0xFF, 0xD8, 0xFF, 0xDB, 0, 67, 0};
  std::copy(start.begin(), start.end(), bytes.begin());
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

std::size_t find_segment(const Bytes& bytes, std::uint8_t marker) {
  for (const Segment& segment : segments(bytes)) {
    if (segment.marker == marker) return segment.at;
  }
  return bytes.size();
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

Bytes zeroed(Bytes bytes, std::size_t at, std::size_t count) {
  std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), count, std::uint8_t{0});
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

}  // namespace holdfast::test
