// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/file_calls.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

namespace holdfast::drivers {
namespace {

template <typename Call>
auto told(Call call) {
  auto result = call();
  while (result < 0 && errno == EINTR) result = call();
  return result < 0 ? static_cast<decltype(result)>(-errno) : result;
}

class SystemCalls final : public FileCalls {
 public:
  [[nodiscard]] int open(const char* path, How how) override {
    const int flags = how == How::kReadWriteOrMake ? O_RDWR | O_CREAT
                      : how == How::kFolder        ? O_RDONLY | O_DIRECTORY
                                                   : O_RDONLY | O_NONBLOCK;
    return told([&] { return ::open(path, flags | O_CLOEXEC, 0600); });
  }
  void close(int fd) override { (void)::close(fd); }
  [[nodiscard]] std::int64_t size(int fd) override {
    struct stat about {};
    const int result = told([&] { return ::fstat(fd, &about); });
    return result < 0 ? result : about.st_size;
  }
  [[nodiscard]] std::int64_t pread(int fd, std::span<std::uint8_t> bytes, std::int64_t at) override {
    return told([&] { return ::pread(fd, bytes.data(), bytes.size(), at); });
  }
  [[nodiscard]] std::int64_t pwrite(int fd, std::span<const std::uint8_t> bytes, std::int64_t at) override {
    return told([&] { return ::pwrite(fd, bytes.data(), bytes.size(), at); });
  }
  [[nodiscard]] int allocate(int fd, std::int64_t size) override {
    int result = ::posix_fallocate(fd, 0, size);  // tells its errno by itself
    while (result == EINTR) result = ::posix_fallocate(fd, 0, size);
    return -result;
  }
  [[nodiscard]] int fsync(int fd) override {
    return told([&] { return ::fsync(fd); });
  }
  [[nodiscard]] int fdatasync(int fd) override {
    return told([&] { return ::fdatasync(fd); });
  }
};

}  // namespace

bool is_foreign(FileCalls& calls, int fd, std::size_t our_size, std::span<const std::uint8_t> magic) {
  if (magic.empty()) return false;
  const std::int64_t size = calls.size(fd);
  if (size <= 0 || size == static_cast<std::int64_t>(our_size)) return false;
  std::array<std::uint8_t, 8> room{};
  const std::size_t count = std::min(magic.size(), static_cast<std::size_t>(size));
  const std::span<std::uint8_t> begins = std::span(room).first(count);
  if (calls.pread(fd, begins, 0) < 0) return false;
  const bool zeros = std::ranges::all_of(begins, [](std::uint8_t byte) { return byte == 0; });
  return !zeros && !std::ranges::equal(begins, magic.first(count));
}

FileCalls& system_calls() {
  static SystemCalls calls;
  return calls;
}

}  // namespace holdfast::drivers
