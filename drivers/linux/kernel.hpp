// SPDX-License-Identifier: Apache-2.0
// The few system calls that a device driver lives on, so that tests can be the kernel. Results and errno as the system
// calls have them: -1 and errno.
#pragma once

#include <sys/types.h>
#include <cstddef>

struct pollfd;

namespace holdfast::drivers {

class Kernel {
 public:
  virtual ~Kernel() = default;
  [[nodiscard]] virtual int open(const char* path, int flags);
  [[nodiscard]] virtual int close(int fd);
  // Called again when a signal interrupts it.
  [[nodiscard]] virtual int ioctl(int fd, unsigned long request, void* argument);
  [[nodiscard]] virtual int poll(pollfd* one, int timeout_ms);
  [[nodiscard]] virtual void* map(int fd, std::size_t length, off_t offset);  // shared, to read; MAP_FAILED: none
  virtual void unmap(void* memory, std::size_t length);

  // The machine's own.
  [[nodiscard]] static Kernel& real();
};

}  // namespace holdfast::drivers
