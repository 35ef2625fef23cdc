// SPDX-License-Identifier: Apache-2.0
// What holdfastd is on every board: a process with a command line, signals that end it in order, and an output that
// nobody has to read.
#pragma once

#include <optional>
#include <string>

#include "app/params.hpp"
#include "hal/serial.hpp"

namespace CLI {
class App;
}

namespace holdfast::board {

// Says on standard error what went wrong and returns `status`.
int fail(int status, const std::string& what, const char* likely, const char* next);

// The option --set name=value, checked against the table of parameters.
void add_set(CLI::App& cli, Params& params);
// A status to leave with: 0 help was asked for, 2 the command line is wrong or its settings contradict each other.
[[nodiscard]] std::optional<int> parse_command_line(CLI::App& cli, int argc, char** argv, const Params& params);

// From now on SIGTERM and SIGINT ask the process to end, and a reader that has gone is no reason to let go.
void heed_signals();
[[nodiscard]] bool asked_to_end();

// A pipe that is full takes the rest of it nowhere.
class StandardOutput final : public hal::Serial {
 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t>) override { return 0; }
};

}  // namespace holdfast::board
