// SPDX-License-Identifier: Apache-2.0
// Runs a program as a user would, and keeps what it said. Waits on conditions with a deadline, never for a time.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <string>
#include <string_view>
#include <vector>

#include "tests/support/deadline.hpp"

namespace holdfast::test {

struct Finished {
  int status = -1;  // exit status; 128 + number when a signal ended it; -1 when it could not be started
  bool in_time = true;
  std::string out;
  std::string err;
};

class HostProcess {
 public:
  enum class Stderr { kPipe, kTerminal };  // a terminal of 80 columns turns "\n" into "\r\n"

  // command[0] is a path or found on PATH. stdin is empty; the environment is the caller's.
  explicit HostProcess(const std::vector<std::string>& command, Stderr where = Stderr::kPipe);
  ~HostProcess();  // kills what still runs
  HostProcess(const HostProcess&) = delete;
  HostProcess& operator=(const HostProcess&) = delete;

  // False: it ended, or the deadline passed, without having said so.
  [[nodiscard]] bool err_says(std::string_view text, std::chrono::seconds deadline = kDeadline);
  void send(int signal) const;
  [[nodiscard]] pid_t pid() const { return pid_; }
  // Reads to the end; kills the program at the deadline.
  [[nodiscard]] Finished finish(std::chrono::seconds deadline = kDeadline);

 private:
  // Waits for output. False: none can come any more, or none came before `until`.
  [[nodiscard]] bool read_some(std::chrono::steady_clock::time_point until);

  pid_t pid_ = -1;
  int out_ = -1, err_ = -1;  // our ends; -1: closed
  Finished finished_;
};

[[nodiscard]] inline Finished run(const std::vector<std::string>& command) {
  return HostProcess(command).finish();
}

}  // namespace holdfast::test
