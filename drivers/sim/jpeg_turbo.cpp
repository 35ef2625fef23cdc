// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/jpeg_turbo.hpp"

#include <csetjmp>
#include <cstdio>

#include <jpeglib.h>

namespace holdfast::sim {

// libjpeg's error manager must come first: its address is all that the callbacks get.
struct TurboJpegDecoder::Library {
  jpeg_error_mgr errors{};
  jpeg_decompress_struct decoder{};
  std::jmp_buf escape{};
  bool created = false;

  static Library& of(j_common_ptr info) { return *reinterpret_cast<Library*>(info->err); }
  static void give_up(j_common_ptr info) { std::longjmp(of(info).escape, 1); }
  static void on_message(j_common_ptr info, int level) {
    if (level < 0) give_up(info);  // -1 is a warning: corrupt data that the library would paper over
  }
  static void stay_silent(j_common_ptr) {}

  // longjmp leaves from any call below, so nothing here may own anything or change after setjmp.
  Status decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) {
    if (setjmp(escape) != 0) {
      if (created) jpeg_abort_decompress(&decoder);
      return {Reason::kJpegDamaged};
    }
    if (!created) {
      jpeg_create_decompress(&decoder);
      created = true;
    }
    jpeg_mem_src(&decoder, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&decoder, TRUE);
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

TurboJpegDecoder::TurboJpegDecoder() : library_(std::make_unique<Library>()) {
  library_->decoder.err = jpeg_std_error(&library_->errors);
  library_->errors.error_exit = Library::give_up;
  library_->errors.emit_message = Library::on_message;
  library_->errors.output_message = Library::stay_silent;
}

TurboJpegDecoder::~TurboJpegDecoder() {
  if (library_->created) jpeg_destroy_decompress(&library_->decoder);
}

Status TurboJpegDecoder::do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) {
  return library_->decode(bytes, scale, out);
}

}  // namespace holdfast::sim
