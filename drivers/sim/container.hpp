// SPDX-License-Identifier: Apache-2.0
// Finds pictures in raw MJPEG streams in memory (a mapped file), without decoding them; never reads outside of them,
// and ends for every input.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>

namespace holdfast::sim {

// A file mapped for reading; empty when it cannot be.
class MappedFile {
 public:
  explicit MappedFile(const std::filesystem::path& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return {data_, size_}; }

 private:
  const std::uint8_t* data_ = nullptr;
  std::size_t size_ = 0;
};

struct JpegExtent {
  std::size_t begin = 0;  // of SOI
  std::size_t end = 0;    // one past EOI, or where the picture breaks off
  bool complete = false;  // SOI to EOI with at least one scan
  int width = 0;          // from SOF; 0: none seen
  int height = 0;
};

// The next picture at or after `from`. Bytes before its SOI are skipped. A picture that breaks off ends
// before the next SOI, or at the end of the bytes. Follows the marker segments (ITU-T T.81, B.1), so that a
// thumbnail inside an APPn segment is not taken for a picture.
[[nodiscard]] std::optional<JpegExtent> find_jpeg(std::span<const std::uint8_t> bytes, std::size_t from);

}  // namespace holdfast::sim
