// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/terminal.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstdio>
#include <string_view>

#include "drivers/common/trouble.hpp"
#include "link/link.hpp"

namespace holdfast::console_tool {
namespace {

constexpr char kLeave = 'D' - '@';  // Ctrl-D; no key of the device's editor
constexpr int kTryEveryMs = 250;

// Every key as it is pressed, Ctrl-C too: it ends what the device prints.
class RawTerminal {
 public:
  RawTerminal() {
    (void)::tcgetattr(STDIN_FILENO, &before_);
    termios raw = before_;
    ::cfmakeraw(&raw);
    raw.c_oflag |= OPOST;
    (void)::tcsetattr(STDIN_FILENO, TCSADRAIN, &raw);
  }
  ~RawTerminal() { (void)::tcsetattr(STDIN_FILENO, TCSADRAIN, &before_); }
  RawTerminal(const RawTerminal&) = delete;
  RawTerminal& operator=(const RawTerminal&) = delete;

 private:
  termios before_{};
};

void print(std::string_view text) {
  fmt::print("{}", text);
  (void)std::fflush(stdout);
}

// False: the other side has gone.
bool show(Port& port, link::Receiver& frames) {
  std::array<std::uint8_t, 4096> bytes;
  const int count = port.read(bytes);
  for (int i = 0; i < count; ++i) {
    if (frames.push(bytes[static_cast<std::size_t>(i)]) != link::Event::kText) continue;
    print({reinterpret_cast<const char*>(frames.text().data()), frames.text().size()});
  }
  return count >= 0;
}

}  // namespace

int run_terminal(Device& device) {
  Port& port = device.port();
  Signals& signals = device.signals();
  const RawTerminal raw;
  link::Receiver frames;
  print("Ctrl-D leaves. Tab completes, help lists the commands.\n");
  (void)port.write("echo on\r");
  while (true) {
    std::array<pollfd, 3> ends{{{STDIN_FILENO, POLLIN, 0}, {signals.fd(), POLLIN, 0}, {port.fd(), POLLIN, 0}}};
    if (::poll(ends.data(), ends.size(), kTryEveryMs) < 0) continue;
    if (!port.is_open()) {
      if (device.reopen()) print(device.port_name() + " is back\n");
    } else if (ends[2].revents != 0 && !show(port, frames)) {
      port.close();
      print("\n" +
            trouble(device.port_name() + " has gone", "unplugged, or the firmware ended",
                    "plug it in again; this goes on then. Ctrl-D leaves") +
            "\n");
    }
    if (ends[1].revents != 0 && signals.take() == Signals::What::kEnd) break;
    if (ends[0].revents == 0) continue;
    std::array<char, 256> keys;
    const ssize_t count = ::read(STDIN_FILENO, keys.data(), keys.size());
    const std::string_view typed(keys.data(), count > 0 ? static_cast<std::size_t>(count) : 0);
    const std::size_t leave = typed.find(kLeave);
    if (port.is_open()) (void)port.write(typed.substr(0, leave));
    if (count <= 0 || leave != std::string_view::npos) break;
  }
  print("\n");
  if (!port.is_open()) return 1;
  (void)port.write("\x03lock\r");
  return 0;
}

}  // namespace holdfast::console_tool
