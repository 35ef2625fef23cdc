// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/line_input.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cwchar>
#include <filesystem>

namespace holdfast::console_tool {
namespace {

constexpr int kHistory = 500;

std::size_t columns() {
  winsize size{};
  return ::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

void say(std::string_view text) {
  fmt::print("{}", text);
  (void)std::fflush(stdout);
}

}  // namespace

std::string history_path() {
  const auto variable = [](const char* name) {
    const char* const value = std::getenv(name);
    return std::string(value == nullptr ? "" : value);
  };
  std::string folder = variable("XDG_STATE_HOME");
  if (!folder.starts_with('/')) {
    folder = variable("HOME");
    if (!folder.starts_with('/')) return {};
    folder += "/.local/state";
  }
  return folder + "/holdfast/console_history";
}

LineInput::LineInput(Signals& signals, Beside beside)
    : signals_(signals), beside_(std::move(beside)), file_(history_path()) {
  editor_ = ::el_init("holdfast", stdin, stdout, stderr);
  history_ = ::history_init();
  if (editor_ == nullptr || history_ == nullptr) return;
  HistEvent event{};
  (void)::history(history_, &event, H_SETSIZE, kHistory);
  (void)::history(history_, &event, H_SETUNIQUE, 1);
  if (!file_.empty()) {
    std::error_code error;
    const std::filesystem::path folder = std::filesystem::path(file_).parent_path();
    if (std::filesystem::create_directories(folder, error)) (void)::chmod(folder.c_str(), S_IRWXU);
    (void)::history(history_, &event, H_LOAD, file_.c_str());
  }
  (void)::el_set(editor_, EL_CLIENTDATA, this);
  (void)::el_set(editor_, EL_EDITOR, "emacs");
  (void)::el_set(editor_, EL_SIGNAL, 0);
  (void)::el_set(editor_, EL_HIST, ::history, history_);
  (void)::el_set(
      editor_, EL_PROMPT, +[](EditLine* editor) { return of(editor).prompt_.data(); });
  (void)::el_set(
      editor_, EL_GETCFN, +[](EditLine* editor, wchar_t* letter) { return of(editor).next(*letter); });
  (void)::el_set(
      editor_, EL_ADDFN, "holdfast-complete", "words that the device knows",
      +[](EditLine* editor, int /*key*/) { return of(editor).complete_here(); });
  (void)::el_set(editor_, EL_BIND, "^I", "holdfast-complete", nullptr);
  (void)::el_set(editor_, EL_BIND, "^R", "em-inc-search-prev", nullptr);
  (void)::el_set(editor_, EL_BIND, "^W", "ed-delete-prev-word", nullptr);
  for (const char* const key : {"\x1B[1~", "\x1B[H", "\x1BOH"}) {
    (void)::el_set(editor_, EL_BIND, key, "ed-move-to-beg", nullptr);
  }
  for (const char* const key : {"\x1B[4~", "\x1B[F", "\x1BOF"}) {
    (void)::el_set(editor_, EL_BIND, key, "ed-move-to-end", nullptr);
  }
  (void)::el_set(editor_, EL_BIND, "\x1B[3~", "ed-delete-next-char", nullptr);
  // What is pasted while a command runs is not shown twice.
  (void)::el_set(editor_, EL_SETTY, "-x", "-echo", nullptr);
}

LineInput::~LineInput() {
  if (editor_ != nullptr) ::el_end(editor_);
  if (history_ != nullptr) ::history_end(history_);
}

LineInput& LineInput::of(EditLine* editor) {
  void* self = nullptr;
  (void)::el_get(editor, EL_CLIENTDATA, &self);
  return *static_cast<LineInput*>(self);
}

LineInput::Ready LineInput::wait_for_key() {
  while (true) {
    std::array<pollfd, 3> ends{{{STDIN_FILENO, POLLIN, 0}, {signals_.fd(), POLLIN, 0}, {beside_.fd(), POLLIN, 0}}};
    // A port that has gone is looked for anew now and then.
    constexpr int kNowAndThenMs = 250;
    const int ready = ::poll(ends.data(), ends.size(), kNowAndThenMs);
    if (ready < 0) continue;
    if (ends[1].revents != 0) {
      switch (signals_.take()) {
        case Signals::What::kInterrupt:
          return Ready::kInterrupt;
        case Signals::What::kEnd:
          return Ready::kEnd;
        case Signals::What::kResize:
          ::el_resize(editor_);
          break;
        default:
          break;
      }
    }
    if (ready == 0 || ends[2].revents != 0) beside_.ready();
    if ((ends[0].revents & POLLIN) != 0) return Ready::kKey;
    if (ends[0].revents != 0) return Ready::kEnd;  // the terminal has gone
  }
}

// Of letters of several bytes, all of them. 1: there is one; 0: the line ends here.
int LineInput::next(wchar_t& letter) {
  std::mbstate_t state{};
  while (true) {
    ended_by_ = wait_for_key();
    char byte = 0;
    if (ended_by_ != Ready::kKey || ::read(STDIN_FILENO, &byte, 1) != 1) {
      if (ended_by_ == Ready::kKey) ended_by_ = Ready::kEnd;
      return 0;
    }
    constexpr auto kMore = static_cast<std::size_t>(-2);
    const std::size_t used = std::mbrtowc(&letter, &byte, 1, &state);
    if (used == kMore) continue;
    if (used <= 1) return 1;
    state = {};  // no letter of this locale
  }
}

LineInput::Typed LineInput::read(std::string_view prompt) {
  if (editor_ == nullptr) return {};
  prompt_ = prompt;
  ended_by_ = Ready::kKey;
  reading_ = true;
  int count = 0;
  const char* const text = ::el_gets(editor_, &count);
  reading_ = false;
  if (ended_by_ == Ready::kInterrupt) {
    say("^C\n");
    return {Got::kInterrupt, {}};
  }
  if (text == nullptr || count <= 0 || ended_by_ == Ready::kEnd) {
    say("\n");
    return {};
  }
  std::string line(text, static_cast<std::size_t>(count));
  while (!line.empty() && (line.back() == '\n' || line.back() == '\r')) line.pop_back();
  remember(line);
  return {Got::kLine, std::move(line)};
}

void LineInput::remember(const std::string& line) {
  if (says_nothing(line) || line.find("unlock") != std::string::npos) return;
  HistEvent event{};
  (void)::history(history_, &event, H_ENTER, line.c_str());
  if (!file_.empty()) (void)::history(history_, &event, H_SAVE, file_.c_str());
}

LineInput::Typed LineInput::read_secret(std::string_view prompt) {
  termios before{};
  if (::tcgetattr(STDIN_FILENO, &before) != 0) return {};
  termios silent = before;
  silent.c_lflag &= ~static_cast<tcflag_t>(ECHO);
  silent.c_lflag |= ICANON | ISIG;
  silent.c_iflag |= ICRNL;
  (void)::tcsetattr(STDIN_FILENO, TCSADRAIN, &silent);
  say(prompt);
  Typed result;
  while (true) {
    const Ready ready = wait_for_key();
    char byte = 0;
    if (ready != Ready::kKey || ::read(STDIN_FILENO, &byte, 1) != 1) {
      result.got = ready == Ready::kInterrupt ? Got::kInterrupt : Got::kEnd;
      break;
    }
    if (byte == '\n' || byte == '\r') {
      result.got = Got::kLine;
      break;
    }
    result.line += byte;
  }
  (void)::tcsetattr(STDIN_FILENO, TCSADRAIN, &before);
  say("\n");
  return result;
}

void LineInput::set_prompt(std::string_view prompt) {
  if (!reading_ || prompt_.size() != prompt.size()) return;
  prompt_ = prompt;
  say("\r");
  (void)::el_set(editor_, EL_REFRESH);
}

// The rows that the line takes are painted over, and it is drawn anew below.
void LineInput::show(std::string_view text) {
  if (!reading_) return say(fmt::format("{}\n", text));
  const LineInfo* const info = ::el_line(editor_);
  const std::size_t at = prompt_.size() + static_cast<std::size_t>(info->cursor - info->buffer);
  const std::size_t rows = at / columns();
  say(fmt::format("\r{}\x1B[J{}\n", rows > 0 ? fmt::format("\x1B[{}A", rows) : "", text));
  (void)::el_set(editor_, EL_REFRESH);
}

unsigned char LineInput::complete_here() {
  const LineInfo* const info = ::el_line(editor_);
  const std::string_view before(info->buffer, static_cast<std::size_t>(info->cursor - info->buffer));
  const Completion completion = complete(vocabulary_, before);
  if (!completion.insert.empty()) {
    return ::el_insertstr(editor_, completion.insert.c_str()) == 0 ? CC_REFRESH : CC_ERROR;
  }
  if (completion.choices.empty()) return CC_ERROR;
  const std::size_t widest =
      std::ranges::max_element(completion.choices, {}, [](const std::string& s) { return s.size(); })->size() + 2;
  const std::size_t per_row = std::max<std::size_t>(1, columns() / widest);
  std::string table = "\n";
  for (std::size_t k = 0; k < completion.choices.size(); ++k) {
    const bool ends = (k + 1) % per_row == 0 || k + 1 == completion.choices.size();
    table += ends ? completion.choices[k] + "\n" : fmt::format("{:{}}", completion.choices[k], widest);
  }
  say(table);
  return CC_REDISPLAY;
}

}  // namespace holdfast::console_tool
