// SPDX-License-Identifier: Apache-2.0
// The prices of settings: what the settings are, what a table of prices says and refuses, and on one filmed grasp that
// the figures are those of the setting.
#include "toolchain/trade/table.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "app/app.hpp"
#include "base/math.hpp"
#include "toolchain/trade/film.hpp"
#include "toolchain/trade/learned.hpp"
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

TEST(Trade, CoarserCentresAndFewerMarkersAreWhatTheyAreCalled) {
  MarkerField field;
  field.grid = {7, 9};
  for (std::int32_t i = 0; i < 63; ++i) {
    field.markers[idx(i)] = {PixelsQ8::from_raw(1000 * i + 129), PixelsQ8::from_raw(-i), i != 2};
  }
  trade::Tuning tuning;
  tuning.centre_bits = 0;
  const MarkerField whole_px = trade::coarsened(field, tuning);
  LONGS_EQUAL(256, whole_px.markers[0].x.raw());        // 0.504 px
  LONGS_EQUAL(-256 * 0, whole_px.markers[62].y.raw());  // -0.24 px
  CHECK_FALSE(whole_px.markers[2].valid);
  tuning = {};
  tuning.marker_every = 2;
  const MarkerField fewer = trade::coarsened(field, tuning);
  LONGS_EQUAL(4, fewer.grid.rows);
  LONGS_EQUAL(5, fewer.grid.cols);
  LONGS_EQUAL(field.markers[62].x.raw(), fewer.markers[19].x.raw());
  LONGS_EQUAL(field.markers[18].x.raw(), fewer.markers[5].x.raw());
  CHECK_FALSE(fewer.markers[1].valid);
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
  const auto counted = [](const Point& point) {
    return !point.needs_markers() && point.tuning.picture_width == trade::kPictureWidth;
  };
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
  using trade::kGraspBalanced;
  using trade::kRms;
  using trade::kUsP50;
  const std::vector<Line> lines{
      line(0, {{kUsP50, 1000.0}, {kRms, 0.02}, {kGraspBalanced, 80.0}}),
      line(1, {{kUsP50, 2000.0}, {kRms, 0.01}, {kGraspBalanced, 80.0}}),
      line(2, {{kUsP50, 2100.0}, {kRms, 0.015}, {kGraspBalanced, 80.0}}),  // worse than 1
      line(3, {{kUsP50, 1040.0}, {kRms, 0.02}, {kGraspBalanced, 80.0}}),   // times tremble
      line(4, {{kUsP50, 3000.0}, {kRms, 0.03}, {kGraspBalanced, 81.0}}),   // decides better
      line(5, {{kUsP50, 4000.0}, {kRms, 0.04}}),                           // nobody knows how it decides
  };
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[0], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[1], lines));
  POINTERS_EQUAL(&lines[1], trade::dominated_by(lines[2], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[3], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[4], lines));
  POINTERS_EQUAL(nullptr, trade::dominated_by(lines[5], lines));
  CHECK_TRUE(trade::on_front(lines[0], lines, kUsP50, kRms));
  CHECK_TRUE(trade::on_front(lines[1], lines, kUsP50, kRms));
  CHECK_FALSE(trade::on_front(lines[4], lines, kUsP50, kRms));
  CHECK_FALSE(trade::on_front(lines[5], lines, kUsP50, kGraspBalanced));
}

// The whole way on one filmed grasp of the camera's size. Tolerances: half as much again as what was measured.
TEST(Trade, FiguresOfAFilmAreThoseOfTheSetting) {
  const std::vector<Point> points = trade::points();
  const auto find = [&](std::string_view knob, std::string_view value) {
    return *std::ranges::find_if(points, [&](const Point& p) { return p.knob == knob && p.value == value; });
  };
  std::vector<trade::Trialled> trialled;
  for (const Point& point :
       {points[0], find("jpeg_decoder", "libjpeg-turbo"), find("others", "OpenCV 1/8 + Canny + SimpleBlob"),
        find("centres", "Q4"), find("jpeg_threads", "2")}) {
    trialled.emplace_back(point, trade::Lessons(0));
  }
  trade::Film film = trade::shoot(0);
  LONGS_EQUAL(film.shots.size(), film.labels.size());
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
  CHECK_FALSE(trialled[3].price().seen.has_value());  // pictures cannot show it
  const trade::Price threads = trialled[4].price();
  DOUBLES_EQUAL(fast.seen->rms_px, threads.seen->rms_px, 0.0);
  LONGS_EQUAL(60, threads.seen->frames);
  CHECK_TRUE(threads.memory_bytes > fast.memory_bytes);
}

TEST(Trade, FiguresOfAGraspAreThoseOfTheSetting) {
  const std::vector<Point> points = trade::points();
  std::vector<trade::Price> prices;
  const trade::Grasp grasp = trade::play(trade::planned_grasps(16).front());
  for (const Point& point : points) {
    if (point.knob != "mode" && point.knob != "centres") continue;
    trade::Trialled one(point, trade::Lessons(0));
    one.show(grasp);
    prices.push_back(one.price());
  }
  const trade::Price& fast = prices.front();
  const trade::Price& coarse = prices[prices.size() - 2];  // Q2
  CHECK_TRUE(fast.grasped->frames.count() > 50);
  CHECK_TRUE(fast.grasped_entropy_error_nat < 0.01);
  CHECK_TRUE(coarse.grasped_entropy_error_nat > fast.grasped_entropy_error_nat);
}

// The rival in double precision is no straw man: what it sees is what the firmware sees.
TEST(Trade, DoublePrecisionSeesWhatTheFirmwareSees) {
  const trade::Grasp grasp = trade::play(trade::planned_grasps(16).front());
  trade::DoubleFeatures features{learn::kPaperForm};
  const pipeline::Config config = pipeline_config(Params{});
  const auto state = std::make_unique<pipeline::State>();
  int seen = 0, elsewhere = 0;
  for (std::size_t k = 0; k < grasp.sights.size(); ++k) {
    const trade::Sight& sight = grasp.sights[k];
    const auto values = features.update(sight.markers, sight.time);
    const pipeline::Result result =
        pipeline::update_markers(*state, config, sight.markers, sight.time, static_cast<std::uint32_t>(k));
    if (!values || !result.referenced || !result.features.rates_valid) continue;
    ++seen;
    // The firmware rounds displacements to 1 um: 0.5 um and as much before, over 40 ms, in every marker at worst.
    DOUBLES_EQUAL((*values)[0], result.features.vx.raw(), 25.0);
    DOUBLES_EQUAL((*values)[1], result.features.vy.raw(), 25.0);
    // A marker within that of an edge may be told to either side.
    elsewhere += std::abs(double{(*values)[2]} - result.features.entropy.raw() / 65536.0) > 1e-4 ? 1 : 0;
  }
  CHECK_TRUE(seen > 100);
  CHECK_TRUE_TEXT(elsewhere * 5 < seen, std::to_string(elsewhere).c_str());
}

TEST(Trade, SoftBinsDoNotJumpAtAnEdge) {
  const auto entropy_at = [](const learn::EntropyForm& form, double moved_um) {
    trade::DoubleFeatures features{form};
    MarkerField field;
    field.grid = {7, 9};
    const auto put = [&](double um) {
      for (std::int32_t i = 0; i < 63; ++i) {
        // Half of them 40 um behind, so that there is an entropy to lose.
        const double px = 41.0 * (i % 9 + 1) + (um > 0.0 ? um - (i % 2) * 40.0 : 0.0) * 41.0 / 2020.0;
        field.markers[idx(i)] = {.x = PixelsQ8::from_raw(static_cast<std::int32_t>(std::lround(px * 256.0))),
                                 .y = PixelsQ8::from_raw(41 * 256 * (i / 9 + 1)),
                                 .valid = true};
      }
    };
    put(0.0);
    Micros now{0};
    while (!features.update(field, now += Micros{40'000})) {
    }
    put(moved_um);
    return double{features.update(field, now += Micros{40'000}).value()[2]};
  };
  const double edge_um = 1900.0 / 15 * 5;
  CHECK_TRUE(entropy_at({.bins = learn::Bins::kHard}, edge_um + 3.0) -
                 entropy_at({.bins = learn::Bins::kHard}, edge_um - 3.0) >
             0.6);
  DOUBLES_EQUAL(entropy_at({.bins = learn::Bins::kSoft}, edge_um - 3.0),
                entropy_at({.bins = learn::Bins::kSoft}, edge_um + 3.0), 0.1);
}

TEST(Trade, TreesLearnFromTheLessons) {
  const trade::Lessons lessons(16);
  const model::Tree field = lessons.tree("field", 8);
  CHECK_TRUE(field.count > 1);
  CHECK_TRUE(field.set == find_feature_set("field"));
  CHECK_TRUE(lessons.tree("field", 2).count < field.count);
  const auto desk = lessons.desk_tree(learn::kPaperForm);
  CHECK_FALSE(desk->slips({0.0F, 0.0F, 0.0F, 0.0F}));
}

// The documented table of modes is the committed measurement, not somebody's typing.
TEST(Trade, DocumentShowsTheMeasuredModes) {
  std::ifstream csv(HOLDFAST_SOURCE_DIR "/toolchain/trade/trade.csv");
  std::vector<Line> lines;
  CHECK_FALSE(trade::read_csv(csv, "trade.csv", lines).has_value());
  CHECK_FALSE(trade::put_together(lines).has_value());
  std::ifstream in(HOLDFAST_SOURCE_DIR "/toolchain/trade/README.md");
  const std::string document{std::istreambuf_iterator<char>(in), {}};
  const std::string table = trade::modes_markdown(lines);
  CHECK_TRUE_TEXT(document.find(table) != std::string::npos,
                  ("toolchain/trade/README.md has not this table; put it there, or measure again:\n" + table).c_str());
}
