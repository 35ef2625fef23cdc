// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/file_keep.hpp"

#include <algorithm>
#include <cerrno>

namespace holdfast::drivers {

FileKeep::FileKeep(const std::filesystem::path& path, std::size_t bytes, FileCalls& calls,
                   std::span<const std::uint8_t> magic)
    : calls_(calls), bytes_(bytes), fd_(calls.open(path.c_str(), FileCalls::How::kReadWriteOrMake)) {
  if (fd_ >= 0 && is_foreign(calls_, fd_, bytes_, magic)) {
    calls_.close(fd_);
    fd_ = -EEXIST;
  }
  if (succeeds(fd_)) (void)succeeds(calls_.allocate(fd_, static_cast<std::int64_t>(bytes_)));
}

FileKeep::~FileKeep() {
  if (fd_ >= 0) calls_.close(fd_);
}

bool FileKeep::succeeds(std::int64_t result) {
  error_ = result < 0 ? static_cast<int>(-result) : 0;
  return error_ == 0;
}

bool FileKeep::do_read(std::size_t at, std::span<std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const std::int64_t count = calls_.pread(fd_, bytes, static_cast<std::int64_t>(at));
    if (count < 0) return false;
    if (count == 0) std::fill(bytes.begin(), bytes.end(), std::uint8_t{0});
    const std::size_t had = count == 0 ? bytes.size() : static_cast<std::size_t>(count);
    bytes = bytes.subspan(had);
    at += had;
  }
  return true;
}

// All is well again only when there is a place for every byte: a small record may fit where the large one does not.
bool FileKeep::do_write(std::size_t at, std::span<const std::uint8_t> bytes) {
  if (error_ != 0 && !succeeds(calls_.allocate(fd_, static_cast<std::int64_t>(bytes_)))) return false;
  while (!bytes.empty()) {
    const std::int64_t count = calls_.pwrite(fd_, bytes, static_cast<std::int64_t>(at));
    if (!succeeds(count == 0 ? -EIO : count)) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(count));
    at += static_cast<std::size_t>(count);
  }
  return true;
}

}  // namespace holdfast::drivers
