// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/kernel.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>

namespace holdfast::drivers {

int Kernel::open(const char* path, int flags) {
  return ::open(path, flags);
}
int Kernel::close(int fd) {
  return ::close(fd);
}
int Kernel::ioctl(int fd, unsigned long request, void* argument) {
  // Signals end the process in order or are ignored: a handful at most in its life.
  for (int tries = 0;; ++tries) {
    const int result = ::ioctl(fd, request, argument);
    if (result != -1 || errno != EINTR || tries == 16) return result;
  }
}
int Kernel::poll(pollfd* one, int timeout_ms) {
  return ::poll(one, 1, timeout_ms);
}
void* Kernel::map(int fd, std::size_t length, off_t offset) {
  return ::mmap(nullptr, length, PROT_READ, MAP_SHARED, fd, offset);
}
void Kernel::unmap(void* memory, std::size_t length) {
  (void)::munmap(memory, length);
}

Kernel& Kernel::real() {
  static Kernel kernel;
  return kernel;
}

}  // namespace holdfast::drivers
