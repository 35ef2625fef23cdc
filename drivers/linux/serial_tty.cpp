// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/serial_tty.hpp"

#include <fcntl.h>
#include <linux/serial.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

namespace holdfast::drivers {
namespace {

constexpr std::pair<std::uint32_t, speed_t> kSpeeds[] = {
    {1200, B1200},       {2400, B2400},       {4800, B4800},       {9600, B9600},       {19200, B19200},
    {38400, B38400},     {57600, B57600},     {115200, B115200},   {230400, B230400},   {460800, B460800},
    {500000, B500000},   {576000, B576000},   {921600, B921600},   {1000000, B1000000}, {1152000, B1152000},
    {1500000, B1500000}, {2000000, B2000000}, {2500000, B2500000}, {3000000, B3000000}, {3500000, B3500000},
    {4000000, B4000000},
};
constexpr std::int64_t kBitsPerByte = 10;  // 8N1: start, eight, stop
constexpr int kPortsTold = 4;

std::optional<speed_t> speed_of(std::uint32_t baud) {
  for (const auto& [rate, speed] : kSpeeds) {
    if (rate == baud) return speed;
  }
  return std::nullopt;
}

// Raw, and as set: tcsetattr() is content when it could do any part of it.
int set_up(int fd, speed_t speed) {
  termios settings{};
  if (::tcgetattr(fd, &settings) != 0) return errno;
  ::cfmakeraw(&settings);
  settings.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS | HUPCL);
  settings.c_cflag |= CLOCAL | CREAD;
  // With VMIN 1 an empty port is EAGAIN and 0 is a hang-up; with VMIN 0 both would be 0.
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  ::cfsetispeed(&settings, speed);
  ::cfsetospeed(&settings, speed);
  if (::tcsetattr(fd, TCSANOW, &settings) != 0) return errno;
  termios got{};
  if (::tcgetattr(fd, &got) != 0) return errno;
  constexpr tcflag_t kControl = CSIZE | PARENB | CSTOPB | CRTSCTS | CLOCAL | CREAD;
  const bool same = ((got.c_cflag ^ settings.c_cflag) & kControl) == 0 && got.c_lflag == settings.c_lflag &&
                    got.c_iflag == settings.c_iflag && got.c_oflag == settings.c_oflag &&
                    ::cfgetospeed(&got) == speed && got.c_cc[VMIN] == 1;
  return same ? 0 : EINVAL;
}

// Best effort: drivers without a latency timer do not know it, and only root may change what the kernel does with
// output that nobody takes when a process is killed: it holds the dead process for 30 s otherwise, and its restart with
// it.
void tune(int fd) {
  serial_struct serial{};
  if (::ioctl(fd, TIOCGSERIAL, &serial) != 0) return;
  serial.flags |= static_cast<int>(ASYNC_LOW_LATENCY);
  const auto waits = std::exchange(serial.closing_wait, static_cast<unsigned short>(ASYNC_CLOSING_WAIT_NONE));
  if (::ioctl(fd, TIOCSSERIAL, &serial) == 0) return;
  serial.closing_wait = waits;
  (void)::ioctl(fd, TIOCSSERIAL, &serial);
}

std::uint64_t overruns_of(int fd) {
  serial_icounter_struct counts{};
  if (::ioctl(fd, TIOCGICOUNT, &counts) != 0) return 0;  // a pseudo terminal does not count
  return static_cast<std::uint64_t>(counts.overrun) + static_cast<std::uint64_t>(counts.buf_overrun);
}

std::size_t waiting_in(int fd) {
  int waiting = 0;
  return ::ioctl(fd, TIOCOUTQ, &waiting) == 0 && waiting > 0 ? static_cast<std::size_t>(waiting) : 0;
}

bool is_try_again(int error) {
  return error == EAGAIN || error == EINTR;  // EWOULDBLOCK is the same number
}

// Range: waiting < 2^32 (an int of the kernel, and kLongest), so waiting * 10^7 < 2^56.
std::chrono::microseconds time_of(std::size_t waiting, std::uint32_t baud) {
  return std::chrono::microseconds{static_cast<std::int64_t>(waiting) * kBitsPerByte * 1'000'000 / baud};
}

std::string ports_in(const std::filesystem::path& folder) {
  std::string names;
  int told = 0;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (++told > kPortsTold) return names + ", ...";
    names += (names.empty() ? "'" : ", '") + entry->path().filename().string() + "'";
  }
  return names;
}

std::string in_use(const std::string& path, const std::string& why) {
  return path + ": in use (" + why +
         "). Likely cause: a terminal program, a second holdfastd, a login prompt, or ModemManager, which looks at "
         "every new port. Next: see `fuser -v " +
         path + "` and end it";
}

}  // namespace

bool SerialTty::in_time(std::size_t waiting, std::uint32_t baud, std::chrono::microseconds backlog) {
  return backlog.count() <= 0 || waiting == 0 || time_of(waiting, baud) <= backlog;
}

std::string SerialTty::open(Config config) {
  close();
  config_ = std::move(config);
  counters_ = {};
  if (!speed_of(config_.baud)) {
    std::string rates;
    for (const auto& [rate, speed] : kSpeeds) rates += (rates.empty() ? "" : ", ") + std::to_string(rate);
    return config_.path + ": no port has " + std::to_string(config_.baud) +
           " baud. Likely cause: a typing error. Next: give one of " + rates;
  }
  wanted_ = true;
  wait_ = kFirstWait;
  if (try_open()) return "";
  put_off();
  return told();
}

void SerialTty::close() {
  const bool out = fd_ >= 0 && let_out();
  if (fd_ >= 0) free_port(out);
  wanted_ = false;
  rest_begin_ = rest_end_ = 0;
}

// In the time that what waits needs at this rate, and no longer.
bool SerialTty::let_out() {
  constexpr std::chrono::microseconds kLookAgain{2000};
  constexpr std::chrono::microseconds kLongest{1'000'000};
  const std::size_t waiting = waiting_in(fd_) + (rest_end_ - rest_begin_);
  const auto looks = std::min(time_of(waiting, config_.baud), kLongest) / kLookAgain + 2;
  for (std::int64_t i = 0; i < looks; ++i) {
    const bool handed_over = flush();
    if (fd_ < 0) return false;
    if (handed_over && waiting_in(fd_) == 0) return true;
    std::this_thread::sleep_for(kLookAgain);
  }
  return false;
}

// Output that nobody takes would hold close() for 30 s (closing_wait; seen on an emulated 16550 with a stuck far end).
// And another holder would keep the mark alive, and the port would stay shut for everybody.
void SerialTty::free_port(bool all_out) {
  // On a pseudo terminal this takes even what was handed over.
  if (!all_out) (void)::tcflush(fd_, TCIOFLUSH);
  (void)::ioctl(fd_, TIOCNXCL);
  ::close(fd_);
  fd_ = -1;
}

SerialTty::Counters SerialTty::counters() const {
  Counters counters = counters_;
  if (fd_ >= 0) counters.overruns += overruns_of(fd_) - overruns_before_;
  return counters;
}

std::string SerialTty::told() const {
  const std::string& path = config_.path;
  const std::string why = std::strerror(failure_.error);
  switch (failure_.step) {
    case Step::kOpen:
      break;
    case Step::kKind:
      return path + ": not a serial port (" + why +
             "). Likely cause: a typing error in the port's name. Next: choose one of /dev/serial/by-id, or "
             "/dev/ttyAMA0";
    case Step::kLock:
      return in_use(path, why);
    case Step::kSettings:
      return path + ": does not take " + std::to_string(config_.baud) + " baud, 8N1 (" + why +
             "). Likely cause: the adapter does not know this rate. Next: use 115200, or another adapter";
  }
  if (failure_.error == EACCES || failure_.error == EPERM) {
    return path + ": " + why +
           ". Likely cause: the user of this process is not in the group dialout. Next: add it (usermod -aG dialout "
           "NAME, or SupplementaryGroups=dialout in the unit) and start again";
  }
  if (failure_.error == EBUSY) return in_use(path, why);  // TIOCEXCL of somebody else
  const std::string others =
      ports_in(std::filesystem::path(path).parent_path() == "/dev" ? "/dev/serial/by-id"
                                                                   : std::filesystem::path(path).parent_path());
  return path + ": " + why + "; there is " + (others.empty() ? "no serial adapter" : others) +
         ". Likely cause: the adapter is not plugged in, or it is another one. Next: plug it in (it is tried again), "
         "or give the name of the one that is there";
}

// The lock first: what another program has set up is left alone.
bool SerialTty::try_open() {
  ++counters_.attempts;
  const int fd = ::open(config_.path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    failure_ = {Step::kOpen, errno};
    return false;
  }
  const std::optional<speed_t> speed = speed_of(config_.baud);
  if (::isatty(fd) == 0) {
    failure_ = {Step::kKind, errno};
  } else if (::flock(fd, LOCK_EX | LOCK_NB) != 0 || ::ioctl(fd, TIOCEXCL) != 0) {
    failure_ = {Step::kLock, errno};
  } else if (const int failed = set_up(fd, *speed); failed != 0) {
    failure_ = {Step::kSettings, failed};
    (void)::ioctl(fd, TIOCNXCL);
  } else {
    tune(fd);
    (void)::tcflush(fd, TCIOFLUSH);  // what came before was read at another speed, or for somebody else
    overruns_before_ = overruns_of(fd);
    fd_ = fd;
    return true;
  }
  ::close(fd);
  return false;
}

void SerialTty::put_off() {
  next_try_ = clock_.now() + wait_;
  wait_ = std::min<std::chrono::microseconds>(wait_ * 2, kLongestWait);
}

bool SerialTty::open_or_retry() {
  if (fd_ >= 0) return true;
  if (!wanted_ || clock_.now() < next_try_) return false;
  if (!try_open()) {
    put_off();
    return false;
  }
  ++counters_.reopenings;
  wait_ = kFirstWait;
  return true;
}

void SerialTty::hang_up() {
  ++counters_.hang_ups;
  free_port(false);
  rest_begin_ = rest_end_ = 0;
  wait_ = kFirstWait;
  put_off();
}

bool SerialTty::flush() {
  if (rest_begin_ == rest_end_) return true;
  const ssize_t taken = ::write(fd_, &rest_[rest_begin_], rest_end_ - rest_begin_);
  if (taken > 0) rest_begin_ += static_cast<std::size_t>(taken);
  if (taken < 0 && !is_try_again(errno)) hang_up();
  return fd_ >= 0 && rest_begin_ == rest_end_;
}

bool SerialTty::do_write(std::span<const std::uint8_t> bytes) {
  ++counters_.refused;
  if (bytes.size() > kLongest || !open_or_retry() || !flush()) return false;
  if (!in_time(waiting_in(fd_), config_.baud, config_.backlog)) return false;
  const ssize_t taken = ::write(fd_, bytes.data(), bytes.size());
  if (taken < 0 && !is_try_again(errno)) hang_up();
  if (taken <= 0) return false;
  --counters_.refused;
  counters_.written += bytes.size();
  const auto rest = bytes.subspan(static_cast<std::size_t>(taken));
  std::copy(rest.begin(), rest.end(), rest_.begin());
  rest_begin_ = 0;
  rest_end_ = rest.size();
  if (!rest.empty()) ++counters_.split;
  return true;
}

std::size_t SerialTty::do_read(std::span<std::uint8_t> bytes) {
  if (!open_or_retry()) return 0;
  (void)flush();
  if (fd_ < 0) return 0;
  const ssize_t count = ::read(fd_, bytes.data(), bytes.size());
  if (count > 0) {
    counters_.read += static_cast<std::size_t>(count);
    return static_cast<std::size_t>(count);
  }
  if (count == 0 || !is_try_again(errno)) hang_up();
  return 0;
}

}  // namespace holdfast::drivers
