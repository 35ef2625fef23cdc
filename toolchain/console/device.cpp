// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/device.hpp"

#include <poll.h>

#include <algorithm>
#include <array>
#include <charconv>

#include "drivers/common/trouble.hpp"

namespace holdfast::console_tool {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kLongestLine = 1U << 20U;  // of JSON; the longest of the device's has some 20 kB

std::string_view without_lead(std::string_view line) {
  const std::size_t begin = line.find_first_not_of(" \t");
  return begin == std::string_view::npos ? std::string_view{} : line.substr(begin);
}

std::string_view first_word(std::string_view line) {
  line = without_lead(line);
  return line.substr(0, line.find_first_of(" \t"));
}

}  // namespace

int Answer::number() const {
  if (kind != Kind::kError || !error.starts_with("ERR ")) return 0;
  int value = 0;
  (void)std::from_chars(error.data() + 4, error.data() + error.size(), value);
  return value;
}

bool says_nothing(std::string_view line) {
  const std::string_view text = without_lead(line);
  return text.empty() || text.front() == '#';
}

// Whatever a person or a program left there: a stream, half a line, a command that runs. Answers of theirs may still be
// on their way, also one to `version json`, so that ours is the one behind the complaint about a word that nobody else
// says. Said again, because a port that was opened a moment ago may lose what is sent first.
bool Device::attach(Millis deadline) {
  const Clock::time_point until = Clock::now() + deadline;
  attached_ = unlocked_ = out_of_step_ = false;
  text_.clear();
  for (int k = 0; k < 2; ++k) (void)frames_.push('\n');
  for (int tries = 4; tries > 0; --tries) {
    Answer answer;
    asked_ = &answer;
    answered_ = false;
    version_ = {};
    const std::string word = "anybody-" + std::to_string(Clock::now().time_since_epoch().count() % 1'000'000'000);
    complaint_ = "ERR 4 arguments: " + word;
    const auto left = std::chrono::ceil<Millis>(until - Clock::now()) / tries;
    const bool sent = left > Millis{0} && port_.write("\x03\recho off\rhelp " + word + "\rversion json\r");
    const bool came = sent && answer_in(left);
    asked_ = nullptr;
    complaint_.clear();
    if (!sent || signals_.ended()) return false;
    if (!came || !version_.starts_with("{\"firmware\":")) continue;
    attached_ = true;
    const Answer status = say("status json");
    unlocked_ =
        status.ok() && !status.lines.empty() && status.lines.back().find("\"unlocked\":true") != std::string::npos;
    lock_again_ = lock_again_ && unlocked_;  // asked anew in between: who unlocked it still locks it
    return true;
  }
  return false;
}

void Device::detach() {
  if (!attached_) return;
  attached_ = false;
  // Nobody waits for the answers.
  (void)port_.write(lock_again_ ? "\x03\rlock\recho on\r" : "\x03\recho on\r");
  unlocked_ = lock_again_ = false;
}

Answer Device::say(std::string_view line, const std::function<void(std::string_view)>& on_line) {
  std::string sent(line);
  std::ranges::replace(sent, '\t', ' ');
  Answer answer;
  if (std::ranges::any_of(sent, [](unsigned char c) { return c < 0x20 || c == 0x7F; })) {
    answer.kind = Answer::Kind::kError;
    answer.error = trouble("a line holds control characters, and was not sent",
                           "several lines in one, or a binary file", "send them one by one");
    return answer;
  }
  if (out_of_step_ && port_.is_open()) (void)attach(patience_);
  asked_ = &answer;
  on_line_ = on_line ? &on_line : nullptr;
  answered_ = false;
  const bool came = port_.write(sent + "\r") && answer_in(patience_);
  asked_ = nullptr;
  on_line_ = nullptr;
  if (!came) {
    const bool gone = !port_.is_open() || !listen();
    out_of_step_ = true;  // its answer may come yet, and is none to the next line
    answer.kind = gone ? Answer::Kind::kGone : Answer::Kind::kSilent;
    const std::string where = port_.path() + (gone ? " has gone" : " does not answer");
    answer.error = gone ? trouble(where, "unplugged, or the firmware ended", "plug it in again")
                        : trouble(where, "the firmware hangs, or another program reads the port",
                                  "try again; holdfast devices shows the port");
  }
  note_lock(sent, answer);
  return answer;
}

void Device::note_lock(std::string_view line, const Answer& answer) {
  const std::string_view word = first_word(line);
  if (word == "unlock" && answer.ok()) unlocked_ = lock_again_ = true;
  // 10 locked, 11 wrong_code: whoever gives a wrong code is locked out.
  const bool refused = answer.number() == 10 || answer.number() == 11;
  if ((word == "lock" && answer.ok()) || refused) unlocked_ = lock_again_ = false;
}

// Patience begins anew with every line: a long answer on a slow port is none that hangs.
bool Device::answer_in(Millis deadline) {
  Clock::time_point until = Clock::now() + deadline;
  std::uint64_t seen = letters_;
  while (!answered_) {
    const auto left = std::chrono::ceil<Millis>(until - Clock::now()).count();
    if (left <= 0) return false;
    std::array<pollfd, 2> ends{{{port_.fd(), POLLIN, 0}, {signals_.fd(), POLLIN, 0}}};
    if (::poll(ends.data(), ends.size(), static_cast<int>(left)) <= 0) continue;
    if (ends[1].revents != 0) {
      const Signals::What what = signals_.take();
      if (what == Signals::What::kInterrupt) {
        interrupted_ = true;
        (void)interrupt();
      }
      if (what == Signals::What::kEnd) return false;
    }
    if (ends[0].revents != 0 && !listen()) return false;
    if (letters_ != seen && complaint_.empty()) until = Clock::now() + deadline;
    seen = letters_;
  }
  return true;
}

bool Device::listen() {
  std::array<std::uint8_t, 4096> bytes;
  while (true) {
    const int count = port_.read(bytes);
    if (count < 0) return false;
    if (count == 0) return true;
    for (const std::uint8_t byte : std::span(bytes).first(static_cast<std::size_t>(count))) take(byte);
    if (static_cast<std::size_t>(count) < bytes.size()) return true;
  }
}

void Device::take(std::uint8_t byte) {
  switch (frames_.push(byte)) {
    case link::Event::kText:
      letters_ += frames_.text().size();
      for (const std::uint8_t letter : frames_.text()) {
        if (letter == '\n') {
          take_line();
        } else if (letter != 0 && text_.size() < kLongestLine) {
          text_ += static_cast<char>(letter);
        }
      }
      break;
    case link::Event::kFrame:
      if (const auto status = status_frame::read(frames_.payload()); status.ok()) {
        if (heard.status) heard.status(status.frame);
        break;
      }
      for (const link::Kind kind : {link::Kind::kRest, link::Kind::kDisplacement}) {
        const auto frame = marker_frame::read(kind, frames_.payload());
        if (frame && heard.markers) heard.markers(kind, *frame);
      }
      break;
    default:
      break;
  }
}

// Carriage returns, and what a device with echo on does to the screen, are no part of what is said.
void Device::take_line() {
  std::string line;
  std::swap(line, text_);
  while (!line.empty() && line.back() == '\r') line.pop_back();
  if (const std::size_t begin = line.rfind("\x1B[K"); begin != std::string::npos) line.erase(0, begin + 3);
  if (const std::size_t begin = line.rfind('\r'); begin != std::string::npos) line.erase(0, begin + 1);
  const bool own = line.starts_with("* ");
  if (own || asked_ == nullptr || answered_) {
    if (heard.line && !line.empty() && (own || attached_)) heard.line(line);
    return;
  }
  if (!complaint_.empty()) {
    if (line.starts_with(complaint_)) {
      complaint_.clear();
      wants_version_ = true;
    }
    return;
  }
  if (std::exchange(wants_version_, false)) {
    version_ = std::move(line);
    return;
  }
  if (line == "OK") {
    asked_->kind = Answer::Kind::kOk;
    answered_ = true;
  } else if (line.starts_with("ERR ")) {
    asked_->kind = Answer::Kind::kError;
    asked_->error = line;
    answered_ = true;
  } else if (on_line_ != nullptr) {
    (*on_line_)(line);
  } else {
    asked_->lines.push_back(std::move(line));
  }
}

}  // namespace holdfast::console_tool
