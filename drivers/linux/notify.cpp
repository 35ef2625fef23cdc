// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/notify.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace holdfast::drivers {

Notify::Notify() {
  const char* const path = std::getenv("NOTIFY_SOCKET");
  if (path == nullptr) return;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t length = std::strlen(path);
  if (length < 2 || length >= sizeof address.sun_path) return;
  std::memcpy(address.sun_path, path, length);
  if (address.sun_path[0] == '@') address.sun_path[0] = '\0';  // in the abstract name space
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + length);
  if (fd >= 0 && ::connect(fd, reinterpret_cast<const sockaddr*>(&address), size) == 0) {
    fd_ = fd;
  } else if (fd >= 0) {
    (void)::close(fd);
  }
}

Notify::~Notify() {
  if (fd_ >= 0) (void)::close(fd_);
}

void Notify::tell(std::string_view words) const {
  // What is not taken is told again in kPeriod.
  if (fd_ >= 0) (void)::send(fd_, words.data(), words.size(), MSG_NOSIGNAL);
}

}  // namespace holdfast::drivers
