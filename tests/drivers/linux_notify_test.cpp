// SPDX-License-Identifier: Apache-2.0
// What the service manager is told, by a socket that plays it.
#include "drivers/linux/notify.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

#include <CppUTest/TestHarness.h>

using holdfast::drivers::Notify;
using namespace std::chrono_literals;

namespace {

// An abstract address of this process alone: nothing is left in the file system.
class Manager {
 public:
  Manager() : name_("@holdfast-test-" + std::to_string(::getpid())) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path + 1, name_.data() + 1, name_.size() - 1);
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name_.size());
    (void)::bind(fd_, reinterpret_cast<const sockaddr*>(&address), size);
    ::setenv("NOTIFY_SOCKET", name_.c_str(), 1);
  }
  ~Manager() {
    ::unsetenv("NOTIFY_SOCKET");
    ::close(fd_);
  }
  Manager(const Manager&) = delete;
  Manager& operator=(const Manager&) = delete;

  // Empty: nothing was said.
  std::string heard() {
    std::array<char, 64> bytes{};
    const ssize_t count = ::recv(fd_, bytes.data(), bytes.size(), 0);
    return {bytes.data(), count > 0 ? static_cast<std::size_t>(count) : 0};
  }

 private:
  std::string name_;
  int fd_ = -1;
};

}  // namespace

TEST_GROUP(LinuxNotify){};

TEST(LinuxNotify, SaysThatItIsReadyAndGoesRound) {
  Manager manager;
  Notify notify;
  CHECK_TRUE(notify.connected());
  notify.ready();
  STRCMP_EQUAL("READY=1", manager.heard().c_str());
  for (auto now = 0us; now <= 250ms; now += 5ms) notify.alive(now);
  for (int i = 0; i < 3; ++i) STRCMP_EQUAL("WATCHDOG=1", manager.heard().c_str());  // at 0, 100 and 200 ms
  STRCMP_EQUAL("", manager.heard().c_str());
}

TEST(LinuxNotify, AManagerThatDoesNotListenHoldsNobodyUp) {
  Manager manager;
  Notify notify;
  for (int i = 0; i < 10'000; ++i) notify.alive(i * 100ms);
  STRCMP_EQUAL("WATCHDOG=1", manager.heard().c_str());
}

TEST(LinuxNotify, WithoutAManagerNothingIsTold) {
  ::unsetenv("NOTIFY_SOCKET");
  Notify none;
  CHECK_FALSE(none.connected());
  none.ready();
  none.alive(1s);
  for (const char* path : {"", "@", "/nowhere/holdfast-notify"}) {
    ::setenv("NOTIFY_SOCKET", path, 1);
    CHECK_FALSE(Notify().connected());
  }
  ::setenv("NOTIFY_SOCKET", std::string(200, 'x').c_str(), 1);
  CHECK_FALSE(Notify().connected());
  ::unsetenv("NOTIFY_SOCKET");
}
