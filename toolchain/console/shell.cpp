// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/shell.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/console/line_input.hpp"
#include "toolchain/console/record.hpp"
#include "toolchain/console/settings_file.hpp"
#include "toolchain/console/vocabulary.hpp"
#include "toolchain/console/watching.hpp"
#include "toolchain/support/trouble.hpp"

namespace holdfast::console_tool {
namespace {

constexpr Millis kToAttach{1500};

std::vector<std::string> typed_words(std::string_view line) {
  std::vector<std::string> words;
  while (true) {
    const std::size_t begin = line.find_first_not_of(" \t");
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    const std::string_view word = line.substr(0, line.find_first_of(" \t"));
    words.emplace_back(word);
    line.remove_prefix(word.size());
  }
}

class Shell {
 public:
  explicit Shell(Device& device)
      : device_(device),
        input_(device.signals(),
               {.fd = [this] { return away_ ? -1 : device_.port().fd(); }, .ready = [this] { attend(); }}) {
    device_.heard.line = [this](std::string_view line) { input_.show(line); };
  }
  ~Shell() { device_.heard = {}; }
  Shell(const Shell&) = delete;
  Shell& operator=(const Shell&) = delete;

  int run() {
    greet();
    while (!over_) {
      const LineInput::Typed result = input_.read(prompt());
      if (result.got == LineInput::Got::kEnd) break;
      if (result.got == LineInput::Got::kInterrupt) {
        if (away_) break;
        (void)device_.interrupt();  // ends what the device streams
        continue;
      }
      obey(result.line);
      (void)device_.was_interrupted();
      if (device_.signals().ended()) break;
    }
    return away_ ? 1 : 0;
  }

 private:
  [[nodiscard]] std::string_view prompt() const { return device_.unlocked() ? "holdfast# " : "holdfast> "; }
  void print(const std::string& line) { input_.show(line); }

  void greet() {
    const auto version = nlohmann::json::parse(device_.version(), nullptr, false);
    if (version.is_object()) {
      print(fmt::format("{} on {} at {}, model {}", version.value("firmware", "?"), version.value("board", "?"),
                        device_.port_name(), version.value("model", "?")));
    }
    print("help lists the device's commands, Tab completes, Ctrl-D leaves. Here as well:");
    for (const Word& word : local_words())
      print(fmt::format("  {:15} {}", word.name + " " + word.arguments, word.help));
    input_.set_vocabulary(learn_vocabulary(device_));
    const Answer answer = device_.say("status json");
    const auto status = nlohmann::json::parse(answer.lines.empty() ? "" : answer.lines.back(), nullptr, false);
    if (status.is_object()) print(fmt::format("* {} {}", status.value("state", "?"), status.value("reason", "?")));
  }

  // While nobody types: what the device says by itself, and whether it is there.
  void attend() {
    if (away_) {
      if (!device_.reopen()) return;
      if (!device_.attach(kToAttach)) return device_.port().close();
      away_ = false;
      print(device_.port_name() + " is back");
      input_.set_vocabulary(learn_vocabulary(device_));
      input_.set_prompt(prompt());
    } else if (!device_.listen()) {
      lose();
    }
  }

  void lose() {
    away_ = true;
    device_.port().close();
    print(gone_line(device_));
  }

  void obey(const std::string& line) {
    if (says_nothing(line)) return;
    const std::vector<std::string> words = typed_words(line);
    if (words[0] == "quit" || words[0] == "exit") {
      over_ = true;
    } else if (away_) {
      print(gone_line(device_));
    } else if (words[0] == "backup" || words[0] == "restore" || words[0] == "record") {
      local(words);
    } else if (words[0] == "unlock" && words.size() == 1) {
      const LineInput::Typed code = input_.read_secret("code: ");
      if (code.got == LineInput::Got::kLine && !code.line.empty()) ask("unlock " + code.line);
    } else {
      ask(line);
    }
  }

  void ask(const std::string& line) {
    const Answer answer = device_.say(line, [this](std::string_view text) { print(std::string(text)); });
    if (answer.kind == Answer::Kind::kGone) return lose();
    print(answer.ok() ? "OK" : answer.error);
  }

  void local(const std::vector<std::string>& words) {
    if (words.size() != 2) {
      return print(trouble(words[0] + " wants the name of one file", "a typing error", words[0] + " FILE"));
    }
    std::vector<std::string> report;
    std::string error;
    if (words[0] == "backup") error = backup(device_, words[1], report);
    if (words[0] == "restore") error = restore(device_, words[1], report);
    if (words[0] == "record") {
      print("recording; Ctrl-C ends it");
      error = record(
          device_, {words[1], std::nullopt}, [this](const std::string& text) { print(text); }, report);
    }
    for (const std::string& one : report) print(one);
    print(error.empty() ? "OK" : error);
    if (!device_.port().is_open()) lose();
  }

  Device& device_;
  LineInput input_;
  bool away_ = false;
  bool over_ = false;
};

}  // namespace

int run_shell(Device& device) {
  return Shell(device).run();
}

}  // namespace holdfast::console_tool
