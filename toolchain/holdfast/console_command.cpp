// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/input_file.hpp"
#include "drivers/common/trouble.hpp"
#include "toolchain/console/device.hpp"
#include "toolchain/console/find.hpp"
#include "toolchain/console/load_file.hpp"
#include "toolchain/console/record.hpp"
#include "toolchain/console/terminal.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/support/printable.hpp"

namespace holdfast::tool {
namespace {

using console_tool::Answer;
using console_tool::Device;
using console_tool::Millis;
using console_tool::Port;
using console_tool::Signals;

struct ConsoleOptions {
  std::string port;
  std::vector<std::string> run;
  std::string load, record, code_file;
  double seconds = 0;  // 0: until Ctrl-C
  double timeout_s = 5.0;
};

constexpr Millis kToProbe{1500};

// The next line, or nothing: there are no more. Signals wait for nobody who types.
using NextLine = std::function<std::optional<std::string>()>;

NextLine lines_of(const std::vector<std::string>& lines) {
  return [&lines, k = std::size_t{0}]() mutable -> std::optional<std::string> {
    if (k == lines.size()) return std::nullopt;
    return lines[k++];
  };
}

NextLine standard_input(Signals& signals) {
  return [&signals, text = std::string(), ended = false]() mutable -> std::optional<std::string> {
    while (true) {
      if (const std::size_t end = text.find('\n'); end != std::string::npos) {
        std::string line = text.substr(0, end);
        text.erase(0, end + 1);
        if (line.ends_with('\r')) line.pop_back();
        return line;
      }
      if (ended) return text.empty() ? std::nullopt : std::optional(std::exchange(text, {}));
      std::array<pollfd, 2> ends{{{STDIN_FILENO, POLLIN, 0}, {signals.fd(), POLLIN, 0}}};
      if (::poll(ends.data(), ends.size(), -1) < 0) continue;
      if (ends[1].revents != 0 && signals.over()) return std::nullopt;
      if (ends[0].revents == 0) continue;
      std::array<char, 4096> bytes;
      const ssize_t count = ::read(STDIN_FILENO, bytes.data(), bytes.size());
      ended = count <= 0;
      if (!ended) text.append(bytes.data(), static_cast<std::size_t>(count));
    }
  };
}

// What follows a line that failed may stand on it, so that it is left out.
int run_lines(Device& device, const NextLine& next) {
  while (const std::optional<std::string> line = next()) {
    if (console_tool::says_nothing(*line)) continue;
    const Answer answer = device.say(*line, [](std::string_view text) { fmt::print("{}\n", printable(text)); });
    if (std::fflush(stdout) != 0) return 1;  // what is not read is not asked for
    if (answer.ok()) continue;
    if (answer.kind == Answer::Kind::kError && answer.number() != 0) {
      fmt::print(stderr, "{}\n", printable(answer.error));
    } else {
      note(answer.error);
    }
    long left = 0;
    while (!device.signals().ended() && !device.was_interrupted()) {
      const auto more = next();
      if (!more) break;
      left += console_tool::says_nothing(*more) ? 0 : 1;
    }
    if (left > 0) note(fmt::format("{} more commands were not run", left));
    return 1;
  }
  return 0;
}

int report_of(const std::string& error, const std::vector<std::string>& report) {
  for (const std::string& line : report) fmt::print("{}\n", printable(line));
  return error.empty() ? 0 : fail(error);
}

std::string unlock_by(Device& device, const std::string& path) {
  constexpr std::string_view kGive = "give the file that holdfastd was given as --code-file";
  std::ifstream in;
  if (std::string wrong = drivers::open_file(path, kGive, in); !wrong.empty()) return wrong;
  std::string code;
  if (!std::getline(in, code)) return trouble(path + ": holds no code", "an empty file", kGive);
  while (!code.empty() && (code.back() == '\r' || code.back() == ' ')) code.pop_back();
  const Answer answer = device.say("unlock " + code);
  return answer.ok() ? std::string{} : answer.error;
}

int act(Device& device, const ConsoleOptions& options) {
  std::vector<std::string> report;
  if (!options.code_file.empty()) {
    if (const std::string error = unlock_by(device, options.code_file); !error.empty()) return fail(error);
  }
  if (!options.run.empty()) return run_lines(device, lines_of(options.run));
  if (!options.load.empty()) {
    const std::string error = console_tool::load(device, options.load, report);
    return report_of(error, report);
  }
  if (!options.record.empty()) {
    const console_tool::RecordOptions how{options.record,
                                          options.seconds > 0 ? std::optional(options.seconds) : std::nullopt};
    const std::string error = console_tool::record(device, how, note, report);
    return report_of(error, report);
  }
  if (::isatty(STDIN_FILENO) == 1 && ::isatty(STDOUT_FILENO) == 1) return console_tool::run_terminal(device);
  return run_lines(device, standard_input(device.signals()));
}

int console(const ConsoleOptions& options) {
  const Millis patience(std::llround(options.timeout_s * 1000));
  if (!options.record.empty()) {
    if (const std::string error = console_tool::check_record_path(options.record); !error.empty()) return fail(error);
  }
  Signals signals;
  std::string path = options.port;
  if (path.empty()) {
    const console_tool::Found found =
        console_tool::find_device(devices::this_computer(), signals, std::min(patience, kToProbe));
    if (!found.error.empty()) return fail(found.error);
    path = found.path;
  }
  Port port;
  if (const Port::Opened opened = port.open(path); opened != Port::Opened::kYes) {
    return fail(console_tool::refusal(path, opened));
  }
  Device device(port, signals, patience);
  if (!device.attach(patience)) return fail(console_tool::no_answer(path));
  return act(device, options);
}

}  // namespace

void add_console(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<ConsoleOptions>();
  CLI::App* const command =
      app.add_subcommand("console", "talk to a device over its serial port, by hand or by script");
  command
      ->add_option("PORT", options->port,
                   "where it is; without it the one USB, ACM or AMA port that answers as a Holdfast (each is asked)")
      ->check(not_empty);
  auto* const group = command->add_option_group("instead of a prompt");
  group
      ->add_option("--run", options->run,
                   "give this line to the device and print its answer; may be given again. Ends at the first error")
      ->allow_extra_args(false);
  group->add_option("--load", options->load, "store what holdfast settings compile or holdfast model seal wrote")
      ->check(not_empty);
  group
      ->add_option(
          "--record", options->record,
          "stream telemetry into this file, .csv or .mcap, until Ctrl-C. Markers come with every fifth picture")
      ->check(not_empty);
  group->require_option(0, 1);
  command->add_option("--seconds", options->seconds, "end --record after so many")
      ->check(number_from_to(0.1, 1e7))
      ->needs("--record");
  command->add_option("--timeout", options->timeout_s, "how long the device may be silent within an answer, seconds")
      ->check(number_from_to(0.1, 3600))
      ->capture_default_str();
  command->add_option("--code-file", options->code_file, "unlock with the code in this file; locked again at the end")
      ->check(not_empty);
  command->footer(
      "At a terminal without one of these: the device's own prompt (Ctrl-D leaves). Otherwise the lines of stdin are "
      "run.\nExit status 0 only when every command ended with OK; the device's ERR lines go to stderr.\n"
      "Example:\n  holdfast console --run 'status json'\n  holdfast console /dev/ttyACM0 --record grasp.mcap");
  commands.push_back({command, [options] { return console(*options); }});
}

}  // namespace holdfast::tool
