// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/screen.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>
#include <string_view>

namespace holdfast::console_tool {
namespace {

void write_all(std::string_view text) {
  while (!text.empty()) {
    const ssize_t count = ::write(STDOUT_FILENO, text.data(), text.size());
    if (count <= 0) return;
    text.remove_prefix(static_cast<std::size_t>(count));
  }
}

}  // namespace

Screen::Screen() {
  (void)std::fflush(stdout);
  raw_ = ::tcgetattr(STDIN_FILENO, &before_) == 0;
  if (raw_) {
    termios keys = before_;
    keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    keys.c_cc[VMIN] = 1;
    keys.c_cc[VTIME] = 0;
    (void)::tcsetattr(STDIN_FILENO, TCSADRAIN, &keys);
  }
  write_all("\x1B[?1049h\x1B[?25l");
}

Screen::~Screen() {
  write_all("\x1B[0m\x1B[2J\x1B[H\x1B[?25h\x1B[?1049l");
  if (raw_) (void)::tcsetattr(STDIN_FILENO, TCSADRAIN, &before_);
}

Screen::Size Screen::size() const {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) return {};
  return {size.ws_col, size.ws_row};
}

std::optional<char> Screen::key() const {
  pollfd entry{STDIN_FILENO, POLLIN, 0};
  char byte = 0;
  if (::poll(&entry, 1, 0) <= 0 || ::read(STDIN_FILENO, &byte, 1) != 1) return std::nullopt;
  return byte;
}

void Screen::forget() {
  cleared_ = false;
}

void Screen::show(const std::vector<std::string>& lines) {
  std::string out;
  if (!cleared_) {
    out = "\x1B[2J";
    shown_.clear();
    cleared_ = true;
  }
  for (std::size_t y = 0; y < lines.size(); ++y) {
    if (y < shown_.size() && shown_[y] == lines[y]) continue;
    out += fmt::format("\x1B[{};1H{}\x1B[K", y + 1, lines[y]);
  }
  shown_ = lines;
  write_all(out);
}

}  // namespace holdfast::console_tool
