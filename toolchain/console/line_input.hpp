// SPDX-License-Identifier: Apache-2.0
// A line from a person at a terminal, by libedit, while other things go on beside it.
//
// The history is kept in a file of the XDG state folder, for its owner alone; never lines with `unlock` in them, which
// hold a secret.
#pragma once

#include <histedit.h>

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "toolchain/console/signals.hpp"
#include "toolchain/console/vocabulary.hpp"

namespace holdfast::console_tool {

// Where the history is kept; empty: nowhere, because this user has no home.
[[nodiscard]] std::string history_path();

class LineInput {
 public:
  enum class Got : std::uint8_t { kLine, kInterrupt, kEnd };
  struct Typed {
    Got got = Got::kEnd;
    std::string line;
  };

  // `beside`: a descriptor to wait for as well (-1: none), asked anew each time, and what to do when it is ready.
  struct Beside {
    std::function<int()> fd;
    std::function<void()> ready;
  };

  LineInput(Signals& signals, Beside beside);
  ~LineInput();
  LineInput(const LineInput&) = delete;
  LineInput& operator=(const LineInput&) = delete;

  void set_vocabulary(Vocabulary vocabulary) { vocabulary_ = std::move(vocabulary); }

  // Ctrl-C gives kInterrupt, Ctrl-D on an empty line kEnd.
  [[nodiscard]] Typed read(std::string_view prompt);
  // Without echo and history.
  [[nodiscard]] Typed read_secret(std::string_view prompt);
  // Of the line that is being typed, too.
  void set_prompt(std::string_view prompt);
  // A line that came by itself: above the one that is being typed, if one is.
  void show(std::string_view text);

 private:
  enum class Ready : std::uint8_t { kKey, kInterrupt, kEnd };
  [[nodiscard]] Ready wait_for_key();
  [[nodiscard]] int next(wchar_t& letter);
  [[nodiscard]] unsigned char complete_here();
  void remember(const std::string& line);
  [[nodiscard]] static LineInput& of(EditLine* editor);

  Signals& signals_;
  Beside beside_;
  Vocabulary vocabulary_;
  EditLine* editor_ = nullptr;
  History* history_ = nullptr;
  std::string file_;
  std::string prompt_;
  bool reading_ = false;
  Ready ended_by_ = Ready::kKey;
};

}  // namespace holdfast::console_tool
