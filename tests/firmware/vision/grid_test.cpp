// SPDX-License-Identifier: Apache-2.0
// Registration on rendered pictures of known truth: detector and lattice together, as the tracker uses them.
//
// "Named right" means: every valid marker lies within 0.35 px (times the detector's reduction) of the dot that was
// printed under that name, so a shift by one row is 90 times the tolerance. A missing dot must be invalid.
#include "vision/grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using reference_model::Grid;
using reference_model::Picture;
using reference_model::Point;

namespace {

constexpr GridSize kGrid{7, 9};

double px(PixelsQ8 q) {
  return q.raw() / 256.0;
}

GridSize size_of(const Grid& grid) {
  return {static_cast<std::uint8_t>(grid.rows), static_cast<std::uint8_t>(grid.cols)};
}

void reason_is(Reason want, Status got) {
  LONGS_EQUAL(static_cast<int>(want), static_cast<int>(got.reason));
}

// Room around the grid, as in the raw camera picture (the grid fills 70 %).
scene::PictureConfig wide_view(int width = 320) {
  scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
  config.px_per_mm *= 0.7;
  config.edge_softness_px = std::max(0.5, config.edge_softness_px * 0.7);
  return config;
}

}  // namespace

TEST_GROUP(Grid) {
  std::unique_ptr<dots::State> dots_state = std::make_unique<dots::State>();
  std::unique_ptr<grid::State> state = std::make_unique<grid::State>();
  dots::Dots found;
  grid::Lattice lattice;
  int step = 1;
  std::mt19937 random{60};

  Status look(const Picture& picture, GridSize size = kGrid, bool auto_size = false,
              const MarkerField* prior = nullptr) {
    step = std::max((picture.width + 511) / 512, (picture.height + 399) / 400);
    grid::Config config;
    config.size = size;
    config.auto_size = auto_size;
    if (const Status s = dots::detect(*dots_state, {}, picture.view(), found); !s.ok()) return s;
    return grid::register_dots(*state, config, found, prior, lattice);
  }

  // Every marker whose dot was printed is valid and right; the others are invalid and predicted within
  // `predicted_within_px`.
  void named_right(const std::vector<Point>& truth, const std::set<std::size_t>& missing, const std::string& what,
                   double predicted_within_px = 1e9) {
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const Marker& m = lattice.field.markers[i];
      const double off = reference_model::distance(truth[i], {px(m.x), px(m.y)});
      const SimpleString text = StringFromFormat("%s: marker %d, off %.2f px, valid %d", what.c_str(),
                                                 static_cast<int>(i), off, m.valid ? 1 : 0);
      if (missing.contains(i)) {
        CHECK_TRUE_TEXT(!m.valid && off <= predicted_within_px, text.asCharString());
      } else {
        CHECK_TRUE_TEXT(m.valid && off <= 0.35 * step, text.asCharString());
      }
    }
  }

  static Picture without(const scene::PictureConfig& config, const std::vector<Point>& truth,
                         const std::set<std::size_t>& missing) {
    std::vector<Point> left;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (!missing.contains(i)) left.push_back(truth[i]);
    }
    return reference_model::picture_of(config, left, 4);
  }

  // The dots of a picture that is taken for the lattice in it.
  std::vector<Point> registered(const scene::PictureConfig& config, const reference_model::Warp& warp = {}) {
    std::vector<Point> truth = reference_model::lattice_px({}, config, warp);
    reason_is(Reason::kNone, look(reference_model::picture_of(config, truth, 5)));
    return truth;
  }

  static std::set<std::size_t> column(std::size_t col) {
    std::set<std::size_t> out;
    for (std::size_t row = 0; row < 7; ++row) out.insert(9 * row + col);
    return out;
  }
  static std::set<std::size_t> row_of(std::size_t row) {
    std::set<std::size_t> out;
    for (std::size_t col = 0; col < 9; ++col) out.insert(9 * row + col);
    return out;
  }

  static void blot(Picture & picture, Point centre, double radius_px) {
    reference_model::draw_disc(picture, centre, radius_px, 45);
  }
};

// The smallest picture that works is 80x60 when it is cropped to the grid (pitch 8 px, dots 4.1 px), see the last test
// for what happens below. 1640x1232 is the largest working image.
TEST(Grid, NamesTheMarkersAtEveryScale) {
  for (const int width : {80, 96, 112, 128, 160, 200, 256, 300, 320, 410, 500, 512, 513, 640, 820, 1024, 1280, 1640}) {
    const scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
    const auto truth = registered(config, reference_model::shifted(0.1, 0.05));
    named_right(truth, {}, "columns " + std::to_string(width));
    DOUBLES_EQUAL(2.02 * config.px_per_mm, px(lattice.pitch), 0.02 * 2.02 * config.px_per_mm);
    CHECK_TRUE(lattice.found == kGrid);
    LONGS_EQUAL(0, lattice.strays);
  }
}

TEST(Grid, NamesTheMarkersInTheUncroppedView) {
  for (const int width : {128, 205, 320, 410, 820, 1640}) {
    const scene::PictureConfig config = wide_view(width);
    const auto truth = registered(config);
    named_right(truth, {}, "columns " + std::to_string(width));
  }
}

TEST(Grid, NamesTheMarkersAtEveryAngleUpTo35Degrees) {
  for (int degrees = -35; degrees <= 35; ++degrees) {
    const scene::PictureConfig config = wide_view();
    const auto truth = registered(config, reference_model::rotated(degrees));
    named_right(truth, {}, "degrees " + std::to_string(degrees));
  }
}

TEST(Grid, NamesEveryPrintedLatticeGivenOrFound) {
  for (const Grid& printed : {Grid{7, 9, 2.02}, Grid{8, 10, 1.8}, Grid{7, 10, 1.9}, Grid{3, 3, 2.02}, Grid{8, 16, 1.15},
                              Grid{16, 8, 0.85}, Grid{10, 8, 1.45}, Grid{3, 16, 1.15}, Grid{4, 4, 2.02}}) {
    for (const bool auto_size : {false, true}) {
      scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), 640);
      config.dot_diameter_mm = printed.pitch_mm * 0.52;
      const auto truth = reference_model::lattice_px(printed, config);
      reason_is(Reason::kNone, look(reference_model::picture_of(config, truth, 5), size_of(printed), auto_size));
      CHECK_TRUE(lattice.field.grid == size_of(printed));
      named_right(truth, {}, std::to_string(printed.rows) + "x" + std::to_string(printed.cols));
    }
  }
}

TEST(Grid, FollowsShearTwistAndBulge) {
  using namespace reference_model;
  const std::vector<std::pair<std::string, Warp>> warps{
      {"shear x", sheared(0.2, 0.0)},
      {"shear -x", sheared(-0.2, 0.0)},
      {"shear y", sheared(0.0, 0.2)},
      {"shear both", sheared(0.15, -0.15)},
      {"bulge", bulged(0.15, 5.0)},
      {"pinch", bulged(-0.15, 5.0)},
      {"drag", gaussian({0.4, -0.3}, 3.5, 1.2, 0.5)},
      {"drag at the corner", gaussian({-6.0, -4.0}, 3.0, 1.0, 1.0)},
      {"turn and drag", chained(gaussian({1.0, 1.0}, 3.5, -1.0, 0.8), rotated(12.0))},
      {"turn, shear, bulge", chained(bulged(0.1, 5.0), chained(sheared(0.1, 0.0), rotated(-15.0)))},
  };
  for (const auto& [name, warp] : warps) {
    const scene::PictureConfig config = wide_view();
    const auto truth = registered(config, warp);
    named_right(truth, {}, name);
  }
}

// A hole is predicted from its neighbours: within a tenth of a pitch on a flat lattice.
TEST(Grid, ToleratesOneMissingDotAnywhere) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config, reference_model::rotated(3.0));
  for (std::size_t i = 0; i < 63; ++i) {
    for (const bool auto_size : {false, true}) {
      reason_is(Reason::kNone, look(without(config, truth, {i}), kGrid, auto_size));
      named_right(truth, {i}, "missing " + std::to_string(i), 3.2);
    }
  }
}

TEST(Grid, ToleratesTwoMissingDotsAnywhere) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config, reference_model::rotated(-2.0));
  for (int round = 0; round < 200; ++round) {
    const std::size_t a = random() % 63;
    // Every other pair is two dots side by side, which is where holes hurt.
    const std::size_t b = round % 2 == 0 ? random() % 63 : (a % 9 < 8 ? a + 1 : a - 1);
    if (a == b) continue;
    reason_is(Reason::kNone, look(without(config, truth, {a, b})));
    named_right(truth, {a, b}, "missing " + std::to_string(a) + " and " + std::to_string(b), 3.2);
  }
}

// The corner's two neighbours gone, or the whole corner: nothing joins it to the rest but what lies across the hole.
TEST(Grid, ToleratesHolesAroundACorner) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config);
  const std::vector<std::set<std::size_t>> holes{{1, 9}, {7, 17}, {45, 55}, {53, 61},
                                                 {0, 1}, {0, 9},  {61, 62}, {31, 32}};
  for (const auto& hole : holes) {
    reason_is(Reason::kNone, look(without(config, truth, hole)));
    named_right(truth, hole, "hole at " + std::to_string(*hole.begin()));
  }
}

// Dots that dirt joins: those two may be lost, no other, and none may carry a wrong name.
TEST(Grid, ToleratesMergedDots) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config);
  for (const auto& [a, b] : {std::pair<std::size_t, std::size_t>{30, 31}, {0, 1}, {0, 9}, {61, 62}, {31, 40}}) {
    Picture picture = reference_model::picture_of(config, truth, 4);
    for (int k = 0; k <= 8; ++k) {
      blot(picture, {truth[a].x + (truth[b].x - truth[a].x) * k / 8, truth[a].y + (truth[b].y - truth[a].y) * k / 8},
           5.0);
    }
    reason_is(Reason::kNone, look(picture));
    for (const std::size_t i : {a, b}) {
      if (lattice.field.markers[i].valid) {
        CHECK_TRUE(reference_model::distance(truth[i],
                                             {px(lattice.field.markers[i].x), px(lattice.field.markers[i].y)}) <= 6.0);
      }
      lattice.field.markers[i].valid = false;
    }
    named_right(truth, {a, b}, "merged");
  }
}

// Blobs as large as dots, anywhere between and around them, at least 1.3 dot diameters from each dot's centre.
TEST(Grid, ToleratesStrayBlobs) {
  const scene::PictureConfig config = wide_view();
  const auto truth = reference_model::lattice_px({}, config);
  const double dot_px = config.dot_diameter_mm * config.px_per_mm;
  for (int round = 0; round < 100; ++round) {
    Picture picture = reference_model::picture_of(config, truth, 4);
    for (int blob = 0; blob < 5;) {
      const Point at{8.0 + static_cast<double>(random() % 304), 8.0 + static_cast<double>(random() % 224)};
      if (std::any_of(truth.begin(), truth.end(),
                      [&](Point t) { return reference_model::distance(t, at) < 1.3 * dot_px; }))
        continue;
      blot(picture, at, dot_px * (0.35 + 0.02 * static_cast<double>(random() % 10)));
      ++blob;
    }
    reason_is(Reason::kNone, look(picture));
    named_right(truth, {}, "round " + std::to_string(round));
  }
}

// Dirt that touches a dot pulls its blob: that one may be off by its radius or missing; the others must be right.
TEST(Grid, ToleratesDirtBesideADot) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config);
  for (std::size_t i = 0; i < 63; i += 2) {
    Picture picture = reference_model::picture_of(config, truth, 4);
    blot(picture, {truth[i].x + 9.0, truth[i].y + 4.0}, 4.0);
    reason_is(Reason::kNone, look(picture));
    Marker& dirty = lattice.field.markers[i];
    if (dirty.valid) CHECK_TRUE(reference_model::distance(truth[i], {px(dirty.x), px(dirty.y)}) <= 8.3);
    dirty.valid = false;
    named_right(truth, {i}, "dirt at " + std::to_string(i));
  }
}

// The lattice seen is smaller than configured: a mismatch, and what was seen is told.
TEST(Grid, SaysMismatchWhenTheLatticeIsSmaller) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config);
  const Picture picture = reference_model::picture_of(config, truth, 5);
  for (const GridSize wrong : {GridSize{8, 9}, {7, 10}, {8, 10}, {7, 11}, {9, 9}, {8, 16}, {10, 12}}) {
    reason_is(Reason::kGridMismatch, look(picture, wrong));
    CHECK_TRUE(lattice.found == kGrid);
  }
}

// One line more than configured, in either direction, is enough: 63 names could be laid over it in more than one way.
// It used to be called a mismatch.
TEST(Grid, SaysAmbiguousWhenTheLatticeIsLarger) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = reference_model::lattice_px({}, config);
  const Picture picture = reference_model::picture_of(config, truth, 5);
  for (const GridSize wrong :
       {GridSize{6, 9}, {7, 8}, {6, 8}, {3, 3}, {5, 5}, {9, 7}, {16, 8}, {6, 16}, {3, 16}, {16, 3}}) {
    reason_is(Reason::kGridAmbiguous, look(picture, wrong));
    CHECK_TRUE(lattice.found == kGrid);
  }
}

// A whole row or column cut off by the picture's edge is nothing else.
TEST(Grid, SaysMismatchWhenTheEdgeCutsALine) {
  scene::PictureConfig config = scene::cropped_320x240();
  config.center_x_px -= 48.0;
  const auto truth = reference_model::lattice_px({}, config);
  const Status status = look(reference_model::picture_of(config, truth, 5));
  CHECK_FALSE(status.ok());
  LONGS_EQUAL(7, lattice.found.rows);
  CHECK_TRUE(lattice.found.cols < 9);
}

// The lattice moved over the picture's edge in small steps, to each side: a line stays exactly while its dots are more
// than 0.32 pitch inside; within 1 px of that either answer is right. What stays is named right, and what was left out
// is told by side. A line whose dots are hardly seen may not be part of the lattice at all.
TEST(Grid, LeavesOutTheLinesThatTheEdgeCuts) {
  const scene::PictureConfig middle = scene::cropped_320x240();
  const double pitch_px = 2.02 * middle.px_per_mm;
  int cut_seen = 0;
  for (const Point direction : {Point{1, 0}, Point{-1, 0}, Point{0, 1}, Point{0, -1}, Point{-1, -1}}) {
    for (double by = 0.0; by <= 1.6 * pitch_px; by += 2.0) {
      scene::PictureConfig config = middle;
      config.center_x_px += direction.x * by;
      config.center_y_px += direction.y * by;
      const auto truth = reference_model::lattice_px({}, config);
      int top = 0, bottom = 0, left = 0, right = 0;
      bool unsure = false;
      const auto judge = [&](double inside_px, int& lines) {
        if (std::abs(inside_px - 0.32 * pitch_px) < 1.0) unsure = true;
        lines += inside_px < 0.32 * pitch_px ? 1 : 0;
      };
      for (std::size_t r = 0; r < 7; ++r) {
        judge(truth[9 * r].y, top);
        judge(239.0 - truth[9 * r].y, bottom);
      }
      for (std::size_t c = 0; c < 9; ++c) {
        judge(truth[c].x, left);
        judge(319.0 - truth[c].x, right);
      }
      if (unsure) continue;
      const std::string what = "moved by " + std::to_string(direction.x * by) + ", " + std::to_string(direction.y * by);
      reason_is(Reason::kNone, look(reference_model::picture_of(config, truth, 5), {}, true));
      const int rows = 7 - top - bottom, cols = 9 - left - right;
      LONGS_EQUAL_TEXT(rows, lattice.field.grid.rows, what.c_str());
      LONGS_EQUAL_TEXT(cols, lattice.field.grid.cols, what.c_str());
      LONGS_EQUAL_TEXT(lattice.found.rows - rows, lattice.cut.top + lattice.cut.bottom, what.c_str());
      LONGS_EQUAL_TEXT(lattice.found.cols - cols, lattice.cut.left + lattice.cut.right, what.c_str());
      if (top == 0) LONGS_EQUAL_TEXT(0, lattice.cut.top, what.c_str());
      if (bottom == 0) LONGS_EQUAL_TEXT(0, lattice.cut.bottom, what.c_str());
      if (left == 0) LONGS_EQUAL_TEXT(0, lattice.cut.left, what.c_str());
      if (right == 0) LONGS_EQUAL_TEXT(0, lattice.cut.right, what.c_str());
      cut_seen += lattice.cut.lines();
      std::vector<Point> kept;
      for (int r = top; r < 7 - bottom; ++r) {
        for (int c = left; c < 9 - right; ++c) kept.push_back(truth[static_cast<std::size_t>(9 * r + c)]);
      }
      named_right(kept, {}, what);
    }
  }
  CHECK_TRUE(cut_seen >= 20);
}

// A printed size that is given is kept as far as it can be; an earlier field keeps its own.
TEST(Grid, LeavesOutCutLinesOfAGivenSizeAtFirstSightOnly) {
  scene::PictureConfig config = scene::cropped_320x240();
  const double pitch_px = 2.02 * config.px_per_mm;
  const double margin_px = reference_model::lattice_px({}, config)[0].y;
  config.center_y_px -= margin_px - 0.25 * pitch_px;  // the top row's dots reach the picture's edge
  const auto truth = registered(config);
  CHECK_TRUE((lattice.field.grid == GridSize{6, 9}));
  CHECK_TRUE((lattice.cut == grid::Cut{.top = 1}));
  CHECK_TRUE(lattice.found == kGrid);
  const MarkerField prior = lattice.field;
  reason_is(Reason::kNone, look(reference_model::picture_of(config, truth, 5), kGrid, false, &prior));
  CHECK_TRUE((lattice.field.grid == GridSize{6, 9}));
  named_right({truth.begin() + 9, truth.end()}, {}, "with an earlier field");
}

TEST(Grid, SaysTooFewDotsWhenThereAreNone) {
  for (const int level : {0, 127, 255}) {
    reason_is(Reason::kTooFewDots, look(reference_model::flat(320, 240, static_cast<std::uint8_t>(level))));
    reason_is(Reason::kTooFewDots, look(reference_model::flat(64, 48, static_cast<std::uint8_t>(level))));
  }
  scene::PictureConfig config;
  reason_is(Reason::kTooFewDots, look(reference_model::picture_of(config, {}, 5)));  // shading and noise alone
  for (const double sigma : {0.0, 6.0}) {
    config.noise_sigma = sigma;
    CHECK_FALSE(look(reference_model::picture_of(config, {}, 5)).ok());
  }
  Picture blob = reference_model::flat(320, 240, 120);
  blot(blob, {160.0, 120.0}, 80.0);
  reason_is(Reason::kTooFewDots, look(blob));
}

// Dots without order: no lattice, or one that fits nothing; never success.
TEST(Grid, RefusesDotsThatAreNoLattice) {
  const scene::PictureConfig config = scene::cropped_320x240();
  for (int round = 0; round < 200; ++round) {
    std::vector<Point> dots;
    const std::size_t count = 5 + random() % 60;
    for (int tries = 0; dots.size() < count && tries < 2000; ++tries) {
      const Point at{10.0 + static_cast<double>(random() % 300), 10.0 + static_cast<double>(random() % 220)};
      if (std::none_of(dots.begin(), dots.end(), [&](Point d) { return reference_model::distance(d, at) < 20.0; }))
        dots.push_back(at);
    }
    CHECK_FALSE(look(reference_model::picture_of(config, dots, 5)).ok());
  }
}

TEST(Grid, RefusesTexturesThatAreNoGel) {
  for (const int cell : {1, 2, 4, 8, 16, 30}) {
    Picture picture = reference_model::flat(320, 240, 0);
    for (std::size_t i = 0; i < picture.pixels.size(); ++i) {
      const int x = static_cast<int>(i) % 320;
      const int y = static_cast<int>(i) / 320;
      picture.pixels[i] = (x / cell + y / cell) % 2 == 0 ? 40 : 200;
    }
    const Status status = look(picture);
    CHECK_FALSE(status.ok());
    CHECK_TRUE(status.reason == Reason::kTooFewDots || status.reason == Reason::kNoLattice ||
               status.reason == Reason::kDotsOverflow);
  }
}

// Fed with dots directly: rows and columns beyond what any gel has, coinciding dots, all dots in one line.
TEST(Grid, SurvivesDotsThatNoDetectorWouldGive) {
  const auto put = [&](int i, double x, double y) {
    found.dots[static_cast<std::size_t>(i)] = {PixelsQ8::from_raw(static_cast<std::int32_t>(x * 256)),
                                               PixelsQ8::from_raw(static_cast<std::int32_t>(y * 256)), 60, false};
  };
  const auto survive = [&](int count) {
    found.count = count;
    for (const bool auto_size : {false, true}) {
      grid::Config config;
      config.auto_size = auto_size;
      const Status status = grid::register_dots(*state, config, found, nullptr, lattice);
      if (status.ok()) CHECK_TRUE(lattice.field.grid.count() <= kMaxMarkers);
    }
  };
  survive(0);
  for (int i = 0; i < kMaxDots; ++i) put(i, 100.0, 100.0);
  survive(kMaxDots);
  for (int i = 0; i < kMaxDots; ++i) put(i, 8.0 * i, 50.0);
  survive(kMaxDots);
  for (int i = 0; i < kMaxDots; ++i) put(i, 8.0 * (i % 64), 50.0 + 8.0 * std::floor(i / 64.0));
  survive(kMaxDots);
  for (int i = 0; i < kMaxDots; ++i) put(i, 50.0 + 8.0 * std::floor(i / 64.0), 8.0 * (i % 64));
  survive(kMaxDots);
  for (int i = 0; i < kMaxDots; ++i) put(i, 8.0 * (i % 14), 50.0 + 8.0 * std::floor(i / 14.0));
  survive(kMaxDots);
  for (int round = 0; round < 50; ++round) {
    for (int i = 0; i < kMaxDots; ++i)
      put(i, static_cast<double>(random() % 1640), static_cast<double>(random() % 1232));
    survive(1 + static_cast<int>(random() % kMaxDots));
  }
}

// One line of dots, and two lines with a single dot beside them: no direction, or no lattice, is sure.
TEST(Grid, RefusesFewerThanThreeLines) {
  for (const bool upright : {false, true}) {
    for (const int lines : {1, 2}) {
      found.count = 0;
      const auto put = [&](int along, int across) {
        const PixelsQ8 far = PixelsQ8::from_raw((40 + 20 * along) * 256);
        const PixelsQ8 near = PixelsQ8::from_raw((40 + 20 * across) * 256);
        found.dots[static_cast<std::size_t>(found.count++)] = {upright ? near : far, upright ? far : near, 60, false};
      };
      for (int line = 0; line < lines; ++line) {
        for (int along = 0; along < 16; ++along) put(along, line);
      }
      if (lines == 2) put(8, 2);
      for (const bool auto_size : {false, true}) {
        grid::Config config;
        config.size = kGrid;
        config.auto_size = auto_size;
        reason_is(Reason::kNoLattice, grid::register_dots(*state, config, found, nullptr, lattice));
        if (lines == 2) CHECK_TRUE(lattice.found == (upright ? GridSize{16, 2} : GridSize{2, 16}));
      }
    }
  }
}

// The size is taken from the dots at first sight alone: a column that appears later is no part of the lattice.
TEST(Grid, KeepsTheSizeThatItFound) {
  const scene::PictureConfig config = wide_view();
  const auto truth = reference_model::lattice_px({}, config);
  reason_is(Reason::kNone, look(reference_model::picture_of(config, truth, 5), {}, true));
  CHECK_TRUE(lattice.field.grid == kGrid);
  const MarkerField prior = lattice.field;
  const auto wider = reference_model::lattice_px({7, 10, 2.02}, config, reference_model::shifted(1.01, 0.0));
  const Picture picture = reference_model::picture_of(config, wider, 5);
  reason_is(Reason::kNone, look(picture, {}, true, &prior));
  CHECK_TRUE(lattice.field.grid == kGrid);
  named_right(truth, {}, "a tenth column");
  LONGS_EQUAL(7, lattice.strays);
  reason_is(Reason::kNone, look(picture, {}, true));
  CHECK_TRUE((lattice.field.grid == GridSize{7, 10}));
}

// A row and a column hidden at once: all others keep their names, and where they cross, nobody is left in line to say
// where the marker would be.
TEST(Grid, KeepsTheNamesAroundAHiddenCross) {
  const scene::PictureConfig config = wide_view();
  const auto truth = registered(config);
  const MarkerField prior = lattice.field;
  std::set<std::size_t> cross = column(4);
  cross.merge(row_of(3));
  reason_is(Reason::kNone, look(without(config, truth, cross), kGrid, false, &prior));
  named_right(truth, cross, "hidden cross");
  cross.erase(31);
  for (const std::size_t i : cross) {
    const Marker& m = lattice.field.markers[i];
    CHECK_TRUE(reference_model::distance(truth[i], {px(m.x), px(m.y)}) <= 3.2);
  }
}

// With an earlier field the same lattice keeps its names when an outer column is hidden. An outer row is 9 of 63, more
// than 2/16, and the lattice could have moved by a row as well: refused. An inner line leaves no other place: named
// right.
TEST(Grid, KeepsTheNamesWhenALineIsHidden) {
  const scene::PictureConfig config = scene::cropped_320x240();
  const auto truth = registered(config);
  const MarkerField prior = lattice.field;
  for (std::size_t col = 0; col < 9; ++col) {
    const std::set<std::size_t> line = column(col);
    reason_is(Reason::kNone, look(without(config, truth, line), kGrid, false, &prior));
    named_right(truth, line, "hidden column " + std::to_string(col));
  }
  for (std::size_t row = 0; row < 7; ++row) {
    const std::set<std::size_t> line = row_of(row);
    const bool outer = row == 0 || row == 6;
    reason_is(outer ? Reason::kGridMismatch : Reason::kNone, look(without(config, truth, line), kGrid, false, &prior));
    if (!outer) named_right(truth, line, "hidden row " + std::to_string(row));
  }
}

// The same with one to three blobs a pitch beyond the opposite side: the grid covered more dots one column further, and
// every marker got its neighbour's name.
TEST(Grid, KeepsTheNamesWhenAColumnIsHiddenAndDirtLiesBeyondTheOther) {
  const scene::PictureConfig config = wide_view();
  const auto truth = registered(config);
  const MarkerField prior = lattice.field;
  const double pitch_px = 2.02 * config.px_per_mm;
  for (const std::size_t col : {std::size_t{0}, std::size_t{8}}) {
    const double side_px = col == 0 ? pitch_px : -pitch_px;
    for (std::size_t first = 0; first < 7; ++first) {
      for (std::size_t blobs = 1; blobs <= 3; ++blobs) {
        Picture picture = without(config, truth, column(col));
        for (std::size_t k = 0; k < blobs; ++k) {
          const Point beside = truth[9 * ((first + 2 * k) % 7) + (8 - col)];
          blot(picture, {beside.x + side_px, beside.y}, 0.5 * config.dot_diameter_mm * config.px_per_mm);
        }
        reason_is(Reason::kNone, look(picture, kGrid, false, &prior));
        named_right(truth, column(col), "hidden column " + std::to_string(col) + ", dirt");
      }
    }
  }
}

// Among places within half a line of the fullest the earlier field decides, also after a shift of almost half a pitch
// and when it has holes itself.
TEST(Grid, StaysWhereTheEarlierFieldWas) {
  const scene::PictureConfig config = wide_view();
  const auto rest = registered(config);
  const MarkerField prior = lattice.field;
  for (int direction = 0; direction < 16; ++direction) {
    const double angle = direction * std::numbers::pi / 8.0;
    const auto moved = reference_model::lattice_px(
        {}, config, reference_model::shifted(0.95 * std::cos(angle), 0.95 * std::sin(angle)));
    for (const std::size_t col : {std::size_t{0}, std::size_t{8}}) {
      reason_is(Reason::kNone, look(without(config, moved, column(col)), kGrid, false, &prior));
      named_right(moved, column(col), "direction " + std::to_string(direction));
    }
  }
}

// Nothing near an outer line is missing, so no other place covers nearly as many dots: 5/16 of 63 may go, 19 and
// not 20. Without an earlier field 2/16 may: 7 and not 8.
TEST(Grid, AllowsMoreHolesWhenTheEarlierFieldLeavesNoDoubt) {
  const scene::PictureConfig config = wide_view();
  const auto truth = registered(config);
  const MarkerField prior = lattice.field;
  // Rows 2 to 4 and then some: a hand across the gel.
  std::vector<std::size_t> order;
  for (const std::size_t r : {std::size_t{3}, std::size_t{2}, std::size_t{4}}) {
    for (std::size_t c = 1; c < 8; ++c) order.push_back(9 * r + c);
  }
  for (std::size_t count = 1; count <= 20; ++count) {
    const std::set<std::size_t> gone(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count));
    const Picture picture = without(config, truth, gone);
    const std::string what = std::to_string(count) + " gone";
    reason_is(count <= 19 ? Reason::kNone : Reason::kGridMismatch, look(picture, kGrid, false, &prior));
    if (count <= 19) named_right(truth, gone, what);
    reason_is(count <= 7 ? Reason::kNone : Reason::kGridMismatch, look(picture));
    if (count <= 7) named_right(truth, gone, what);
  }
}

// Below 80 columns the dots of a cropped view are under 4 px: refusing is allowed, wrong names are not.
TEST(Grid, RefusesRatherThanMisnamesWhenThePictureIsTooSmall) {
  for (const int width : {64, 68, 72, 76}) {
    const scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
    const auto truth = reference_model::lattice_px({}, config);
    if (!look(reference_model::picture_of(config, truth, 5)).ok()) continue;
    for (std::size_t i = 0; i < 63; ++i) {
      const Marker& m = lattice.field.markers[i];
      if (m.valid) CHECK_TRUE(reference_model::distance(truth[i], {px(m.x), px(m.y)}) <= 1.0);
    }
  }
}
