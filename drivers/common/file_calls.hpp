// SPDX-License-Identifier: Apache-2.0
// The system calls that keep a file durable, one method each, so that a test can put a disk in their place that loses
// its power between any two of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace holdfast::drivers {

// Each returns what the call returns, and the negative errno instead of -1. EINTR has been dealt with.
class FileCalls {
 public:
  virtual ~FileCalls() = default;
  enum class How : std::uint8_t { kReadWriteOrMake, kRead, kFolder };
  [[nodiscard]] virtual int open(const char* path, How how) = 0;
  virtual void close(int fd) = 0;
  [[nodiscard]] virtual std::int64_t size(int fd) = 0;
  [[nodiscard]] virtual std::int64_t pread(int fd, std::span<std::uint8_t> bytes, std::int64_t at) = 0;
  [[nodiscard]] virtual std::int64_t pwrite(int fd, std::span<const std::uint8_t> bytes, std::int64_t at) = 0;
  // posix_fallocate: the file has `size` bytes at least, and a place for each.
  [[nodiscard]] virtual int allocate(int fd, std::int64_t size) = 0;
  [[nodiscard]] virtual int fsync(int fd) = 0;
  [[nodiscard]] virtual int fdatasync(int fd) = 0;
};

// Those of the machine.
[[nodiscard]] FileCalls& system_calls();

// Whether the file is somebody else's: neither empty nor of our size, and begins with neither `magic`, or what it has
// room for of that, nor zeros, which a file of ours does that was just made or whose first write the power cut. Range:
// no magic: every file is ours.
[[nodiscard]] bool is_foreign(FileCalls& calls, int fd, std::size_t our_size, std::span<const std::uint8_t> magic);

}  // namespace holdfast::drivers
