// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/picture/jpeg_encode.hpp"

#include <csetjmp>
#include <cstddef>
#include <cstdio>
#include <cstdlib>

#include <jpeglib.h>

namespace holdfast::scene {
namespace {

// libjpeg ends the process on an error unless told to jump.
struct ErrorManager {
  jpeg_error_mgr base;  // first: libjpeg hands back a pointer to it
  std::jmp_buf escape;
};

void escape(j_common_ptr info) {
  std::longjmp(reinterpret_cast<ErrorManager*>(info->err)->escape, 1);
}

// Everything libjpeg touches lives with the caller, so that nothing here is skipped by a jump.
struct Encoder {
  jpeg_compress_struct info;
  ErrorManager errors;
  unsigned char* bytes;
  unsigned long size;
};

bool compress(Encoder& encoder, const std::uint8_t* pixels, int width, int height, JpegInput input, int quality) {
  jpeg_compress_struct& info = encoder.info;
  info.err = jpeg_std_error(&encoder.errors.base);
  encoder.errors.base.error_exit = escape;
  if (setjmp(encoder.errors.escape) != 0) return false;
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, &encoder.bytes, &encoder.size);
  info.image_width = static_cast<JDIMENSION>(width);
  info.image_height = static_cast<JDIMENSION>(height);
  info.input_components = input == JpegInput::kRgb ? 3 : 1;
  info.in_color_space = input == JpegInput::kRgb ? JCS_RGB : JCS_GRAYSCALE;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, quality, TRUE);
  if (input == JpegInput::kRgb) {
    info.comp_info[0].h_samp_factor = 2;
    info.comp_info[0].v_samp_factor = 1;
  }
  jpeg_start_compress(&info, TRUE);
  const std::size_t stride = static_cast<std::size_t>(width) * static_cast<std::size_t>(info.input_components);
  while (info.next_scanline < info.image_height) {
    // The interface takes mutable rows and does not write to them.
    JSAMPROW row = const_cast<JSAMPROW>(pixels + info.next_scanline * stride);
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  return true;
}

}  // namespace

std::vector<std::uint8_t> encode_jpeg(std::span<const std::uint8_t> pixels, int width, int height, JpegInput input,
                                      int quality) {
  constexpr int kMaxSide = 65500;  // JPEG_MAX_DIMENSION
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide || quality < 1 || quality > 100) return {};
  const std::size_t components = input == JpegInput::kRgb ? 3 : 1;
  if (pixels.size() < static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * components) return {};

  // libjpeg grows into memory of its own and tells only at a good end. Starting in ours, a bad end can at
  // most leak, never free twice.
  std::vector<std::uint8_t> jpeg(pixels.size() / 8 + 4096);
  Encoder encoder{};
  encoder.bytes = jpeg.data();
  encoder.size = static_cast<unsigned long>(jpeg.size());
  const bool done = compress(encoder, pixels.data(), width, height, input, quality);
  jpeg_destroy_compress(&encoder.info);
  if (!done) return {};
  if (encoder.bytes == jpeg.data()) {
    jpeg.resize(encoder.size);
  } else {
    jpeg.assign(encoder.bytes, encoder.bytes + encoder.size);
    std::free(encoder.bytes);
  }
  return jpeg;
}

}  // namespace holdfast::scene
