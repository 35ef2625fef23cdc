// SPDX-License-Identifier: Apache-2.0
// The emulated GelSight Mini as a program beside an emulated machine:
//   qemu-system-aarch64 ... -device qemu-xhci -chardev socket,id=cam,path=SOCKET,server=on,wait=off
//     -device usb-redir,chardev=cam
//   usb_camera SOCKET FILM.mjpg
// Commands (camera_commands.hpp) come from stdin, a line each, and are answered on stdout. It calls the machine until
// it is there, and again when it hung up. It ends with its stdin, so that a harness that died leaves no camera behind;
// never because of what the machine sends.
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "tests/support/mjpg_file.hpp"
#include "tests/system/camera_commands.hpp"
#include "tests/system/recode.hpp"
#include "tests/system/usb_camera.hpp"
#include "tests/system/usbredir.hpp"

namespace {

using namespace holdfast::test;
using namespace std::chrono_literals;

constexpr auto kCallAgain = 50ms;

Moment now() {
  return std::chrono::steady_clock::now();
}

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() { close(); }
  void close() {
    if (fd_ > 2) ::close(fd_);
    fd_ = -1;
  }
  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool open() const { return fd_ >= 0; }

 private:
  int fd_;
};

std::optional<sockaddr_un> address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return std::nullopt;
  std::copy(path.begin(), path.end(), address.sun_path);
  return address;
}

Descriptor unix_socket() {
  return Descriptor(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
}

Descriptor call(const sockaddr_un& address) {
  Descriptor line = unix_socket();
  if (::connect(line.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) line.close();
  return line;
}

int until(std::optional<Moment> due) {
  if (!due) return -1;
  if (*due <= now()) return 0;
  return static_cast<int>(
      std::min<std::int64_t>(std::chrono::ceil<std::chrono::milliseconds>(*due - now()).count(), 1'000'000));
}

struct Station {
  Station(std::vector<Bytes> film, const sockaddr_un& at) : camera(std::move(film)), machine(at) {}

  UsbCamera camera;
  UsbredirPeer peer{camera};
  sockaddr_un machine;
  Descriptor line{};
  Moment call_at{};
  std::string text;  // of a command, until it is a line

  void meet_machine() {
    if (line.open() || now() < call_at) return;
    line = call(machine);
    call_at = now() + kCallAgain;
    if (!line.open()) return;
    peer.begin(line.get());
    std::fputs("connected\n", stderr);
  }

  void hang_up() {
    std::fputs("hung up: the machine has gone, or spoke another protocol\n", stderr);
    line.close();
    camera.reset();
  }

  // False: whoever gives commands has gone.
  bool serve() {
    std::array<char, 1024> bytes{};
    const ssize_t count = ::read(STDIN_FILENO, bytes.data(), bytes.size());
    if (count < 0) return errno == EAGAIN || errno == EINTR;
    if (count == 0) return false;
    text.append(bytes.data(), static_cast<std::size_t>(count));
    for (std::size_t end = 0; (end = text.find('\n')) != std::string::npos;) {
      const std::string answer = obey(text.substr(0, end), camera, peer) + "\n";
      text.erase(0, end + 1);
      if (::write(STDOUT_FILENO, answer.data(), answer.size()) < 0) return false;
    }
    return true;
  }

  void run() {
    while (true) {
      meet_machine();
      bool backlog = false;
      if (line.open()) {
        // What is not taken is not made: a machine that is slow to read must not fill our memory.
        if (!peer.backlog()) peer.pump(now());
        if (!peer.send()) hang_up();
        backlog = line.open() && peer.backlog();
      }
      std::array<pollfd, 2> ends{
          {{line.get(), static_cast<short>(backlog ? POLLIN | POLLOUT : POLLIN), 0}, {STDIN_FILENO, POLLIN, 0}}};
      std::optional<Moment> due = backlog ? std::nullopt : peer.due();
      if (!line.open()) due = call_at;
      if (::poll(ends.data(), ends.size(), until(due)) < 0 && errno != EINTR) return;
      if (ends[0].revents != 0 && !peer.receive()) hang_up();
      if (ends[1].revents != 0 && !serve()) return;
    }
  }
};

int fail(const std::string& what, const char* next) {
  std::fprintf(stderr, "error: %s. Next: %s\n", what.c_str(), next);
  return 1;
}

int run(int argc, char** argv) {
  std::string machine, film_path;
  std::uint32_t period_ms = 40;
  bool unplugged = false;
  CLI::App app("The emulated GelSight Mini: a usbredir peer for an emulated machine.", "usb_camera");
  app.add_option("SOCKET", machine, "of the machine's usb-redir device, which listens there")->required();
  app.add_option("FILM", film_path, "pictures one behind the other (system_film makes one)")->required();
  app.add_option("--period", period_ms, "ms from frame to frame")->capture_default_str();
  app.add_flag("--unplugged", unplugged, "wait for the command plug");
  CLI11_PARSE(app, argc, argv);

  std::signal(SIGPIPE, SIG_IGN);
  std::vector<Bytes> film = read_mjpg(film_path);
  if (film.empty()) {
    return fail(film_path + ": no pictures (no such file, or no JPEG stream)", "make one with system_film");
  }
  const std::optional<sockaddr_un> machine_address = address_of(machine);
  if (!machine_address) {
    return fail("a socket's path is too long (the kernel takes 107 letters)", "use a shorter one");
  }
  Station station(std::move(film), *machine_address);
  station.camera.set_grain(recoded);
  station.camera.set_period(std::chrono::milliseconds(period_ms));
  if (unplugged) station.peer.unplug();
  station.run();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s (no memory). Next: free some\n", error.what());
    return 1;
  }
}
