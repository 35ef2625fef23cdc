// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/signals.hpp"

#include <sys/signalfd.h>
#include <unistd.h>

#include <initializer_list>

namespace holdfast::console_tool {

Signals::Signals() {
  sigset_t set{};
  ::sigemptyset(&set);
  // SIGTSTP: a view that is stopped would leave the terminal as it is, and the port to nobody.
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGWINCH, SIGTSTP}) ::sigaddset(&set, signal);
  ::sigprocmask(SIG_BLOCK, &set, &before_);
  fd_ = ::signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
}

// What came and nobody took goes: a second Ctrl-C is no reason to die after the first was obeyed.
Signals::~Signals() {
  while (take() != What::kNone && !ended_) {
  }
  if (fd_ >= 0) {
    signalfd_siginfo info{};
    while (::read(fd_, &info, sizeof info) == static_cast<ssize_t>(sizeof info)) {
    }
    ::close(fd_);
  }
  ::sigprocmask(SIG_SETMASK, &before_, nullptr);
}

Signals::What Signals::take() {
  signalfd_siginfo info{};
  while (::read(fd_, &info, sizeof info) == static_cast<ssize_t>(sizeof info)) {
    switch (static_cast<int>(info.ssi_signo)) {
      case SIGINT:
        return What::kInterrupt;
      case SIGWINCH:
        return What::kResize;
      case SIGTSTP:
        break;
      default:
        ended_ = true;
    }
  }
  return ended_ ? What::kEnd : What::kNone;
}

}  // namespace holdfast::console_tool
