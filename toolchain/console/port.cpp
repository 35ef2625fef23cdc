// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/port.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <cerrno>

#include "drivers/common/trouble.hpp"

namespace holdfast::console_tool {
namespace {

constexpr int kPatienceMs = 1000;

// The kernel keeps the mark of a pseudo terminal until its master ends, also when its owner was killed; of a real port
// it goes with the last one that closes it.
bool is_pseudo(int fd) {
  constexpr unsigned kFirst = 136, kLast = 143;  // major numbers of unix98 slaves
  struct stat status {};
  return ::fstat(fd, &status) == 0 && major(status.st_rdev) >= kFirst && major(status.st_rdev) <= kLast;
}

}  // namespace

Port::Opened Port::open(const std::string& path) {
  close();
  path_ = path;
  const int fd = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    switch (errno) {
      case EBUSY:
        return Opened::kBusy;
      case EACCES:
      case EPERM:
        return Opened::kNotAllowed;
      case EISDIR:
        return Opened::kNoPort;
      default:
        return Opened::kNotThere;
    }
  }
  const auto refuse = [&](Opened why) {
    ::close(fd);
    return why;
  };
  if (::isatty(fd) != 1 || ::tcgetattr(fd, &before_) != 0) return refuse(Opened::kNoPort);
  // The lock holds for other consoles of ours, root's included; the mark for everybody but root.
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) return refuse(Opened::kBusy);
  if (!is_pseudo(fd) && ::ioctl(fd, TIOCEXCL) != 0) return refuse(Opened::kBusy);
  termios raw = before_;
  ::cfmakeraw(&raw);
  raw.c_cflag |= static_cast<tcflag_t>(CLOCAL | CREAD);
  raw.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS | HUPCL);
  (void)::cfsetspeed(&raw, B115200);
  if (::tcsetattr(fd, TCSANOW, &raw) != 0) return refuse(Opened::kNoPort);
  fd_ = fd;
  return Opened::kYes;
}

void Port::close() {
  if (fd_ < 0) return;
  (void)::tcsetattr(fd_, TCSADRAIN, &before_);  // what was sent goes out as it was meant
  if (!is_pseudo(fd_)) (void)::ioctl(fd_, TIOCNXCL);
  ::close(fd_);
  fd_ = -1;
}

int Port::read(std::span<std::uint8_t> bytes) {
  if (fd_ < 0) return -1;
  const ssize_t count = ::read(fd_, bytes.data(), bytes.size());
  if (count > 0) return static_cast<int>(count);
  if (count < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
  // A raw port without input reads as nothing at all, and one that was unplugged does, too.
  pollfd entry{fd_, POLLIN, 0};
  const bool gone = count < 0 || (::poll(&entry, 1, 0) > 0 && (entry.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0);
  return gone ? -1 : 0;
}

bool Port::write(std::string_view text) {
  while (fd_ >= 0 && !text.empty()) {
    const ssize_t count = ::write(fd_, text.data(), text.size());
    if (count > 0) {
      text.remove_prefix(static_cast<std::size_t>(count));
      continue;
    }
    if (count < 0 && errno != EAGAIN && errno != EINTR) return false;
    pollfd entry{fd_, POLLOUT, 0};
    if (::poll(&entry, 1, kPatienceMs) <= 0 || (entry.revents & (POLLHUP | POLLERR)) != 0) return false;
  }
  return text.empty();
}

std::string refusal(const std::string& path, Port::Opened why) {
  switch (why) {
    case Port::Opened::kNotThere:
      return trouble(path + " cannot be opened", "a typing error, or the device is not plugged in",
                     "holdfast devices lists the ports");
    case Port::Opened::kNotAllowed:
      return trouble(path + " may not be used", "its group is not yours",
                     "sudo usermod -aG dialout $USER, and log in again");
    case Port::Opened::kBusy:
      return trouble(path + " is busy", "another console or terminal program has it", "end that one: fuser -v " + path);
    case Port::Opened::kNoPort:
      return trouble(path + " is no serial port", "a file or another device was named",
                     "holdfast devices lists the ports");
    case Port::Opened::kYes:
      break;
  }
  return {};
}

std::string no_answer(const std::string& path) {
  return trouble(path + " does not answer as a Holdfast",
                 "the firmware is not running, its console is on another port, or not at 115200 8N1",
                 "look at the device; holdfast devices lists the ports");
}

}  // namespace holdfast::console_tool
