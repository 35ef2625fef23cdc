// SPDX-License-Identifier: Apache-2.0
// A serial port (or a pseudo terminal) of this computer: 115200 8N1, raw, for one program at a time, left as found.
//
// Reads never wait. A port that was unplugged tells so with every call, and is opened anew by its name.
#pragma once

#include <termios.h>

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace holdfast::console_tool {

class Port {
 public:
  enum class Opened : std::uint8_t { kYes, kNotThere, kNotAllowed, kBusy, kNoPort };

  Port() = default;
  ~Port() { close(); }
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;

  // Closes what was open.
  [[nodiscard]] Opened open(const std::string& path);
  void close();
  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  [[nodiscard]] int fd() const { return fd_; }  // to wait for
  [[nodiscard]] const std::string& path() const { return path_; }

  // How many bytes have come; -1: the other side has gone.
  [[nodiscard]] int read(std::span<std::uint8_t> bytes);
  // All of it, as fast as the port takes it. False: the other side has gone, or takes nothing for a second.
  [[nodiscard]] bool write(std::string_view text);

 private:
  int fd_ = -1;
  std::string path_;
  termios before_{};
};

// Why `path` did not open, in one line.
[[nodiscard]] std::string refusal(const std::string& path, Port::Opened why);
// Of one that did open, and where no Holdfast is.
[[nodiscard]] std::string no_answer(const std::string& path);

}  // namespace holdfast::console_tool
