// SPDX-License-Identifier: Apache-2.0
#include "tests/linux/failing_calls.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <termios.h>

#include <cerrno>
#include <cstdarg>
#include <cstddef>

namespace holdfast::test {

FailingCalls& failing_calls() {
  static FailingCalls calls;
  return calls;
}

bool FailingCalls::fails() {
  if (!armed || ++counted != fails_at) return false;
  errno = error;
  return true;
}

}  // namespace holdfast::test

namespace {

bool fails() {
  return holdfast::test::failing_calls().fails();
}

}  // namespace

// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming): the linker's names
extern "C" {

int __real_open(const char* path, int flags, ...);
int __wrap_open(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(more, mode_t) : 0;
  va_end(more);
  return fails() ? -1 : __real_open(path, flags, mode);
}
int __real_close(int fd);
int __wrap_close(int fd) {
  const bool failed = fails();
  const int error = errno;
  const int result = __real_close(fd);
  if (!failed) return result;
  errno = error;
  return -1;
}
int __real_ioctl(int fd, unsigned long request, void* argument);
int __wrap_ioctl(int fd, unsigned long request, void* argument) {
  return fails() ? -1 : __real_ioctl(fd, request, argument);
}

#define WRAP(result, name, parameters, arguments, failure) \
  result __real_##name parameters;                         \
  result __wrap_##name parameters {                        \
    return fails() ? (failure) : __real_##name arguments;  \
  }

WRAP(ssize_t, read, (int fd, void* to, size_t count), (fd, to, count), -1)
WRAP(ssize_t, __read_chk, (int fd, void* to, size_t count, size_t room), (fd, to, count, room), -1)
WRAP(ssize_t, write, (int fd, const void* from, size_t count), (fd, from, count), -1)
WRAP(ssize_t, pread, (int fd, void* to, size_t count, off_t at), (fd, to, count, at), -1)
WRAP(ssize_t, pwrite, (int fd, const void* from, size_t count, off_t at), (fd, from, count, at), -1)
WRAP(int, posix_fallocate, (int fd, off_t from, off_t count), (fd, from, count), errno)
WRAP(int, fsync, (int fd), (fd), -1)
WRAP(int, fdatasync, (int fd), (fd), -1)
WRAP(int, fstat, (int fd, struct stat* about), (fd, about), -1)
WRAP(int, flock, (int fd, int operation), (fd, operation), -1)
WRAP(int, isatty, (int fd), (fd), 0)
WRAP(int, tcgetattr, (int fd, termios* settings), (fd, settings), -1)
WRAP(int, tcsetattr, (int fd, int when, const termios* settings), (fd, when, settings), -1)
WRAP(int, tcflush, (int fd, int queue), (fd, queue), -1)
WRAP(ssize_t, readlink, (const char* path, char* to, size_t room), (path, to, room), -1)
WRAP(ssize_t, __readlink_chk, (const char* path, char* to, size_t room, size_t size), (path, to, room, size), -1)
WRAP(ssize_t, getdents64, (int fd, void* to, size_t room), (fd, to, room), -1)

#undef WRAP
}
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)
