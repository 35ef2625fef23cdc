// SPDX-License-Identifier: Apache-2.0
// The prices of settings: what the settings are, what a table of prices says and refuses, and on one filmed grasp that
// the figures are those of the setting.
#include "toolchain/trade/table.hpp"

#include <algorithm>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "app/app.hpp"
#include "tests/support/folders.hpp"
#include "toolchain/trade/film.hpp"
#include "toolchain/trade/price.hpp"
#include "toolchain/trade/rival.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using trade::Line;
using trade::Point;

Line line(long index, std::vector<std::pair<std::size_t, double>> figures) {
  const Point point = trade::points()[static_cast<std::size_t>(index)];
  Line out;
  out.index = index;
  out.knob = point.knob;
  out.value = point.value;
  out.mode = point.mode;
  for (const auto& [i, value] : figures) out.figures[i] = value;
  return out;
}

// One line for each setting, no two alike.
std::vector<Line> whole() {
  std::vector<Line> lines;
  for (std::size_t i = 0; i < trade::points().size(); ++i) {
    const auto x = static_cast<double>(i);
    lines.push_back(line(static_cast<long>(i), {{trade::kUsP50, 1000.0 + x}, {trade::kRms, 0.01 + 0.001 * x}}));
  }
  return lines;
}

std::optional<std::string> read(const std::string& text, std::vector<Line>& lines) {
  std::istringstream in(text);
  return trade::read_csv(in, "t.csv", lines);
}

}  // namespace

TEST_GROUP(Trade){};

TEST(Trade, SettingsAreValidAndDifferFromModeFast) {
  const std::vector<Point> points = trade::points();
  std::set<std::pair<std::string, std::string>> names;
  for (const Point& point : points) {
    CHECK_TRUE(names.emplace(point.knob, point.value).second);
    CHECK_TRUE(validate(point.params).ok());
    CHECK_TRUE_TEXT(point.value.find(',') == std::string::npos, point.value.c_str());
  }
  for (std::size_t i = 0; i < kModes.size(); ++i) {
    CHECK_TRUE(points[i].mode == kModes[i].name);
    LONGS_EQUAL(i, points[i].params.mode);
  }
  CHECK_TRUE(points.front().params == Params{});
}

TEST(Trade, PiecesPutTogetherAreTheWhole) {
  const std::vector<Line> lines = whole();
  const std::string text = trade::csv(lines);
  std::vector<Line> pieces[3];
  for (std::size_t i = 0; i < lines.size(); ++i) pieces[i % 3].push_back(lines[i]);
  std::vector<Line> together;
  for (const int piece : {2, 0, 1}) CHECK_FALSE(read(trade::csv(pieces[piece]), together).has_value());
  CHECK_FALSE(trade::put_together(together).has_value());
  CHECK_TRUE(trade::csv(together) == text);
  // One behind the other in one file, as `cat` does it.
  together.clear();
  CHECK_FALSE(read(trade::csv(pieces[1]) + trade::csv(pieces[2]) + trade::csv(pieces[0]), together).has_value());
  CHECK_FALSE(trade::put_together(together).has_value());
  CHECK_TRUE(trade::csv(together) == text);

  std::vector<Line> bad = lines;
  bad.erase(bad.begin() + 4);
  STRCMP_CONTAINS("missing", trade::put_together(bad).value_or("").c_str());
  bad = lines;
  bad.push_back(lines[4]);
  STRCMP_CONTAINS("there twice", trade::put_together(bad).value_or("").c_str());
  bad = lines;
  bad.pop_back();
  STRCMP_CONTAINS("missing", trade::put_together(bad).value_or("").c_str());
  bad = lines;
  bad[3].value = "another";
  STRCMP_CONTAINS("another version", trade::put_together(bad).value_or("").c_str());
}

TEST(Trade, RefusesWhatIsNoTableOfPrices) {
  std::vector<Line> lines;
  STRCMP_CONTAINS("t.csv:1: no table", read("", lines).value_or("").c_str());
  STRCMP_CONTAINS("t.csv:1: no table", read("a,b\n", lines).value_or("").c_str());
  const std::string text = trade::csv(whole());
  STRCMP_CONTAINS("cells", read(text.substr(0, text.size() - 3), lines).value_or("").c_str());
  const std::string head = text.substr(0, text.find('\n') + 1);
  const std::string commas(trade::kFigures, ',');
  STRCMP_CONTAINS("t.csv:2: no index", read(head + "x,k,v," + commas + "\n", lines).value_or("").c_str());
  STRCMP_CONTAINS("'inf' is no number",
                  read(head + "0,k,v,,inf" + commas.substr(1) + "\n", lines).value_or("").c_str());
}

TEST(Trade, CountsGoToTheSettingsThatTheyAreOf) {
  const std::vector<Point> points = trade::points();
  const auto counted = [](const Point& point) { return point.tuning.picture_width == trade::kPictureWidth; };
  std::string counts;
  std::set<std::string> known;
  for (const Point& point : points) {
    const auto settings = trade::settings_of(point);
    CHECK_EQUAL(settings.has_value(), counted(point));
    if (!settings || !known.insert(*settings).second) continue;
    const bool rival = settings->starts_with("rival=");
    CHECK_EQUAL(rival, trade::find_rival(settings->substr(settings->find('=') + 1)).has_value());
    counts += *settings + "," + std::to_string(1000 + known.size()) + (rival ? ",\n" : ",77\n");
  }
  STRCMP_CONTAINS("mode=fast,1001,77\nmode=1,1002,77\n", counts.c_str());
  std::vector<Line> lines = whole();
  const auto put = [&](const std::string& text) {
    std::istringstream in(text);
    return trade::read_counts(in, "c.csv", lines).value_or("");
  };
  STRCMP_EQUAL("", put(counts).c_str());
  DOUBLES_EQUAL(1002.0, lines[1].figures[trade::kInstructionsX86].value_or(0.0), 0.0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    CHECK_EQUAL(lines[i].figures[trade::kInstructionsX86].has_value(), counted(points[i]));
    CHECK_EQUAL(lines[i].figures[trade::kInstructionsArm].has_value(),
                counted(points[i]) && points[i].tuning.rival == trade::Rival::kNone);
  }
  STRCMP_CONTAINS("no count of 'mode=1'", put("mode=fast,1,1\n").c_str());
  STRCMP_CONTAINS("c.csv:1: 2 cells", put("mode=fast,1\n").c_str());
  STRCMP_CONTAINS("c.csv:2: '-3' is no count", put("mode=fast,1,1\nmode=1,-3,1\n").c_str());
}

TEST(Trade, DominatedIsWhatNobodyShouldChoose) {
  using trade::kClipWithin5;
  using trade::kRms;
  using trade::kUsP50;
  const std::vector<Line> lines{
      line(0, {{kUsP50, 1000.0}, {kRms, 0.02}, {kClipWithin5, 80.0}}),
      line(1, {{kUsP50, 2000.0}, {kRms, 0.01}, {kClipWithin5, 80.0}}),
      line(2, {{kUsP50, 2100.0}, {kRms, 0.015}, {kClipWithin5, 80.0}}),  // worse than 1
      line(3, {{kUsP50, 1040.0}, {kRms, 0.02}, {kClipWithin5, 80.0}}),   // times tremble
      line(4, {{kUsP50, 3000.0}, {kRms, 0.03}, {kClipWithin5, 81.0}}),   // decides better
      line(5, {{kUsP50, 4000.0}, {kRms, 0.04}}),                         // nobody knows how it decides
  };
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[0], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[1], lines));
  POINTERS_EQUAL(&lines[1], trade::dominated_by(lines[2], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[3], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[4], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[5], lines));
}

// The whole way on one filmed grasp of the camera's size. Tolerances: half as much again as what was measured.
TEST(Trade, FiguresOfAFilmAreThoseOfTheSetting) {
  const std::vector<Point> points = trade::points();
  const auto find = [&](std::string_view knob, std::string_view value) {
    return *std::ranges::find_if(points, [&](const Point& p) { return p.knob == knob && p.value == value; });
  };
  std::vector<trade::Trialled> trialled;
  for (const Point& point : {points[0], find("jpeg_decoder", "libjpeg-turbo"),
                             find("others", "OpenCV 1/8 + Canny + SimpleBlob"), find("jpeg_threads", "2")}) {
    trialled.emplace_back(point);
  }
  trade::Film film = trade::shoot(0);
  film.shots.resize(60);
  for (std::size_t k = 0; k < film.shots.size(); ++k) {
    for (trade::Trialled& one : trialled) one.show(film, k);
  }
  const trade::Price fast = trialled[0].price();
  const trade::Price library = trialled[1].price();
  const trade::Price rival = trialled[2].price();
  LONGS_EQUAL(60, fast.seen->frames);
  LONGS_EQUAL(0, fast.seen->rejected);
  LONGS_EQUAL(0, fast.seen->missed);
  CHECK_TRUE(fast.seen->rms_px < 0.018);
  // The same samples from another decoder.
  DOUBLES_EQUAL(fast.seen->rms_px, library.seen->rms_px, 0.0);
  DOUBLES_EQUAL(fast.seen->entropy_error_nat.value_or(1.0), library.seen->entropy_error_nat.value_or(2.0), 0.0);
  CHECK_TRUE(rival.seen->rms_px > 1.3 * fast.seen->rms_px);
  CHECK_FALSE(rival.seen->entropy_error_nat.has_value());
  // What is lost of a picture is noticed.
  LONGS_EQUAL(10, fast.seen->damaged);
  LONGS_EQUAL(0, fast.seen->damaged_used);
  const trade::Price threads = trialled[3].price();
  DOUBLES_EQUAL(fast.seen->rms_px, threads.seen->rms_px, 0.0);
  LONGS_EQUAL(60, threads.seen->frames);
  CHECK_TRUE(threads.memory_bytes > fast.memory_bytes);
}

// The documented table of modes is the committed measurement, not somebody's typing.
TEST(Trade, DocumentShowsTheMeasuredModes) {
  std::ifstream csv(holdfast::test::source("toolchain/trade/trade.csv"));
  std::vector<Line> lines;
  CHECK_FALSE(trade::read_csv(csv, "trade.csv", lines).has_value());
  CHECK_FALSE(trade::put_together(lines).has_value());
  std::ifstream in(holdfast::test::source("toolchain/trade/README.md"));
  const std::string document{std::istreambuf_iterator<char>(in), {}};
  const std::string table = trade::modes_markdown(lines);
  CHECK_TRUE_TEXT(document.find(table) != std::string::npos,
                  ("toolchain/trade/README.md has not this table; put it there, or measure again:\n" + table).c_str());
}
