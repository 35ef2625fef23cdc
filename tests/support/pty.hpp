// SPDX-License-Identifier: Apache-2.0
// The far end of a serial cable: the master of a pseudo terminal, whose slave a driver opens by path().
#pragma once

#include <fcntl.h>
#include <poll.h>

#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

namespace holdfast::test {

class Pty {
 public:
  Pty() : master_(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    std::array<char, 128> path{};
    if (master_ >= 0 && grantpt(master_) == 0 && unlockpt(master_) == 0 &&
        ptsname_r(master_, path.data(), path.size()) == 0) {
      path_ = path.data();
    }
  }
  ~Pty() { unplug(); }
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] int master() const { return master_; }
  // Whoever has the other end open sees a hang-up.
  void unplug() {
    if (master_ >= 0) ::close(master_);
    master_ = -1;
  }

  bool send(const std::vector<std::uint8_t>& bytes) const {
    return ::write(master_, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size());
  }
  // What is there now, at most `most`.
  [[nodiscard]] std::vector<std::uint8_t> take(std::size_t most = 1U << 20U) const {
    std::vector<std::uint8_t> bytes;
    std::array<std::uint8_t, 4096> buffer{};
    while (bytes.size() < most) {
      const ssize_t count = ::read(master_, buffer.data(), std::min(buffer.size(), most - bytes.size()));
      if (count <= 0) break;
      bytes.insert(bytes.end(), buffer.begin(), buffer.begin() + count);
    }
    return bytes;
  }
  // Waits for `count` bytes; fewer when the deadline passes first.
  [[nodiscard]] std::vector<std::uint8_t> expect(std::size_t count) const {
    std::vector<std::uint8_t> bytes;
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (bytes.size() < count && std::chrono::steady_clock::now() < until) {
      const std::vector<std::uint8_t> more = take(count - bytes.size());
      bytes.insert(bytes.end(), more.begin(), more.end());
      pollfd entry{master_, POLLIN, 0};
      if (bytes.size() < count) (void)::poll(&entry, 1, 100);
    }
    return bytes;
  }
  [[nodiscard]] termios settings() const {
    termios settings{};
    (void)::tcgetattr(master_, &settings);
    return settings;
  }

 private:
  int master_;
  std::string path_;
};

}  // namespace holdfast::test
