// SPDX-License-Identifier: Apache-2.0
// The emulated GelSight Mini as a program beside an emulated machine:
//   qemu-system-aarch64 ... -device qemu-xhci -chardev socket,id=cam,path=SOCKET,server=on,wait=off
//     -device usb-redir,chardev=cam
//   usb_camera SOCKET FILM.mjpg [--control SOCKET2]
// Commands come from stdin and from connections to SOCKET2, a line each, and are answered where they came from.
// It calls the machine until it is there, and again when it hung up. Without --control it ends with its stdin, so that
// a harness that died leaves no camera behind; it never ends because of what the machine sends.
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
#include <cstring>
#include <exception>
#include <fstream>
#include <memory>
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
constexpr std::size_t kLongestLine = 4096;
constexpr std::size_t kMostControls = 8;

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

Descriptor listen_at(const sockaddr_un& address) {
  Descriptor door = unix_socket();
  ::unlink(address.sun_path);
  if (::bind(door.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(door.get(), 4) != 0) {
    door.close();
  }
  return door;
}

// Who gives commands: bytes in, until they are a line.
struct Commander {
  Descriptor in;
  int out = -1;  // stdout, or the same socket
  std::string text;
};

// False: it has gone, or sends no lines.
bool serve(Commander& commander, UsbCamera& camera, UsbredirPeer& peer) {
  std::array<char, 1024> bytes{};
  const ssize_t count = ::read(commander.in.get(), bytes.data(), bytes.size());
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  if (count == 0) return false;
  commander.text.append(bytes.data(), static_cast<std::size_t>(count));
  for (std::size_t end = 0; (end = commander.text.find('\n')) != std::string::npos;) {
    const std::string answer = obey(commander.text.substr(0, end), camera, peer) + "\n";
    commander.text.erase(0, end + 1);
    if (::write(commander.out, answer.data(), answer.size()) < 0) return false;
  }
  return commander.text.size() <= kLongestLine;
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
  Descriptor door{};
  Descriptor line{};
  Moment call_at{};
  std::vector<std::unique_ptr<Commander>> commanders;

  void meet_machine() {
    if (line.open() || now() < call_at) return;
    line = call(machine);
    call_at = now() + kCallAgain;
    if (!line.open()) return;
    peer.begin();
    std::fputs("connected\n", stderr);
  }

  void hang_up(const char* why) {
    std::fprintf(stderr, "hung up: %s\n", why);
    line.close();
    camera.reset();
    peer.out().clear();
  }

  void read_machine() {
    std::array<std::uint8_t, 65536> bytes;
    const ssize_t count = ::read(line.get(), bytes.data(), bytes.size());
    if (count < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (count <= 0) {
      hang_up("the machine has gone");
    } else if (!peer.receive(std::span(bytes).first(static_cast<std::size_t>(count)))) {
      hang_up(peer.broken().c_str());
    }
  }

  void write_machine() {
    Bytes& out = peer.out();
    if (!line.open() || out.empty()) return;
    const ssize_t count = ::send(line.get(), out.data(), out.size(), MSG_NOSIGNAL);
    if (count > 0) {
      out.erase(out.begin(), out.begin() + count);
    } else if (errno != EAGAIN && errno != EINTR) {
      hang_up("the machine has gone");
    }
  }

  void run() {
    while (!commanders.empty() || door.open()) {
      meet_machine();
      // What is not taken is not made: a machine that is slow to read must not fill our memory.
      if (peer.out().empty()) peer.pump(now());
      write_machine();
      const bool backlog = !peer.out().empty();
      std::vector<pollfd> ends{{line.get(), static_cast<short>(backlog ? POLLIN | POLLOUT : POLLIN), 0},
                               {door.get(), POLLIN, 0}};
      for (const auto& commander : commanders) ends.push_back({commander->in.get(), POLLIN, 0});
      std::optional<Moment> due = backlog ? std::nullopt : peer.due();
      if (!line.open()) due = call_at;
      if (::poll(ends.data(), ends.size(), until(due)) < 0 && errno != EINTR) return;
      if (ends[0].revents != 0) read_machine();
      if (ends[1].revents != 0 && commanders.size() < kMostControls) {
        Descriptor guest(::accept4(door.get(), nullptr, nullptr, SOCK_CLOEXEC));
        const int fd = guest.get();
        if (guest.open()) commanders.push_back(std::make_unique<Commander>(Commander{std::move(guest), fd, {}}));
      }
      for (std::size_t k = ends.size() - 2; k-- > 0;) {
        if (ends[k + 2].revents != 0 && !serve(*commanders[k], camera, peer)) {
          commanders.erase(commanders.begin() + static_cast<std::ptrdiff_t>(k));
        }
      }
    }
  }
};

int fail(const std::string& what, const char* next) {
  std::fprintf(stderr, "error: %s. Next: %s\n", what.c_str(), next);
  return 1;
}

int run(int argc, char** argv) {
  std::string machine, film_path, control;
  std::uint32_t period_ms = 40;
  bool unplugged = false;
  CLI::App app("The emulated GelSight Mini: a usbredir peer for an emulated machine.", "usb_camera");
  app.footer("Commands, a line each, on stdin and on --control:\n" + std::string(kCameraHelp));
  app.add_option("SOCKET", machine, "of the machine's usb-redir device, which listens there")->required();
  app.add_option("FILM", film_path, "pictures one behind the other (system_film makes one)")->required();
  app.add_option("--control", control, "listen for commands at this socket");
  app.add_option("--period", period_ms, "ms from frame to frame")->capture_default_str();
  app.add_flag("--unplugged", unplugged, "wait for the command plug");
  CLI11_PARSE(app, argc, argv);

  std::signal(SIGPIPE, SIG_IGN);
  std::vector<Bytes> film = read_mjpg(film_path);
  if (film.empty()) {
    return fail(film_path + ": no pictures (no such file, or no JPEG stream)", "make one with system_film");
  }
  const std::optional<sockaddr_un> machine_address = address_of(machine);
  const std::optional<sockaddr_un> control_address = address_of(control);
  if (!machine_address || !control_address) {
    return fail("a socket's path is too long (the kernel takes 107 letters)", "use a shorter one");
  }
  Station station(std::move(film), *machine_address);
  station.camera.set_grain(recoded);
  station.camera.set_period(std::chrono::milliseconds(period_ms));
  if (unplugged) station.peer.unplug();
  if (!control.empty()) {
    station.door = listen_at(*control_address);
    if (!station.door.open()) {
      return fail(control + ": " + std::strerror(errno) + " (no such folder, or no right)", "choose another place");
    }
  }
  station.commanders.push_back(std::make_unique<Commander>(Commander{Descriptor(STDIN_FILENO), STDOUT_FILENO, {}}));
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
