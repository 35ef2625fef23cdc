// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/serial_pty.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/inotify.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>

namespace holdfast::sim {
namespace {

// The settings belong to the pair and stay when the slave is closed, which also brings it into the state of a cable
// that is out: before its first opening the kernel reports no hang-up.
bool make_raw(const char* path) {
  const int slave = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (slave < 0) return false;
  termios settings{};
  const bool ok = tcgetattr(slave, &settings) == 0;
  cfmakeraw(&settings);
  const bool set = ok && tcsetattr(slave, TCSANOW, &settings) == 0;
  close(slave);
  return set;
}

short events_of(int fd, short wanted, int timeout_ms) {
  pollfd entry{fd, wanted, 0};
  return poll(&entry, 1, timeout_ms) > 0 ? entry.revents : short{0};
}

}  // namespace

SerialPty::SerialPty() : master_(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
  std::array<char, 128> path{};
  const bool ok = master_ >= 0 && grantpt(master_) == 0 && unlockpt(master_) == 0 &&
                  ptsname_r(master_, path.data(), path.size()) == 0 && make_raw(path.data());
  closings_ = ok ? inotify_init1(IN_NONBLOCK | IN_CLOEXEC) : -1;
  if (closings_ >= 0 && inotify_add_watch(closings_, path.data(), IN_CLOSE) >= 0) {
    path_ = path.data();
    return;
  }
  shut();
}

SerialPty::~SerialPty() {
  shut();
}

void SerialPty::shut() {
  for (int* const fd : {&master_, &closings_}) {
    if (*fd >= 0) close(*fd);
    *fd = -1;
  }
}

bool SerialPty::connected() const {
  return opened() && (events_of(master_, 0, 0) & (POLLHUP | POLLERR)) == 0;
}

void SerialPty::wait(std::chrono::milliseconds at_most) const {
  const auto timeout = static_cast<int>(at_most.count());
  // Of a cable that is out poll() tells at once and every time: then there is nothing to wait for but time.
  events_of(connected() ? master_ : -1, POLLIN, timeout);
}

bool SerialPty::flush() {
  if (!connected()) {
    rest_begin_ = rest_end_ = 0;
    return false;
  }
  if (rest_begin_ == rest_end_) return true;
  const ssize_t taken = ::write(master_, &rest_[rest_begin_], rest_end_ - rest_begin_);
  if (taken > 0) rest_begin_ += static_cast<std::size_t>(taken);
  return rest_begin_ == rest_end_;
}

bool SerialPty::do_write(std::span<const std::uint8_t> bytes) {
  if (bytes.size() > kLongest || !flush()) return false;
  const ssize_t taken = ::write(master_, bytes.data(), bytes.size());
  if (taken <= 0) return false;
  const auto rest = bytes.subspan(static_cast<std::size_t>(taken));
  std::copy(rest.begin(), rest.end(), rest_.begin());
  rest_begin_ = 0;
  rest_end_ = rest.size();
  return true;
}

std::size_t SerialPty::do_read(std::span<std::uint8_t> bytes) {
  if (!opened()) return 0;
  if (rest_begin_ != rest_end_) (void)flush();
  const ssize_t count = ::read(master_, bytes.data(), bytes.size());
  const bool out = count < 0 && errno == EIO;
  std::array<char, 512> events;  // behind the read, so that nothing of who came after a closing comes before it is told
  if (::read(closings_, events.data(), events.size()) > 0 || out) ++hang_ups_;
  return count > 0 ? static_cast<std::size_t>(count) : 0;  // EAGAIN and EIO: there is nothing
}

}  // namespace holdfast::sim
