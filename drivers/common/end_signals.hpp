// SPDX-License-Identifier: Apache-2.0
// The signals by which a program is asked to end.
#pragma once

#include <csignal>

namespace holdfast {

// From now on SIGINT, SIGTERM and SIGHUP call `ask`, which may do what a handler may. `flags`: sigaction's.
inline void heed_end_signals(void (*ask)(int), int flags = 0) {
  struct sigaction action {};
  action.sa_handler = ask;
  action.sa_flags = flags;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  // A terminal that is closed; nohup ignores it, and the program goes on.
  struct sigaction before {};
  if (::sigaction(SIGHUP, nullptr, &before) == 0 && before.sa_handler != SIG_IGN) {
    ::sigaction(SIGHUP, &action, nullptr);
  }
  // A file that may not grow is an error of the write, and not the end.
  struct sigaction never {};
  never.sa_handler = SIG_IGN;
  ::sigaction(SIGXFSZ, &never, nullptr);
}

}  // namespace holdfast
