// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/file_keep.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace holdfast::drivers {

FileKeep::FileKeep(const std::filesystem::path& path, std::size_t bytes) {
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  void* memory = MAP_FAILED;
  if (fd >= 0 && ::ftruncate(fd, static_cast<off_t>(bytes)) == 0) {
    memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  }
  if (memory == MAP_FAILED) {
    error_ = path.string() + ": " + std::strerror(errno) + "; nothing is kept there; look at its folder";
  } else {
    memory_ = {static_cast<std::uint8_t*>(memory), bytes};
  }
  if (fd >= 0) ::close(fd);
}

FileKeep::~FileKeep() {
  if (!memory_.empty()) ::munmap(memory_.data(), memory_.size());
}

}  // namespace holdfast::drivers
