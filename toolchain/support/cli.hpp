// SPDX-License-Identifier: Apache-2.0
// What every command of the tool needs: checks of arguments, lines on stderr, Ctrl-C.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "drivers/common/number_range.hpp"  // number_from_to(), for every number with a fraction

namespace CLI {
class App;
}

namespace holdfast::tool {

// A command that brings its own options: what adds it puts it into the list of those that can be run.
struct Command {
  CLI::App* app = nullptr;
  std::function<int()> run;
};

// A check for names of files: a shell variable that is not set must not quietly mean "none". Empty, or what is wrong.
[[nodiscard]] std::string not_empty(const std::string& text);

// `I/N`: piece I of N, counted from 1. Empty, or an error line.
[[nodiscard]] std::string parse_shard(const std::string& text, int& shard, int& shards);

// One line on stderr, whatever is in it: control characters of file names become '?'. fail() returns the exit status.
[[nodiscard]] int fail(const std::string& line);
void note(const std::string& line);

// For a program without commands: a status to leave with, 0 where help was asked for.
[[nodiscard]] std::optional<int> parse_command_line(CLI::App& cli, int argc, char** argv);

// `status`, if all that was printed came out; else fail(), or 1 without a word where nobody reads any longer. For the
// end of a command, whatever it printed with.
[[nodiscard]] int printed(int status);

// After heed_interrupts() Ctrl-C, SIGTERM, a closed terminal or a pipe that nobody reads any longer ends a run between
// two frames, so that no temporary file stays behind; the second of the first three ends the program at once.
void heed_interrupts();
[[nodiscard]] bool interrupted();
[[nodiscard]] std::string interrupted_line();

}  // namespace holdfast::tool
