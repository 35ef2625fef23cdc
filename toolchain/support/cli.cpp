// SPDX-License-Identifier: Apache-2.0
#include "toolchain/support/cli.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <csignal>
#include <cstdio>

#include "drivers/common/end_signals.hpp"
#include "drivers/common/trouble.hpp"
#include "toolchain/support/printable.hpp"

namespace holdfast::tool {
namespace {

volatile std::sig_atomic_t stop_asked = 0;

// Of what is printed. A handler may ask.
bool reader_gone() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

}  // namespace

std::string parse_shard(const std::string& text, int& shard, int& shards) {
  const char* const end = text.data() + text.size();
  const auto [slash, first] = std::from_chars(text.data(), end, shard);
  if (first == std::errc{} && slash != end && *slash == '/') {
    const auto [rest, second] = std::from_chars(slash + 1, end, shards);
    if (second == std::errc{} && rest == end && shard >= 1 && shard <= shards) return {};
  }
  return fmt::format(
      "--shard '{}': not a piece of a whole. Likely cause: not written as I/N, or counted from 0. Next: give 1/4, 2/4, "
      "3/4 and 4/4 to four runs",
      text);
}

std::string not_empty(const std::string& text) {
  return text.empty() ? "the name is empty" : "";
}

void note(const std::string& line) {
  // Not fmt's: it throws where stderr is full, and what should be said of that is lost anyway.
  (void)std::fputs(fmt::format("holdfast: {}\n", printable(line)).c_str(), stderr);
}

int printed(int status) {
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
  if (reader_gone()) return 1;  // it had enough, as `head` has: no news for anybody
  return fail(trouble("standard output could not be written to its end", "the disk behind it is full",
                      "free some space and run again"));
}

int fail(const std::string& line) {
  note(line);
  return 1;
}

std::optional<int> parse_command_line(CLI::App& cli, int argc, char** argv) {
  try {
    cli.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return printed(cli.exit(help));
  } catch (const CLI::ParseError& error) {
    const auto rest = cli.remaining();
    return fail(
        trouble(rest.empty() ? error.what() : fmt::format("'{}' is not known to {}", rest.front(), cli.get_name()),
                "a typing error, or something left out", cli.get_name() + " --help shows how"));
  }
  return std::nullopt;
}

void heed_interrupts() {
  heed_end_signals([](int) { stop_asked = 1; }, static_cast<int>(SA_RESETHAND));
  // Of a page or a port that hangs up nobody needs to be told; and another write to the pipe may follow.
  struct sigaction pipe {};
  pipe.sa_handler = [](int) {
    if (reader_gone()) stop_asked = 1;
  };
  ::sigaction(SIGPIPE, &pipe, nullptr);
}

bool interrupted() {
  return stop_asked != 0;
}

std::string interrupted_line() {
  return trouble("interrupted", reader_gone() ? "what read its output has ended" : "Ctrl-C",
                 "run it again; nothing was written");
}

}  // namespace holdfast::tool
