// SPDX-License-Identifier: Apache-2.0
#include "tests/system/recode.hpp"

#include <cstdio>
#include <cstdlib>
#include <random>

#include <jpeglib.h>

namespace holdfast::test {
namespace {

constexpr std::uint32_t kBlocksPerGrain = 32;

void add_grain(jpeg_decompress_struct& in, jvirt_barray_ptr luma, std::uint64_t grain) {
  std::minstd_rand draw(static_cast<std::minstd_rand::result_type>(grain));
  const jpeg_component_info& component = in.comp_info[0];
  for (JDIMENSION row = 0; row < component.height_in_blocks; ++row) {
    JBLOCKARRAY blocks = (*in.mem->access_virt_barray)(reinterpret_cast<j_common_ptr>(&in), luma, row, 1, TRUE);
    for (JDIMENSION column = 0; column < component.width_in_blocks; ++column) {
      const auto drawn = draw();
      if (drawn % kBlocksPerGrain != 0) continue;
      JCOEF& level = blocks[0][column][0];
      const bool lighter = level < 0 || (level == 0 && drawn / kBlocksPerGrain % 2 == 0);
      level = static_cast<JCOEF>(level + (lighter ? 1 : -1));  // towards grey: never out of range
    }
  }
}

}  // namespace

std::vector<std::uint8_t> recoded(const std::vector<std::uint8_t>& jpeg, std::uint64_t grain) {
  jpeg_error_mgr errors{};
  jpeg_decompress_struct in{};
  in.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&in);
  jpeg_mem_src(&in, jpeg.data(), static_cast<unsigned long>(jpeg.size()));
  jpeg_read_header(&in, TRUE);
  jvirt_barray_ptr* const coefficients = jpeg_read_coefficients(&in);
  if (grain != 0) add_grain(in, coefficients[0], grain);

  jpeg_compress_struct out{};
  out.err = &errors;
  jpeg_create_compress(&out);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&out, &bytes, &size);
  jpeg_copy_critical_parameters(&in, &out);
  out.optimize_coding = TRUE;
  jpeg_write_coefficients(&out, coefficients);
  jpeg_finish_compress(&out);
  jpeg_destroy_compress(&out);
  jpeg_finish_decompress(&in);
  jpeg_destroy_decompress(&in);
  std::vector<std::uint8_t> result(bytes, bytes + size);
  std::free(bytes);
  return result;
}

}  // namespace holdfast::test
