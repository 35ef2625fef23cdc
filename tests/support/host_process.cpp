// SPDX-License-Identifier: Apache-2.0
#include "tests/support/host_process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdlib>

namespace holdfast::test {
namespace {

using Clock = std::chrono::steady_clock;

struct Ends {
  int ours = -1, theirs = -1;
};

Ends open_pipe() {
  std::array<int, 2> fd{-1, -1};
  if (::pipe2(fd.data(), O_CLOEXEC) != 0) return {};
  return {fd[0], fd[1]};
}

Ends open_terminal() {
  const int ours = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (ours < 0 || ::grantpt(ours) != 0 || ::unlockpt(ours) != 0) return {ours, -1};
  const int theirs = ::open(::ptsname(ours), O_RDWR | O_NOCTTY | O_CLOEXEC);
  const winsize size{24, 80, 0, 0};
  ::ioctl(theirs, TIOCSWINSZ, &size);
  return {ours, theirs};
}

void close_once(int& fd) {
  if (fd >= 0) ::close(fd);
  fd = -1;
}

// A terminal whose other side is closed reports EIO where a pipe reports its end.
void take(int& fd, std::string& text) {
  std::array<char, 65536> bytes;
  const ssize_t count = ::read(fd, bytes.data(), bytes.size());
  if (count > 0) {
    text.append(bytes.data(), static_cast<std::size_t>(count));
  } else {
    close_once(fd);
  }
}

}  // namespace

HostProcess::HostProcess(const std::vector<std::string>& command, Stderr where) {
  Ends out = open_pipe();
  Ends err = where == Stderr::kTerminal ? open_terminal() : open_pipe();
  out_ = out.ours;
  err_ = err.ours;
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_adddup2(&actions, out.theirs, STDOUT_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, err.theirs, STDERR_FILENO);
  if (::posix_spawnp(&pid_, arguments[0], &actions, nullptr, arguments.data(), environ) != 0) pid_ = -1;
  ::posix_spawn_file_actions_destroy(&actions);
  close_once(out.theirs);
  close_once(err.theirs);
}

HostProcess::~HostProcess() {
  if (pid_ > 0) {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  close_once(out_);
  close_once(err_);
}

bool HostProcess::read_some(Clock::time_point until) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()).count();
  std::array<pollfd, 2> ends{{{out_, POLLIN, 0}, {err_, POLLIN, 0}}};  // poll() skips negative ones
  if (left <= 0 || (out_ < 0 && err_ < 0)) return false;
  if (::poll(ends.data(), ends.size(), static_cast<int>(left)) <= 0) return false;
  if (ends[0].revents != 0) take(out_, finished_.out);
  if (ends[1].revents != 0) take(err_, finished_.err);
  return true;
}

bool HostProcess::err_says(std::string_view text, std::chrono::seconds deadline) {
  const auto until = Clock::now() + deadline;
  while (finished_.err.find(text) == std::string::npos) {
    if (!read_some(until)) return false;
  }
  return true;
}

void HostProcess::send(int signal) const {
  if (pid_ > 0) ::kill(pid_, signal);
}

Finished HostProcess::finish(std::chrono::seconds deadline) {
  const auto until = Clock::now() + deadline;
  while (read_some(until)) {
  }
  finished_.in_time = out_ < 0 && err_ < 0;
  if (pid_ > 0) {
    if (!finished_.in_time) ::kill(pid_, SIGKILL);
    int status = 0;
    ::waitpid(pid_, &status, 0);
    finished_.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    pid_ = -1;
  }
  return finished_;
}

}  // namespace holdfast::test
