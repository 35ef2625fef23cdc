// SPDX-License-Identifier: Apache-2.0
#include "console/output.hpp"

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "console/page.hpp"
#include "drivers/sim/serial.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using console::Column;
using console::Output;
using console::Page;

TEST_GROUP(ConsoleOutput) {
  Output out;
  sim::Serial port;

  std::string said() {
    out.flush(port, Output::kBytes);
    const std::vector<std::uint8_t> bytes = port.output_bytes();
    port.clear_output();
    return {bytes.begin(), bytes.end()};
  }
  std::string decimal(std::int64_t value, std::int64_t denominator, int decimals) {
    out.decimal(value, denominator, decimals);
    return said();
  }
};

// Against printf, where a double holds the value exactly.
TEST(ConsoleOutput, WritesDecimalsAsPrintfDoes) {
  STRCMP_EQUAL("0.00", decimal(0, 256, 2).c_str());
  STRCMP_EQUAL("-0.5", decimal(-1, 2, 1).c_str());
  STRCMP_EQUAL("3", decimal(5, 2, 0).c_str());  // halves away from zero
  STRCMP_EQUAL("-1.500", decimal(-1500, 1000, 3).c_str());
  STRCMP_EQUAL("-9223372036854", decimal(-9223372036854, 1, 0).c_str());
  for (int value = -70'000; value < 70'000; value += 37) {
    char expected[32];
    std::snprintf(expected, sizeof expected, "%.3f", value / 65536.0);
    if (std::string(expected) == "-0.000") std::snprintf(expected, sizeof expected, "0.000");
    STRCMP_EQUAL(expected, decimal(value, 65536, 3).c_str());
  }
}

TEST(ConsoleOutput, EscapesWhatJsonDoesNotAllow) {
  out.escaped("a\"b\\c\n\x1F\x7F\xE9~");
  STRCMP_EQUAL("a\\\"b\\\\c\\u000a\\u001f\\u007f\\u00e9~", said().c_str());
}

TEST(ConsoleOutput, TakesAllOrNothing) {
  const std::string most(Output::kBytes - 3, 'x');
  CHECK(out.put(most));
  CHECK_FALSE(out.put("1234"));
  LONGS_EQUAL(1, out.lost());
  CHECK(out.put("123"));
  CHECK(out.put(""));
  LONGS_EQUAL(0, out.room());
  const std::vector<std::uint8_t> frame(10, 7);
  CHECK_FALSE(out.put_frame(frame));
  LONGS_EQUAL(2, out.lost());
  std::string expected = most;
  STRCMP_EQUAL((expected += "123").c_str(), said().c_str());
}

// A port that takes some: nothing is lost, repeated or in another order, also round the ring's end.
TEST(ConsoleOutput, HandsOverWhatThePortTakes) {
  std::string sent, came;
  for (int k = 0; k < 300; ++k) {
    std::string line = "line " + std::to_string(k) + "\r\n";
    if (out.put(line)) sent += line;
    port.set_full(k % 3 == 0);
    out.flush(port, 40);
    const std::vector<std::uint8_t> bytes = port.output_bytes();
    port.clear_output();
    CHECK(bytes.size() <= 40);
    came.append(bytes.begin(), bytes.end());
  }
  port.set_full(false);
  came += said();
  STRCMP_EQUAL(sent.c_str(), came.c_str());
  LONGS_EQUAL(0, out.size());
}

TEST(ConsoleOutput, KnowsWhereALineBegins) {
  CHECK(out.at_line_start());
  out.put("ab");
  LONGS_EQUAL(2, out.column());
  CHECK_FALSE(out.at_line_start());
  out.put("\r\n");
  CHECK(out.at_line_start());
  LONGS_EQUAL(0, out.column());
  const std::vector<std::uint8_t> frame{1, 2, 0};
  CHECK(out.put_frame(frame));
  CHECK(out.at_line_start());
  out.clear();
  LONGS_EQUAL(0, out.size());
}

TEST(ConsoleOutput, MakesLinesAndJsonOfOnePage) {
  Page page(out);
  constexpr std::array<Column, 3> kColumns{{{"name", 6}, {"n", 4}, {"x", 0}}};
  const auto write = [&](bool json) {
    page.open(json);
    page.text("title", "a \"b\"");
    page.integer("count", -3, "mm");
    page.decimal("half", 1, 2, 1);
    page.nothing("none");
    page.yes_no("well", true);
    page.yes_no("ill", false);
    page.part("left");
    page.integer("force", 3, "N");
    page.nothing("none");
    page.end_part();
    page.list("rows", kColumns);
    for (int k = 0; k < 2; ++k) {
      page.row();
      page.cell(k == 0 ? "long name" : "b");
      page.cell(k);
      if (k == 0) page.cell(5, 2, 2);
      if (k == 1) page.no_cell();
      page.end_row();
    }
    page.end_list();
    page.close();
  };
  write(true);
  STRCMP_EQUAL(
      "{\"title\":\"a \\\"b\\\"\",\"count\":-3,\"half\":0.5,\"none\":null,\"well\":true,\"ill\":false,"
      "\"left\":{\"force\":3,\"none\":null},\"rows\":["
      "{\"name\":\"long name\",\"n\":0,\"x\":2.50},{\"name\":\"b\",\"n\":1,\"x\":null}]}\r\n",
      said().c_str());
  write(false);
  STRCMP_EQUAL(
      "title                 a \"b\"\r\ncount                 -3 mm\r\nhalf                  0.5\r\n"
      "none                  -\r\nwell                  yes\r\nill                   no\r\n"
      "left                  force 3 N, none -\r\n"
      "name  n   x\r\nlong name 0 2.50\r\nb     1   -\r\n",
      said().c_str());
}

// Keys and cells that are wider than their columns, and columns that are wider than any.
TEST(ConsoleOutput, KeepsColumnsApartWhateverTheirWidth) {
  Page page(out);
  constexpr std::array<Column, 3> kColumns{{{"too long", 4}, {"b", 40}, {"c", 0}}};
  page.open(false);
  page.text("a key of more than twenty-two letters", "x");
  page.list("rows", kColumns);
  page.row();
  page.cell("v");
  page.cell("w");
  page.cell("z");
  page.end_row();
  page.end_list();
  page.close();
  STRCMP_EQUAL(("a key of more than twenty-two letters x\r\ntoo long b" + std::string(32, ' ') + "c\r\nv   w" +
                std::string(32, ' ') + "z\r\n")
                   .c_str(),
               said().c_str());
}
