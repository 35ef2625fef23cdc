// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/jpeg_turbo.hpp"

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <iterator>

#include <jpeglib.h>
// after jpeglib.h, which it needs
#include <jerror.h>

namespace holdfast::drivers {
namespace {

// The library's own allocator aligns to 32 and rounds rows up to twice that: its vector code writes up to there.
constexpr std::size_t kAlignment = 64;

constexpr std::size_t rounded_up(std::size_t bytes) {
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

// Bytes handed out one after the other and taken back all at once.
template <std::size_t kSize>
struct Arena {
  alignas(kAlignment) std::array<std::byte, kSize> bytes;
  std::size_t used = 0;
  std::size_t most = 0;

  // Null when full.
  void* take(std::size_t size) {
    if (size > kSize || rounded_up(size) > kSize - used) return nullptr;
    void* const taken = bytes.data() + used;
    used += rounded_up(size);
    most = std::max(most, used);
    return taken;
  }
};

// In the terms of T.81, what is not of our format rather than damaged; the rest are errors and warnings alike.
Reason reason_of(int message) {
  switch (message) {
    case JERR_SOF_UNSUPPORTED:
    case JERR_BAD_PRECISION:
    case JERR_COMPONENT_COUNT:
    case JERR_BAD_SAMPLING:
    case JERR_BAD_MCU_SIZE:
    case JERR_FRACT_SAMPLE_NOTIMPL:
      return Reason::kFrameFormat;
    case JERR_IMAGE_TOO_BIG:
    case JERR_OUT_OF_MEMORY:
      return Reason::kPictureTooLarge;
    default:
      return Reason::kJpegDamaged;
  }
}

}  // namespace

struct TurboJpegDecoder::Library {
  jpeg_error_mgr errors{};
  jpeg_decompress_struct decoder{};
  std::jmp_buf escape{};
  // All twelve table slots and the source: 4 x 132 + 8 x 280 + 56 bytes, rounded up to 3 392. Usual: 1 728.
  Arena<kMemory.tables> tables;
  // The most is the strip of one row of MCUs: at most ten blocks of 8x8 to the MCU, over 1640 pixels, when nothing is
  // subsampled across, is 131 kB. RGB adds 20 kB to bring three components to one size; code tables and the like are
  // 17 kB; a hostile header makes 255 components of 96 bytes before it is refused. Measured: 155 kB for that worst
  // one, 25 kB and 15 kB for the camera's 3280x2464 (4:2:2) at 1/2 and 1/4.
  Arena<kMemory.picture> picture;

  static Library& of(j_common_ptr info) { return *static_cast<Library*>(info->client_data); }
  static void give_up(j_common_ptr info) { std::longjmp(of(info).escape, 1); }
  static void on_message(j_common_ptr info, int level) {
    if (level < 0) give_up(info);  // -1 is a warning: corrupt data that the library would paper over
  }
  static void stay_silent(j_common_ptr) {}
  static void give_up(j_common_ptr info, int message) {
    info->err->msg_code = message;
    give_up(info);
  }

  static void* take(j_common_ptr info, int pool, std::size_t size) {
    void* const taken = pool == JPOOL_PERMANENT ? of(info).tables.take(size) : of(info).picture.take(size);
    if (taken == nullptr) give_up(info, JERR_OUT_OF_MEMORY);
    return taken;
  }
  // Range: 32-bit counts, 64-bit products.
  template <typename Row>
  static Row* take_rows(j_common_ptr info, int pool, std::size_t row_bytes, JDIMENSION rows) {
    auto* const pointers = static_cast<Row*>(take(info, pool, rows * sizeof(Row)));
    auto* const bytes = static_cast<std::byte*>(take(info, pool, rows * rounded_up(row_bytes)));
    for (JDIMENSION i = 0; i < rows; ++i) pointers[i] = reinterpret_cast<Row>(bytes + i * rounded_up(row_bytes));
    return pointers;
  }
  static JSAMPARRAY take_samples(j_common_ptr info, int pool, JDIMENSION width, JDIMENSION rows) {
    return take_rows<JSAMPROW>(info, pool, width * sizeof(JSAMPLE), rows);
  }
  static JBLOCKARRAY take_blocks(j_common_ptr info, int pool, JDIMENSION width, JDIMENSION rows) {
    return take_rows<JBLOCKROW>(info, pool, width * sizeof(JBLOCK), rows);
  }
  // Whole pictures, which only scans that come one over the other need. Never called: such are refused before.
  static jvirt_sarray_ptr refuse_samples(j_common_ptr info, int, boolean, JDIMENSION, JDIMENSION, JDIMENSION) {
    give_up(info, JERR_VIRTUAL_BUG);
    return nullptr;
  }
  static jvirt_barray_ptr refuse_blocks(j_common_ptr info, int, boolean, JDIMENSION, JDIMENSION, JDIMENSION) {
    give_up(info, JERR_VIRTUAL_BUG);
    return nullptr;
  }
  static void give_back(j_common_ptr info, int pool) {
    (pool == JPOOL_PERMANENT ? of(info).tables.used : of(info).picture.used) = 0;
  }

  // What the library makes for itself while it starts comes from its own allocator, and goes back to it at the end:
  // self_destruct stays what it was and knows that memory only.
  Library() {
    decoder.err = jpeg_std_error(&errors);
    decoder.client_data = this;
    jpeg_create_decompress(&decoder);
    errors.error_exit = give_up;
    errors.emit_message = on_message;
    errors.output_message = stay_silent;
    jpeg_memory_mgr& memory = *decoder.mem;
    memory.alloc_small = take;
    memory.alloc_large = take;
    memory.alloc_sarray = take_samples;
    memory.alloc_barray = take_blocks;
    memory.request_virt_sarray = refuse_samples;
    memory.request_virt_barray = refuse_blocks;
    memory.free_pool = give_back;
    warm_up();
  }
  ~Library() { jpeg_destroy_decompress(&decoder); }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  // The headers of a grey picture of 8x8, without data. On aarch64 the library reads /proc/cpuinfo, through the heap,
  // the first time that a thread prepares an inverse transform: better now than between two frames.
  void warm_up() {
    static constexpr auto kHeaders = [] {
      constexpr std::array<std::uint8_t, 7> kStart{0xFF, 0xD8, 0xFF, 0xDB, 0, 67, 0};  // then 64 quantisers
      constexpr std::array<std::uint8_t, 23> kEnd{0xFF, 0xC0, 0, 11, 8, 0, 8, 0, 8,  1, 1, 0x11, 0,  // SOF0
                                                  0xFF, 0xDA, 0, 8,  1, 1, 0, 0, 63, 0};             // SOS
      std::array<std::uint8_t, kStart.size() + 64 + kEnd.size()> all{};
      all.fill(1);
      std::copy(kStart.begin(), kStart.end(), all.begin());
      std::copy(kEnd.begin(), kEnd.end(), all.end() - kEnd.size());
      return all;
    }();
    if (setjmp(escape) == 0) {
      jpeg_mem_src(&decoder, kHeaders.data(), kHeaders.size());
      jpeg_read_header(&decoder, TRUE);
      jpeg_start_decompress(&decoder);
    }
    jpeg_abort_decompress(&decoder);
  }

  void forget_tables() {
    decoder.src = nullptr;
    std::fill(std::begin(decoder.quant_tbl_ptrs), std::end(decoder.quant_tbl_ptrs), nullptr);
    std::fill(std::begin(decoder.dc_huff_tbl_ptrs), std::end(decoder.dc_huff_tbl_ptrs), nullptr);
    std::fill(std::begin(decoder.ac_huff_tbl_ptrs), std::end(decoder.ac_huff_tbl_ptrs), nullptr);
    tables.used = 0;
  }

  // longjmp leaves from any call below, so nothing here may own anything or change after setjmp.
  Status decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) {
    if (setjmp(escape) != 0) return refuse(reason_of(errors.msg_code));
    forget_tables();
    jpeg_mem_src(&decoder, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&decoder, TRUE);
    if (decoder.progressive_mode != FALSE || decoder.arith_code != FALSE || decoder.data_precision != 8 ||
        jpeg_has_multiple_scans(&decoder) != FALSE) {
      return refuse(Reason::kFrameFormat);
    }
    const J_COLOR_SPACE space = decoder.jpeg_color_space;
    if (space != JCS_GRAYSCALE && space != JCS_YCbCr && space != JCS_RGB) return refuse(Reason::kFrameFormat);
    decoder.out_color_space = JCS_GRAYSCALE;
    decoder.scale_num = 1;
    decoder.scale_denom = static_cast<unsigned>(scale);
    decoder.dct_method = JDCT_ISLOW;
    decoder.do_fancy_upsampling = FALSE;
    decoder.do_block_smoothing = FALSE;
    jpeg_calc_output_dimensions(&decoder);
    if (decoder.output_width > kMaxLumaWidth || decoder.output_height > kMaxLumaHeight) {
      return refuse(Reason::kPictureTooLarge);
    }
    if (decoder.output_width < kMinLumaWidth || decoder.output_height < kMinLumaHeight) {
      return refuse(Reason::kPictureTooSmall);
    }
    out.width = static_cast<std::int32_t>(decoder.output_width);
    out.height = static_cast<std::int32_t>(decoder.output_height);
    jpeg_start_decompress(&decoder);
    while (decoder.output_scanline < decoder.output_height) {
      JSAMPROW row = out.pixels.data() + std::size_t{decoder.output_scanline} * decoder.output_width;
      jpeg_read_scanlines(&decoder, &row, 1);
    }
    jpeg_finish_decompress(&decoder);  // looks for the end of the picture: a missing one is a warning
    return kOkStatus;
  }

  Status refuse(Reason reason) {
    jpeg_abort_decompress(&decoder);
    return {reason};
  }
};

TurboJpegDecoder::TurboJpegDecoder() : library_(std::make_unique<Library>()) {}

TurboJpegDecoder::~TurboJpegDecoder() = default;

TurboJpegDecoder::Memory TurboJpegDecoder::most_used() const {
  return {library_->tables.most, library_->picture.most};
}

Status TurboJpegDecoder::do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) {
  return library_->decode(bytes, scale, out);
}

}  // namespace holdfast::drivers
