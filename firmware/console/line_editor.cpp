// SPDX-License-Identifier: Apache-2.0
#include "console/line_editor.hpp"

#include <algorithm>

namespace holdfast::console {
namespace {

constexpr std::uint8_t ctrl(char letter) {
  return static_cast<std::uint8_t>(letter - '@');
}
constexpr std::uint8_t kEscape = 0x1B, kDelete = 0x7F;

}  // namespace

void LineEditor::forget_line() {
  size_ = cursor_ = 0;
  back_ = 0;
  too_long_ = damaged_ = ended_ = false;
}

void LineEditor::prompt(std::string_view prompt, Output& out) {
  if (ended_) forget_line();
  prompt_ = prompt;
  redraw(out);
}

// From the left edge: prompt, as much of the line as fits around the cursor, nothing behind it, cursor in its place.
void LineEditor::redraw(Output& out) const {
  if (!echo_) return;
  const std::size_t fits = kColumns - prompt_.size();
  const std::size_t first = cursor_ >= fits ? cursor_ - fits + 1 : 0;
  const std::size_t shown = std::min(size_ - first, fits);
  out.put("\r");
  out.put(prompt_);
  out.put(std::string_view(text_.data() + first, shown));
  out.put("\x1B[K");
  if (const std::size_t back = first + shown - cursor_; back > 0) {
    out.put("\x1B[");
    out.integer(static_cast<std::int64_t>(back));
    out.put("D");
  }
}

LineEditor::Event LineEditor::push(std::uint8_t byte, Output& out) {
  if (ended_) forget_line();
  const bool second_half = after_cr_ && byte == '\n';
  after_cr_ = byte == '\r';
  if (second_half) return Event::kNone;
  if (byte == '\r' || byte == '\n') return end_line(out);
  if (escape_ != Escape::kNone && byte >= 0x20) {
    escape(byte, out);
    return Event::kNone;
  }
  escape_ = Escape::kNone;  // a key in the middle of another's bytes: those do not come any more
  if (byte < 0x20 || byte == kDelete) return control(byte, out);
  if (byte > kDelete) {
    damaged_ = true;
    return Event::kNone;
  }
  const char c = static_cast<char>(byte);
  insert(std::string_view(&c, 1), out);
  return Event::kNone;
}

LineEditor::Event LineEditor::end_line(Output& out) {
  escape_ = Escape::kNone;
  ended_ = true;
  back_ = 0;
  if (echo_) out.put("\r\n");
  if (too_long_) return Event::kTooLong;
  if (damaged_) return Event::kDamaged;
  return Event::kLine;
}

void LineEditor::insert(std::string_view text, Output& out) {
  for (const char c : text) {
    if (size_ == kMost) {
      too_long_ = true;
      return;
    }
    std::copy_backward(text_.begin() + cursor_, text_.begin() + size_, text_.begin() + size_ + 1);
    text_[cursor_++] = c;
    ++size_;
  }
  // One byte at the end of a short line is its own echo.
  if (text.size() == 1 && cursor_ == size_ && prompt_.size() + size_ < kColumns) {
    if (echo_) out.put(text);
  } else {
    redraw(out);
  }
}

void LineEditor::move_to(std::size_t cursor, Output& out) {
  if (cursor == cursor_) return;
  cursor_ = cursor;
  redraw(out);
}

void LineEditor::erase(std::size_t begin, std::size_t end, Output& out) {
  if (begin == end) return;
  std::copy(text_.begin() + end, text_.begin() + size_, text_.begin() + begin);
  size_ -= end - begin;
  cursor_ = begin;
  redraw(out);
}

LineEditor::Event LineEditor::control(std::uint8_t byte, Output& out) {
  switch (byte) {
    case ctrl('A'):
      move_to(0, out);
      break;
    case ctrl('C'):
      forget_line();
      if (echo_) out.put("^C\r\n");
      return Event::kInterrupt;
    case ctrl('E'):
      move_to(size_, out);
      break;
    case ctrl('H'):
    case kDelete:
      if (cursor_ > 0) erase(cursor_ - 1, cursor_, out);
      break;
    case ctrl('I'):
      return Event::kTab;
    case ctrl('K'):
      erase(cursor_, size_, out);
      break;
    case ctrl('L'):
      if (echo_) out.put("\x1B[2J\x1B[H");
      redraw(out);
      break;
    case ctrl('U'):
      erase(0, cursor_, out);
      break;
    case ctrl('W'): {
      std::size_t begin = cursor_;
      while (begin > 0 && text_[begin - 1] == ' ') --begin;
      while (begin > 0 && text_[begin - 1] != ' ') --begin;
      erase(begin, cursor_, out);
      break;
    }
    case kEscape:
      escape_ = Escape::kBegun;
      escape_digit_ = 0;
      break;
    default:  // no key of text
      damaged_ = true;
      break;
  }
  return Event::kNone;
}

// ESC [ A, ESC O H, ESC [ 3 ~ and their like. Those that mean nothing here are passed over up to their end.
void LineEditor::escape(std::uint8_t byte, Output& out) {
  if (escape_ == Escape::kBegun) {
    escape_ = byte == '[' || byte == 'O' ? Escape::kBracket : Escape::kNone;
    return;
  }
  if (byte >= '0' && byte <= '9') {
    escape_digit_ = byte;
    return;
  }
  if (byte < 0x40) return;  // parameters
  escape_ = Escape::kNone;
  if (byte != '~') return key(static_cast<char>(byte), out);
  switch (escape_digit_) {
    case '1':
    case '7':
      return key('H', out);
    case '4':
    case '8':
      return key('F', out);
    case '3':
      if (cursor_ < size_) erase(cursor_, cursor_ + 1, out);
      return;
    default:
      return;
  }
}

void LineEditor::key(char final, Output& out) {
  switch (final) {
    case 'A':
      return recall(back_ + 1, out);
    case 'B':
      if (back_ > 0) recall(back_ - 1, out);
      return;
    case 'C':
      return move_to(std::min(cursor_ + 1, size_), out);
    case 'D':
      return move_to(cursor_ > 0 ? cursor_ - 1 : 0, out);
    case 'F':
      return move_to(size_, out);
    case 'H':
      return move_to(0, out);
    default:
      return;
  }
}

void LineEditor::remember_line() {
  if (size_ == 0) return;
  const Past& last = past_[(past_at_ + kHistory - 1) % kHistory];
  if (past_count_ > 0 && std::string_view(last.text.data(), last.size) == line()) return;
  Past& slot = past_[past_at_];
  slot.text = text_;
  slot.size = size_;
  past_at_ = (past_at_ + 1) % kHistory;
  if (past_count_ < kHistory) ++past_count_;
}

void LineEditor::recall(std::size_t back, Output& out) {
  if (back > past_count_) return;
  back_ = back;
  size_ = 0;
  too_long_ = damaged_ = false;
  if (back > 0) {
    const Past& past = past_[(past_at_ + kHistory - back) % kHistory];
    text_ = past.text;
    size_ = past.size;
  }
  cursor_ = size_;
  redraw(out);
}

}  // namespace holdfast::console
