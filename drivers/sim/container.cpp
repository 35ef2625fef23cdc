// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/container.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <string_view>

namespace holdfast::sim {
namespace {

using Bytes = std::span<const std::uint8_t>;

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

std::size_t little_endian32(Bytes bytes, std::size_t at) {
  return static_cast<std::size_t>(bytes[at]) | static_cast<std::size_t>(bytes[at + 1]) << 8 |
         static_cast<std::size_t>(bytes[at + 2]) << 16 | static_cast<std::size_t>(bytes[at + 3]) << 24;
}

bool tag_is(Bytes bytes, std::size_t at, std::string_view tag) {
  return std::memcmp(bytes.data() + at, tag.data(), 4) == 0;
}

class AviWalker {
 public:
  explicit AviWalker(Bytes bytes) : bytes_(bytes) {}

  std::optional<AviIndex> walk() {
    for (std::size_t at = 0; at + 12 <= bytes_.size();) {
      const bool first = at == 0;
      if (!tag_is(bytes_, at, "RIFF") || !tag_is(bytes_, at + 8, first ? "AVI " : "AVIX")) {
        if (first) return std::nullopt;
        break;  // something else was appended: not ours to judge
      }
      const std::size_t end = body_end(at);
      walk_list(at + 12, end, 0);
      at = end;
    }
    if (video_ < 0 && !index_.truncated) return std::nullopt;
    return std::move(index_);
  }

 private:
  static constexpr int kMaxDepth = 4;  // RIFF > movi > rec is the deepest that AVI knows

  // End of the chunk at `at`, padded to even; never past the file, which is then cut short. A list must hold
  // at least its type: a size below that was to be filled in when the recorder closed the file.
  std::size_t body_end(std::size_t at) {
    const std::size_t size = little_endian32(bytes_, at + 4);
    const bool unclosed = size < 4 && (tag_is(bytes_, at, "RIFF") || tag_is(bytes_, at, "LIST"));
    if (unclosed || size > bytes_.size() - at - 8) {
      index_.truncated = true;
      return bytes_.size();
    }
    return std::min(at + 8 + size + (size & 1), bytes_.size());
  }

  void walk_list(std::size_t at, std::size_t end, int depth) {
    while (at + 8 <= end) {
      const std::size_t size = little_endian32(bytes_, at + 4);
      const bool whole = size <= bytes_.size() - at - 8;
      const std::size_t next = std::min(body_end(at), end);
      if (tag_is(bytes_, at, "LIST") && at + 12 <= end) {
        if (depth < kMaxDepth) walk_list(at + 12, next, depth + 1);
      } else if (tag_is(bytes_, at, "strh")) {
        read_stream_header(at + 8, next);
      } else if (whole && is_video_chunk(at)) {
        index_.chunks.push_back({at + 8, size});
      }
      at = next;
    }
  }

  // AVISTREAMHEADER: fccType at 0, dwScale at 20, dwRate at 24, dwLength at 32.
  void read_stream_header(std::size_t at, std::size_t end) {
    const int stream = streams_++;
    if (video_ >= 0 || at + 36 > end || !tag_is(bytes_, at, "vids")) return;
    video_ = stream;
    const auto scale = static_cast<double>(little_endian32(bytes_, at + 20));
    const auto rate = static_cast<double>(little_endian32(bytes_, at + 24));
    index_.fps = scale > 0 ? rate / scale : 0;
    index_.announced = static_cast<long>(little_endian32(bytes_, at + 32));
  }

  // "NNdc" (compressed) or "NNdb" (plain), NN = number of the stream.
  [[nodiscard]] bool is_video_chunk(std::size_t at) const {
    return video_ >= 0 && bytes_[at] == '0' + video_ / 10 && bytes_[at + 1] == '0' + video_ % 10 &&
           bytes_[at + 2] == 'd' && (bytes_[at + 3] == 'c' || bytes_[at + 3] == 'b');
  }

  Bytes bytes_;
  AviIndex index_;
  int streams_ = 0;
  int video_ = -1;
};

}  // namespace

MappedFile::MappedFile(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
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
  std::size_t at = picture.begin + 2;
  while (at + 1 < bytes.size() && bytes[at] == 0xFF) {
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
    at += 2 + length;
    if (code == kSos) {
      scanned = true;
      at = skip_entropy(bytes, at);
    }
  }
  // Cut off inside the coded data: all the rest belongs to it. Otherwise a segment's length cannot be believed.
  picture.end = scanned && at >= bytes.size() ? bytes.size() : find_soi(bytes, picture.begin + 2);
  return picture;
}

std::optional<AviIndex> index_avi(Bytes bytes) {
  return AviWalker(bytes).walk();
}

}  // namespace holdfast::sim
