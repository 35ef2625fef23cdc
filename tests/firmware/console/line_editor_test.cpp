// SPDX-License-Identifier: Apache-2.0
// The editor against two others: a string with a cursor, which says what the line is, and a row of a VT100 terminal,
// which says what somebody sees.
#include "console/line_editor.hpp"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/serial.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using console::LineEditor;
using console::Output;

namespace {

constexpr std::string_view kPrompt = "> ";
constexpr std::string_view kUp = "\x1B[A", kDown = "\x1B[B", kRight = "\x1B[C", kLeft = "\x1B[D";

// One row of a terminal: what the editor's bytes make of it.
struct Row {
  std::string text;
  std::size_t cursor = 0;
  std::size_t widest = 0;

  void take(std::string_view bytes) {
    for (std::size_t k = 0; k < bytes.size(); ++k) {
      const char c = bytes[k];
      if (c == '\r') {
        cursor = 0;
      } else if (c == '\n') {
        text.clear();
      } else if (c == '\x1B') {
        std::size_t end = k + 2;
        while (end < bytes.size() && static_cast<unsigned char>(bytes[end]) < 0x40) ++end;
        const std::size_t number = end > k + 2 ? std::stoul(std::string(bytes.substr(k + 2, end - k - 2))) : 1;
        if (bytes[end] == 'K') text.resize(cursor);
        if (bytes[end] == 'D') cursor -= number;
        if (bytes[end] == 'J') text.clear();
        if (bytes[end] == 'H') cursor = 0;
        k = end;
      } else {
        if (text.size() < cursor + 1) text.resize(cursor + 1, ' ');
        text[cursor++] = c;
        widest = std::max(widest, cursor);
      }
    }
  }
};

}  // namespace

TEST_GROUP(LineEditor) {
  Output out;
  LineEditor editor;
  sim::Serial port;
  Row row;
  std::vector<LineEditor::Event> events;
  std::string line;  // of the last kLine

  void setup() override {
    editor.prompt(kPrompt, out);
    show();
  }
  void show() {
    out.flush(port, Output::kBytes);
    const std::vector<std::uint8_t> bytes = port.output_bytes();
    port.clear_output();
    row.take({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }
  void press(std::string_view keys) {
    for (const char c : keys) {
      const LineEditor::Event event = editor.push(static_cast<std::uint8_t>(c), out);
      if (event != LineEditor::Event::kNone) events.push_back(event);
      if (event == LineEditor::Event::kLine) line = std::string(editor.line());
      show();
    }
  }
  void check_line(const char* expected, std::size_t cursor) {
    STRCMP_EQUAL(expected, std::string(editor.line()).c_str());
    LONGS_EQUAL(cursor, editor.cursor());
    std::string seen(kPrompt);
    STRCMP_EQUAL((seen += expected).c_str(), row.text.c_str());
    LONGS_EQUAL(kPrompt.size() + cursor, row.cursor);
  }
  // Ends the line and keeps it.
  void enter() {
    press("\r");
    editor.remember_line();
    editor.prompt(kPrompt, out);
    show();
  }
};

TEST(LineEditor, EndsALineByCrLfOrBothOnce) {
  press("one\rtwo\nthree\r\n\r\n");
  LONGS_EQUAL(4, events.size());
  for (const LineEditor::Event event : events) CHECK(event == LineEditor::Event::kLine);
  STRCMP_EQUAL("", line.c_str());
  press("four\n\n");
  LONGS_EQUAL(6, events.size());
}

TEST(LineEditor, MovesAndErases) {
  press("hello world");
  check_line("hello world", 11);
  press("\x01");
  check_line("hello world", 0);
  press("\x1B[C\x1B[C");
  check_line("hello world", 2);
  press("\x7F");
  check_line("hllo world", 1);
  press("e");
  check_line("hello world", 2);
  press("\x1B[3~");
  check_line("helo world", 2);
  press("\x05\x17");
  check_line("helo ", 5);
  press("there  \x17");
  check_line("helo ", 5);
  press("\x1BOH\x1B[D\x0B");
  check_line("", 0);
  press("abc\x1B[1~x\x1B[4~y\x1B[7~1\x1B[8~2");
  check_line("1xabcy2", 7);
  press("\x1B[D\x1B[D\x15");
  check_line("y2", 0);
  press("\x1B[F\x1B[C\x08\x08\x08");
  check_line("", 0);
  press("\x1B[3~\x17\x1B[H");
  check_line("", 0);
}

TEST(LineEditor, ClearsTheScreenAndKeepsTheLine) {
  press("get");
  press("\x0C");
  check_line("get", 3);
}

TEST(LineEditor, PassesOverKeysThatItDoesNotKnow) {
  press("a\x1B[5~\x1B[ q\x1B[1;5C\x1BOP\x1B[Z\x1Bxb");
  check_line("ab", 2);
  press("\r");
  CHECK(events.back() == LineEditor::Event::kLine);
}

// What is left of a cut sequence does not swallow the key behind it.
TEST(LineEditor, HearsCtrlCInTheMiddleOfASequence) {
  press("abc\x1B[\x03");
  CHECK(events.back() == LineEditor::Event::kInterrupt);
  press("\x1B[1\x1B[Dx\r");
  STRCMP_EQUAL("x", line.c_str());
}

TEST(LineEditor, RefusesBytesThatNoKeyOfTextMakes) {
  press(
      "a\x02"
      "b\r");
  CHECK(events.back() == LineEditor::Event::kDamaged);
  press("caf\xC3\xA9\r");
  CHECK(events.back() == LineEditor::Event::kDamaged);
  press("cafe\r");
  CHECK(events.back() == LineEditor::Event::kLine);
}

TEST(LineEditor, TellsOfTabAndInterrupt) {
  press("st\t");
  CHECK(events.back() == LineEditor::Event::kTab);
  check_line("st", 2);
  editor.insert("atus ", out);
  show();
  check_line("status ", 7);
  press("\x03");
  CHECK(events.back() == LineEditor::Event::kInterrupt);
  STRCMP_EQUAL("", std::string(editor.line()).c_str());
}

TEST(LineEditor, RemembersSixteenLines) {
  for (int k = 0; k < 18; ++k) {
    press("line " + std::to_string(k));
    enter();
  }
  press("line 17");  // the same again takes no place
  enter();
  press("\r");  // nor does an empty one
  editor.remember_line();
  press("new");
  press(kUp);
  check_line("line 17", 7);
  for (int k = 0; k < 20; ++k) press(kUp);
  check_line("line 2", 6);
  press(kDown);
  check_line("line 3", 6);
  press("!\r");
  STRCMP_EQUAL("line 3!", line.c_str());
  editor.prompt(kPrompt, out);
  press(kDown);  // there is nothing newer
  check_line("", 0);
  press(kUp);
  press(kDown);
  check_line("", 0);
}

TEST(LineEditor, TakesTheLongestLineAndNoLongerOne) {
  const std::string longest(LineEditor::kMost, 'x');
  press(longest);
  press("\r");
  CHECK(events.back() == LineEditor::Event::kLine);
  STRCMP_EQUAL(longest.c_str(), line.c_str());
  press(longest + "y\r");
  CHECK(events.back() == LineEditor::Event::kTooLong);
  // A megabyte is no more than that.
  for (int k = 0; k < 4096; ++k) press(longest);
  press("\r");
  CHECK(events.back() == LineEditor::Event::kTooLong);
  press("ok\r");
  CHECK(events.back() == LineEditor::Event::kLine);
  STRCMP_EQUAL("ok", line.c_str());
}

TEST(LineEditor, ScrollsALongLineSideways) {
  std::string text;
  for (int k = 0; k < 100; ++k) text += static_cast<char>('a' + k % 26);
  press(text);
  LONGS_EQUAL(LineEditor::kColumns - 1, row.cursor);
  STRCMP_CONTAINS(text.substr(text.size() - 20).c_str(), row.text.c_str());
  press("\x01");
  STRCMP_CONTAINS(text.substr(0, 70).c_str(), row.text.c_str());
  LONGS_EQUAL(kPrompt.size(), row.cursor);
  CHECK(row.widest <= LineEditor::kColumns);
}

TEST(LineEditor, IsSilentWithoutEcho) {
  editor.set_echo(false);
  CHECK_FALSE(editor.echo());
  row = {};
  press(
      "a\x01"
      "b\x0C\x03"
      "status\r");
  STRCMP_EQUAL("", row.text.c_str());
  STRCMP_EQUAL("status", line.c_str());
}

// Any keys: line and screen are those of the string with a cursor.
TEST(LineEditor, IsTheStringWithACursorWhateverIsPressed) {
  std::uint32_t random = 7;
  const auto draw = [&](std::uint32_t below) {
    random = random * 1664525 + 1013904223;
    return (random >> 8) % below;
  };
  std::string model;
  std::size_t cursor = 0;
  for (int k = 0; k < 20'000; ++k) {
    switch (draw(9)) {
      case 0:
        press(kLeft);
        if (cursor > 0) --cursor;
        break;
      case 1:
        press(kRight);
        if (cursor < model.size()) ++cursor;
        break;
      case 2:
        press("\x7F");
        if (cursor > 0) model.erase(--cursor, 1);
        break;
      case 3:
        if (draw(8) != 0) break;
        press("\x17");
        while (cursor > 0 && model[cursor - 1] == ' ') model.erase(--cursor, 1);
        while (cursor > 0 && model[cursor - 1] != ' ') model.erase(--cursor, 1);
        break;
      case 4:
        if (draw(20) != 0) break;
        press("\x0B");
        model.erase(cursor);
        break;
      default: {
        if (model.size() >= 70) break;
        const char c = draw(5) == 0 ? ' ' : static_cast<char>('a' + draw(26));
        press(std::string(1, c));
        model.insert(cursor++, 1, c);
        break;
      }
    }
    check_line(model.c_str(), cursor);
  }
}
