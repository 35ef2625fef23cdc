// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/container.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>

namespace holdfast::sim {
namespace {

using Bytes = std::span<const std::uint8_t>;

// So that made-up bytes, of which every one may begin a chain of markers, are walked in a time that grows as they do. A
// colour profile has up to 255 segments.
constexpr int kMostMarkers = 1000;
constexpr std::size_t kLongestScanHeader = 14;  // of four components

constexpr std::uint8_t kSoi = 0xD8, kEoi = 0xD9, kSos = 0xDA, kTem = 0x01;

bool is_restart(std::uint8_t code) {
  return code >= 0xD0 && code <= 0xD7;
}

// SOF0-15 without DHT, JPG and DAC, which share the range.
bool is_frame_header(std::uint8_t code) {
  return code >= 0xC0 && code <= 0xCF && code != 0xC4 && code != 0xC8 && code != 0xCC;
}

// SOI is always followed by another marker, which three fixed bytes say; at the very end two must do.
std::size_t find_soi(Bytes bytes, std::size_t from) {
  while (from + 1 < bytes.size()) {
    const void* hit = std::memchr(bytes.data() + from, 0xFF, bytes.size() - 1 - from);
    if (hit == nullptr) break;
    from = static_cast<std::size_t>(static_cast<const std::uint8_t*>(hit) - bytes.data());
    if (bytes[from + 1] == kSoi && (from + 2 == bytes.size() || bytes[from + 2] == 0xFF)) return from;
    ++from;
  }
  return bytes.size();
}

// Position of the first marker at or after `at` inside entropy-coded data (stuffed zeros and restarts belong
// to the data), or the end of the bytes.
std::size_t skip_entropy(Bytes bytes, std::size_t at) {
  while (at + 1 < bytes.size()) {
    const void* hit = std::memchr(bytes.data() + at, 0xFF, bytes.size() - 1 - at);
    if (hit == nullptr) break;
    at = static_cast<std::size_t>(static_cast<const std::uint8_t*>(hit) - bytes.data());
    const std::uint8_t code = bytes[at + 1];
    if (code == 0xFF) {
      ++at;
    } else if (code == 0 || is_restart(code)) {
      at += 2;
    } else {
      return at;
    }
  }
  return bytes.size();
}

std::size_t big_endian16(Bytes bytes, std::size_t at) {
  return static_cast<std::size_t>(bytes[at]) << 8 | bytes[at + 1];
}

}  // namespace

MappedFile::MappedFile(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a pipe is no reason to wait
  if (fd < 0) return;
  struct stat status {};
  if (::fstat(fd, &status) == 0 && S_ISREG(status.st_mode) && status.st_size > 0) {
    const auto size = static_cast<std::size_t>(status.st_size);
    void* data = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, fd, 0);
    if (data != MAP_FAILED) {
      data_ = static_cast<const std::uint8_t*>(data);
      size_ = size;
    }
  }
  ::close(fd);
}

MappedFile::~MappedFile() {
  if (data_ != nullptr) ::munmap(const_cast<std::uint8_t*>(data_), size_);
}

std::optional<JpegExtent> find_jpeg(Bytes bytes, std::size_t from) {
  JpegExtent picture;
  picture.begin = find_soi(bytes, from);
  if (picture.begin >= bytes.size()) return std::nullopt;
  bool scanned = false;
  std::size_t believed = picture.begin;  // the marker behind which a picture may begin, should this one end in nothing
  std::size_t at = picture.begin + 2;
  for (int markers = 0; markers < kMostMarkers && at + 1 < bytes.size() && bytes[at] == 0xFF; ++markers) {
    const std::uint8_t code = bytes[at + 1];
    if (code == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    if (code == kEoi) {
      picture.end = at + 2;
      picture.complete = scanned;
      return picture;
    }
    if (code == kSoi) {
      picture.end = at;
      return picture;
    }
    if (code == kTem || is_restart(code)) {
      at += 2;
      continue;
    }
    if (at + 4 > bytes.size()) break;
    const std::size_t length = big_endian16(bytes, at + 2);
    if (code == 0 || length < 2 || length > bytes.size() - at - 2) break;
    if (is_frame_header(code) && length >= 8) {
      picture.height = static_cast<int>(big_endian16(bytes, at + 5));
      picture.width = static_cast<int>(big_endian16(bytes, at + 7));
    }
    if (code == kSos && length > kLongestScanHeader) break;
    if (code == kSos) believed = at;
    at += 2 + length;
    if (code == kSos) {
      scanned = true;
      at = skip_entropy(bytes, at);
    }
  }
  // Cut off inside the coded data: all the rest belongs to it. Otherwise a segment's length cannot be believed.
  picture.end = scanned && at >= bytes.size() ? bytes.size() : find_soi(bytes, believed + 2);
  return picture;
}

}  // namespace holdfast::sim
