// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/slot_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace holdfast::drivers {

SlotFile::SlotFile(const std::filesystem::path& path, std::size_t slot_bytes, FileCalls& calls,
                   std::span<const std::uint8_t> magic)
    : calls_(calls), slot_bytes_(slot_bytes), apart_((slot_bytes + kApart - 1) / kApart * kApart) {
  for (std::vector<std::uint8_t>& slot : found_) slot.resize(slot_bytes_);
  fd_ = calls_.open(path.c_str(), FileCalls::How::kReadWriteOrMake);
  const bool foreign = fd_ >= 0 && is_foreign(calls_, fd_, 2 * apart_, magic);
  int wrong = fd_ < 0 ? -fd_ : foreign ? EEXIST : make_durable(path);
  // A card that can only be read any more still says what was stored.
  if (fd_ < 0) fd_ = calls_.open(path.c_str(), FileCalls::How::kRead);
  // Of a slot that cannot be read nobody knows whether it is in force: the next write could go over it.
  const int unread = fd_ >= 0 ? read() : 0;
  if (wrong == 0) wrong = unread;
  if (wrong == 0) return;
  error_ = path.string() + ": " + (foreign ? "is another file, and stays as it is" : std::strerror(wrong)) +
           "; nothing can be stored there; " + (foreign ? "give another path" : "look at its folder");
}

SlotFile::~SlotFile() {
  if (fd_ >= 0) calls_.close(fd_);
}

int SlotFile::make_durable(const std::filesystem::path& path) {
  const std::int64_t size = calls_.size(fd_);
  if (size < 0) return static_cast<int>(-size);
  const std::array<std::uint8_t, kApart> zeros{};
  for (auto at = static_cast<std::size_t>(size); at < 2 * apart_;) {
    const std::size_t count = std::min(zeros.size(), 2 * apart_ - at);
    if (const int wrong = write_at(at, std::span(zeros).first(count)); wrong != 0) return wrong;
    at += count;
  }
  if (const int wrong = calls_.fsync(fd_); wrong < 0) return -wrong;
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
  const int folder_fd = calls_.open(folder.c_str(), FileCalls::How::kFolder);
  if (folder_fd < 0) return -folder_fd;
  const int wrong = calls_.fsync(folder_fd);
  calls_.close(folder_fd);
  return -wrong;
}

int SlotFile::read() {
  int wrong = 0;
  for (std::size_t slot = 0; slot < found_.size(); ++slot) {
    std::span<std::uint8_t> rest = found_[slot];
    std::size_t at = slot * apart_;
    readable_[slot] = true;
    while (!rest.empty()) {
      const std::int64_t count = calls_.pread(fd_, rest, static_cast<std::int64_t>(at));
      readable_[slot] = count >= 0;
      if (count < 0) wrong = static_cast<int>(-count);
      if (count <= 0) break;
      rest = rest.subspan(static_cast<std::size_t>(count));
      at += static_cast<std::size_t>(count);
    }
  }
  return wrong;
}

int SlotFile::write_at(std::size_t at, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const std::int64_t count = calls_.pwrite(fd_, bytes, static_cast<std::int64_t>(at));
    if (count < 0) return static_cast<int>(-count);
    if (count == 0) return EIO;
    bytes = bytes.subspan(static_cast<std::size_t>(count));
    at += static_cast<std::size_t>(count);
  }
  return 0;
}

int SlotFile::write(std::size_t slot, std::span<const std::uint8_t> bytes) {
  if (!error_.empty()) return EROFS;
  if (const int wrong = write_at(slot * apart_, bytes); wrong != 0) return wrong;
  return -calls_.fdatasync(fd_);
}

}  // namespace holdfast::drivers
