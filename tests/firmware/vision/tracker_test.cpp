// SPDX-License-Identifier: Apache-2.0
// Following the markers through rendered motion of known truth.
//
// The one thing that must never happen is a swap: a marker that is valid and more than 2 px (320-px scale) from the dot
// printed under its name. Losing a marker is allowed where the test says so.
#include "vision/tracker.hpp"

#include <algorithm>
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
using namespace holdfast::reference_model;

namespace {

double px(PixelsQ8 q) {
  return q.raw() / 256.0;
}

// The grid with room around it, as the raw camera shows it: large jumps stay in the picture.
scene::PictureConfig wide_view() {
  scene::PictureConfig config = scene::cropped_320x240();
  config.px_per_mm *= 0.7;
  config.edge_softness_px *= 0.7;
  return config;
}

}  // namespace

TEST_GROUP(Tracker) {
  std::unique_ptr<tracker::State> state = std::make_unique<tracker::State>();
  tracker::Config config;
  Grid grid;
  scene::PictureConfig view = scene::cropped_320x240();
  std::uint64_t seed = 100;
  std::vector<Point> truth;
  std::set<std::size_t> hidden;
  std::vector<Point> dirt;  // blobs of a dot's size and darkness

  void begin(const Grid& printed, const scene::PictureConfig& picture) {
    grid = printed;
    view = picture;
    config.grid.size = {static_cast<std::uint8_t>(printed.rows), static_cast<std::uint8_t>(printed.cols)};
    state = std::make_unique<tracker::State>();
    hidden.clear();
    dirt.clear();
    CHECK_TRUE(show(Warp{}).ok());
    LONGS_EQUAL(printed.rows * printed.cols, state->field.valid_count());
    tracker::set_home(*state, state->field);
  }

  Picture picture(const Warp& warp) {
    truth = lattice_px(grid, view, warp);
    std::vector<Point> seen;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (!hidden.contains(i)) seen.push_back(truth[i]);
    }
    seen.insert(seen.end(), dirt.begin(), dirt.end());
    return picture_of(view, seen, ++seed);
  }

  Status show(const Warp& warp) {
    return tracker::update(*state, config, picture(warp).view());
  }
  Status show(const Picture& other) {
    return tracker::update(*state, config, other.view());
  }

  double off(std::size_t i) const {
    const Marker& m = state->field.markers[i];
    return distance(truth[i], {px(m.x), px(m.y)});
  }

  // No valid marker is somebody else; hidden ones are not valid.
  void nobody_swapped(const std::string& what) {
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (!state->field.markers[i].valid) continue;
      const SimpleString text =
          StringFromFormat("%s: marker %d is %.2f px off", what.c_str(), static_cast<int>(i), off(i));
      CHECK_TRUE_TEXT(off(i) <= 2.0 * view.width / 320.0 && !hidden.contains(i), text.asCharString());
    }
  }

  // No dot has two names: printed dots are a pitch apart, and the gel never brings them within half of it.
  void nobody_twice(const std::string& what) {
    for (std::size_t i = 0; i < truth.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        const Marker& a = state->field.markers[i];
        const Marker& b = state->field.markers[j];
        if (!a.valid || !b.valid) continue;
        CHECK_TRUE_TEXT(distance({px(a.x), px(a.y)}, {px(b.x), px(b.y)}) > 0.4 * px(state->pitch), what.c_str());
      }
    }
  }

  void order_kept(const std::string& what) {
    const auto& m = state->field.markers;
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.cols; ++c) {
        const auto i = static_cast<std::size_t>(r * grid.cols + c);
        const auto right = i + 1;
        const auto below = i + static_cast<std::size_t>(grid.cols);
        if (c + 1 < grid.cols && m[i].valid && m[right].valid) CHECK_TRUE_TEXT(m[i].x < m[right].x, what.c_str());
        if (r + 1 < grid.rows && m[i].valid && m[below].valid) CHECK_TRUE_TEXT(m[i].y < m[below].y, what.c_str());
      }
    }
  }

  int lost() const {
    return grid.rows * grid.cols - state->field.valid_count();
  }

  // Lost though the whole dot and 2 px around it are in the picture.
  int lost_in_sight() const {
    const double room = 0.5 * view.dot_diameter_mm * view.px_per_mm + 2.0;
    int n = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const Point t = truth[i];
      const bool in_sight = t.x >= room && t.y >= room && t.x <= view.width - 1 - room && t.y <= view.height - 1 - room;
      n += in_sight && !state->field.markers[i].valid ? 1 : 0;
    }
    return n;
  }

  // RMS of the 2-D error over `frames` of a field that moves, turns and shears, in 320-px pixels.
  double rms(const scene::PictureConfig& picture, int frames) {
    begin({}, picture);
    const std::uint32_t searches = state->searches;
    double sum = 0.0;
    int n = 0;
    for (int frame = 0; frame < frames; ++frame) {
      const double t = frame * 0.1;
      const Warp warp = chained(gaussian({0.4, -0.3}, 4.0, 0.4 * std::sin(0.7 * t), 0.4 * std::cos(0.9 * t) - 0.4),
                                chained(sheared(0.03 * std::sin(t), 0.02 * std::sin(1.3 * t)),
                                        chained(rotated(3.0 * std::sin(0.8 * t)),
                                                shifted(0.5 * std::sin(1.1 * t), 0.3 * std::sin(1.7 * t)))));
      CHECK_TRUE(show(warp).ok());
      LONGS_EQUAL(0, lost());
      for (std::size_t i = 0; i < truth.size(); ++i) {
        sum += off(i) * off(i);
        ++n;
      }
    }
    LONGS_EQUAL(searches, state->searches);
    return std::sqrt(sum / n) * 320.0 / picture.width;
  }
};

// DESIGN.md, budgets: at most 0.029 px on 320x240 frames with noise sigma 2.5.
TEST(Tracker, CentresAreWithinTheBudgetForEveryDotAndLight) {
  for (const double diameter : {0.57, 0.77, 1.05}) {
    for (const double shading : {0.0, 20.0}) {
      scene::PictureConfig picture;
      picture.dot_diameter_mm = diameter;
      picture.shading = shading;
      const double error_px = rms(picture, 60);
      CHECK_TRUE_TEXT(
          error_px <= 0.029,
          StringFromFormat("dot %.2f mm, shading %.0f: %.4f px", diameter, shading, error_px).asCharString());
    }
  }
}

TEST(Tracker, CentresAreWithinTheBudgetAtLargerScales) {
  for (const int width : {640, 1640}) {
    scene::PictureConfig picture = scene::scaled(scene::cropped_320x240(), width);
    picture.noise_sigma = 2.5;
    const double error_px = rms(picture, width == 640 ? 60 : 12);
    CHECK_TRUE_TEXT(error_px <= 0.029, StringFromFormat("%d columns: %.4f px", width, error_px).asCharString());
  }
}

// sigma 6 is what a dark exposure looks like: the error grows (0.058 px measured for windows of this kind), nothing is
// lost.
TEST(Tracker, LosesNoMarkerInHeavyNoise) {
  for (const double diameter : {0.57, 0.77, 1.05}) {
    scene::PictureConfig picture;
    picture.noise_sigma = 6.0;
    picture.dot_diameter_mm = diameter;
    CHECK_TRUE(rms(picture, 60) <= 0.07);
  }
}

TEST(Tracker, FollowsJumpsOfUpToHalfAMillimetreByWindowsAlone) {
  for (const auto& [printed, picture] : {std::pair{Grid{}, scene::cropped_320x240()},
                                         {Grid{}, scene::scaled(scene::cropped_320x240(), 640)},
                                         {Grid{8, 10, 1.8}, scene::cropped_320x240()}}) {
    begin(printed, picture);
    const std::uint32_t searches = state->searches;
    for (const double jump_mm : {0.1, 0.2, 0.3, 0.4, 0.5}) {
      for (int direction = 0; direction < 16; ++direction) {
        const double angle = direction * std::numbers::pi / 8.0;
        const double dx = jump_mm * std::cos(angle);
        const double dy = jump_mm * std::sin(angle);
        const std::string what =
            StringFromFormat("%dx%d %.1f mm, direction %d", printed.rows, printed.cols, jump_mm, direction)
                .asCharString();
        // There in one frame and back in one frame: the snap-back is a jump too.
        for (const Warp& warp : {shifted(dx, dy), Warp{}, gaussian({1.0, 0.5}, 3.5, dx, dy), Warp{}}) {
          CHECK_TRUE(show(warp).ok());
          LONGS_EQUAL_TEXT(0, lost(), what.c_str());
          nobody_swapped(what);
        }
      }
    }
    LONGS_EQUAL(searches, state->searches);
  }
}

// Up to half a pitch the windows may end on either of two dots; the search decides. One frame may lose markers, the
// next has all of them.
TEST(Tracker, FollowsJumpsOfUpToAMillimetreWithASearch) {
  for (const Grid& printed : {Grid{}, Grid{8, 10, 1.8}}) {
    begin(printed, scene::cropped_320x240());
    for (const double jump_mm : {0.6, 0.7, 0.8, 0.9, 1.0}) {
      for (int direction = 0; direction < 16; ++direction) {
        const double angle = direction * std::numbers::pi / 8.0;
        const double dx = jump_mm * std::cos(angle);
        const double dy = jump_mm * std::sin(angle);
        const std::string what =
            StringFromFormat("%dx%d %.1f mm, direction %d", printed.rows, printed.cols, jump_mm, direction)
                .asCharString();
        for (const Warp& warp : {shifted(dx, dy), Warp{}, gaussian({1.0, 0.5}, 3.5, dx, dy), Warp{}}) {
          CHECK_TRUE(show(warp).ok());
          nobody_swapped(what);
          order_kept(what);
          CHECK_TRUE(show(warp).ok());
          nobody_swapped(what);
          LONGS_EQUAL_TEXT(0, lost_in_sight(), what.c_str());
        }
      }
    }
  }
}

// Far beyond what a gel does between two frames, up to a whole pitch, where every inner window finds a perfect dot.
TEST(Tracker, NeverSwapsAfterAJumpOfUpToAPitch) {
  begin({}, wide_view());
  for (double jump_mm = 1.1; jump_mm <= 2.1; jump_mm += 0.1) {
    for (int direction = 0; direction < 16; ++direction) {
      const double angle = direction * std::numbers::pi / 8.0;
      for (const Warp& warp : {shifted(jump_mm * std::cos(angle), jump_mm * std::sin(angle)), Warp{}}) {
        const std::string what = StringFromFormat("%.1f mm, direction %d", jump_mm, direction).asCharString();
        CHECK_TRUE(show(warp).ok());
        nobody_swapped(what);
        CHECK_TRUE(show(warp).ok());
        nobody_swapped(what);
        LONGS_EQUAL_TEXT(0, lost(), what.c_str());
      }
    }
  }
}

// Two neighbours lost their dots, the window of the one between them slid onto a neighbour's dot, and nobody objected:
// two markers valid on one dot. The first three cases are the snap-backs that did it (3 of 1200), then 1.6 mm in the
// middle, and others at random.
TEST(Tracker, NeverSwapsAfterTheSnapBackOfALocalDrag) {
  struct Case {
    double drag, angle;
    scene::Vec2 centre;
    double sigma;
    std::uint64_t seed;
  };
  std::vector<Case> cases;
  for (std::uint64_t noise = 0; noise < 5; ++noise) {
    cases.push_back({1.2436, 3.1341, {-4.04, 2.02}, 3.0, 1551 + noise});
    cases.push_back({1.2496, 3.2337, {-4.04, 0.0}, 3.0, 9791 + noise});
    cases.push_back({1.2505, 3.0638, {-4.04, -2.02}, 3.0, 10251 + noise});
  }
  for (std::uint64_t k = 0; k < 16; ++k) {
    cases.push_back({1.6, static_cast<double>(k) * std::numbers::pi / 8.0, {0.4, -0.3}, 3.5, 30'000 + 20 * k});
  }
  std::mt19937 random(73);
  const auto draw = [&](double span) { return span * (static_cast<double>(random() % 2001) / 1000.0 - 1.0); };
  for (std::uint64_t k = 0; k < 100; ++k) {
    cases.push_back({1.25, draw(std::numbers::pi), {draw(8.0), draw(6.0)}, 3.0, 20'000 + 20 * k});
  }
  for (const Case& c : cases) {
    const std::string what = "seed " + std::to_string(c.seed);
    seed = c.seed;
    begin({}, scene::cropped_320x240());
    for (int step = 1; step <= 8; ++step) {
      const double drag = c.drag * step / 8.0;
      CHECK_TRUE(show(gaussian(c.centre, c.sigma, drag * std::cos(c.angle), drag * std::sin(c.angle))).ok());
      nobody_swapped("drag, " + what);
      nobody_twice("drag, " + what);
    }
    if (c.drag > 1.5) LONGS_EQUAL(0, lost());
    for (int frame = 0; frame < 2; ++frame) {
      CHECK_TRUE(show(Warp{}).ok());
      nobody_swapped("snap-back, " + what);
      nobody_twice("snap-back, " + what);
      order_kept("snap-back, " + what);
    }
    LONGS_EQUAL(0, lost());
  }
}

// A hand's or a hair's shadow over 8 to 18 dots within one frame: all others were declared lost too, for as long as it
// lasted.
TEST(Tracker, KeepsTheRestWhenManyInnerDotsVanishAtOnce) {
  for (std::size_t count = 8; count <= 18; ++count) {
    for (const std::size_t centre : {std::size_t{20}, std::size_t{31}, std::size_t{42}}) {
      // The `count` inner dots nearest to the centre.
      std::vector<std::size_t> order;
      for (std::size_t i = 0; i < 63; ++i) {
        if (i / 9 > 0 && i / 9 < 6 && i % 9 > 0 && i % 9 < 8) order.push_back(i);
      }
      begin({}, scene::cropped_320x240());
      const std::vector<Point> rest = truth;
      std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return distance(rest[a], rest[centre]) < distance(rest[b], rest[centre]);
      });
      hidden.insert(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count));
      const std::string what = std::to_string(count) + " around " + std::to_string(centre);
      for (int k = 0; k < 16; ++k) {
        CHECK_TRUE(show(shifted(0.05 * k, -0.02 * k)).ok());
        nobody_swapped(what);
        LONGS_EQUAL_TEXT(static_cast<int>(count), lost(), what.c_str());
      }
      hidden.clear();
      for (int k = 0; k < 2; ++k) CHECK_TRUE(show(shifted(0.8, -0.3)).ok());
      nobody_swapped(what + ", back");
      LONGS_EQUAL_TEXT(0, lost(), what.c_str());
    }
  }
}

// An outer line hidden and up to three blobs a pitch beyond the opposite side: the lattice was laid over the blobs, and
// each marker got its neighbour's name. (Without an outer row all are lost: see Grid.)
TEST(Tracker, NeverSwapsWhenDirtContinuesTheLatticeWhileALineIsHidden) {
  for (int side = 0; side < 4; ++side) {
    for (const bool at_once : {true, false}) {
      for (std::size_t blobs = 0; blobs <= 3; ++blobs) {
        begin({}, wide_view());
        const double pitch_px = 2.02 * view.px_per_mm;
        std::vector<std::size_t> line;
        for (std::size_t i = 0; i < 63; ++i) {
          const std::size_t row = i / 9, col = i % 9;
          if (side == 0 ? col == 0 : side == 1 ? col == 8 : side == 2 ? row == 0 : row == 6) line.push_back(i);
        }
        for (std::size_t k = 0; k < blobs; ++k) {
          const Point hides = truth[line[(2 * k + 1) % line.size()]];
          const double far_px = (side < 2 ? 9.0 : 7.0) * pitch_px * (side % 2 == 0 ? 1.0 : -1.0);
          dirt.push_back({hides.x + (side < 2 ? far_px : 0.0), hides.y + (side < 2 ? 0.0 : far_px)});
        }
        if (at_once) hidden.insert(line.begin(), line.end());
        for (std::size_t k = 0; k < 14; ++k) {
          if (k < line.size()) hidden.insert(line[k]);
          CHECK_TRUE(show(Warp{}).ok());
          nobody_swapped(StringFromFormat("side %d, %d blobs", side, static_cast<int>(blobs)).asCharString());
        }
        if (side < 2) LONGS_EQUAL(7, lost());
        hidden.clear();
        for (int k = 0; k < 13; ++k) CHECK_TRUE(show(Warp{}).ok());
        nobody_swapped("line back");
        LONGS_EQUAL(0, lost());
      }
    }
  }
}

// A lost marker's window saw the rim of a blob that lay between four dots and wandered onto it, half a pitch off.
TEST(Tracker, DoesNotTakeDirtBetweenTheDotsForALostMarker) {
  for (const std::size_t marker : {std::size_t{10}, std::size_t{31}, std::size_t{52}}) {
    for (const auto& [side_x, side_y] : {std::pair{1, 1}, {-1, 1}, {1, -1}, {-1, -1}}) {
      begin({}, scene::cropped_320x240());
      hidden = {marker};
      for (int k = 0; k < 3; ++k) CHECK_TRUE(show(Warp{}).ok());  // lost already when the blob comes
      dirt = {{truth[marker].x + 11.8 * side_x, truth[marker].y + 11.8 * side_y}};
      for (int k = 0; k < 15; ++k) {
        CHECK_TRUE(show(Warp{}).ok());
        nobody_swapped("dirt by marker " + std::to_string(marker));
        CHECK_TRUE(lost() <= 3);  // neighbours whose rims it touches may go too
      }
    }
  }
}

// Blobs of a dot's size that come and go between the dots, up to five at a time, while the gel turns and is dragged at
// random; they leave at least 0.3 mm of gel to each dot. Inside its window they pull the centre of a dot by up to 8 px
// (2 px are exceeded by 0.04 to 0.21 % of the markers), so no 2 px here: but never to another dot, and none is lost.
TEST(Tracker, NeverSwapsWhileDirtComesAndGoesBetweenTheDots) {
  std::mt19937 random(74);
  const auto draw = [&](double span) { return span * (static_cast<double>(random() % 2001) / 1000.0 - 1.0); };
  std::size_t blobs = 0;
  for (int round = 0; round < 20; ++round) {
    begin({}, round % 2 == 0 ? scene::cropped_320x240() : wide_view());
    const double least_px = (view.dot_diameter_mm + 0.3) * view.px_per_mm;
    double x = 0.0, y = 0.0, angle = 0.0, drag_x = 0.0, drag_y = 0.0;
    const auto walk = [&](double& value, double step, double limit) {
      value = std::clamp(value + draw(step), -limit, limit);
    };
    std::vector<scene::Vec2> on_gel;  // mm; moves with it
    for (int frame = 0; frame < 100; ++frame) {
      walk(x, 0.15, 0.4);
      walk(y, 0.15, 0.4);
      walk(angle, 0.5, 3.0);
      walk(drag_x, 0.25, 0.85);
      walk(drag_y, 0.25, 0.85);
      const Warp warp = chained(gaussian({0.4, -0.3}, 4.0, drag_x, drag_y), chained(rotated(angle), shifted(x, y)));
      const std::vector<Point> printed = lattice_px(grid, view, warp);
      if (frame % 3 == 0) {
        on_gel.clear();
        for (auto k = random() % 6; k > 0; --k) {
          on_gel.push_back(
              {2.02 * std::round(draw(4.0)) + 1.01 + draw(0.1), 2.02 * std::round(draw(3.0)) + 1.01 + draw(0.1)});
        }
      }
      dirt.clear();
      for (const scene::Vec2 place : on_gel) {
        const scene::Vec2 now = warp(place);
        const Point at{view.center_x_px + now.x * view.px_per_mm, view.center_y_px + now.y * view.px_per_mm};
        const bool clear =
            std::all_of(printed.begin(), printed.end(), [&](Point dot) { return distance(dot, at) >= least_px; });
        if (clear) dirt.push_back(at);
      }
      blobs += dirt.size();
      CHECK_TRUE(show(warp).ok());
      const std::string what = StringFromFormat("round %d, frame %d", round, frame).asCharString();
      for (std::size_t i = 0; i < printed.size(); ++i) {
        if (state->field.markers[i].valid) CHECK_TRUE_TEXT(off(i) < 0.3 * px(state->pitch), what.c_str());
      }
      nobody_twice(what);
      LONGS_EQUAL_TEXT(0, lost_in_sight(), what.c_str());
    }
  }
  CHECK_TRUE(blobs > 2000);
}

TEST(Tracker, LosesOnlyTheHiddenDotAndFindsItAgain) {
  begin({}, scene::cropped_320x240());
  const auto sway = [](int frame) { return shifted(0.3 * std::sin(0.9 * frame), 0.2 * std::cos(0.7 * frame) - 0.2); };
  int frame = 0;
  for (std::size_t i = 0; i < 63; ++i) {
    hidden = {i};
    for (int k = 0; k < 3; ++k) {
      CHECK_TRUE(show(sway(++frame)).ok());
      nobody_swapped("hidden " + std::to_string(i));
      LONGS_EQUAL(1, lost());
    }
    hidden.clear();
    for (int k = 0; k < 2; ++k) {
      CHECK_TRUE(show(sway(++frame)).ok());
      nobody_swapped("back " + std::to_string(i));
    }
    LONGS_EQUAL(0, lost());
  }
}

TEST(Tracker, NeverSwapsWhileAWholeLineIsHidden) {
  begin({}, scene::cropped_320x240());
  for (int line = 0; line < 16; ++line) {
    hidden.clear();
    for (std::size_t i = 0; i < 63; ++i) {
      if (line < 9 ? i % 9 == static_cast<std::size_t>(line) : i / 9 == static_cast<std::size_t>(line - 9))
        hidden.insert(i);
    }
    for (int k = 1; k <= 12; ++k) {
      CHECK_TRUE(show(shifted(0.3 * std::sin(0.8 * k), 0.25 * std::sin(1.1 * k))).ok());
      nobody_swapped("line " + std::to_string(line));
      order_kept("line " + std::to_string(line));
    }
    hidden.clear();
    for (int k = 0; k < 14; ++k) {  // a search is due after search_every frames at the latest
      CHECK_TRUE(show(Warp{}).ok());
      nobody_swapped("line back " + std::to_string(line));
    }
    LONGS_EQUAL(0, lost());
  }
}

// Dots go one by one, in random order, until a third is gone; no single step is large enough to look like a jump.
TEST(Tracker, NeverSwapsWhileDotsVanishOneByOne) {
  std::mt19937 random(70);
  for (int round = 0; round < 6; ++round) {
    begin({}, scene::cropped_320x240());
    std::vector<std::size_t> order(63);
    for (std::size_t i = 0; i < 63; ++i) order[i] = i;
    // Rounds 0 and 1 take the dots from one side: whole outer lines go.
    if (round >= 2) std::shuffle(order.begin(), order.end(), random);
    if (round == 1)
      std::stable_sort(order.begin(), order.end(), [](std::size_t a, std::size_t b) { return a % 9 < b % 9; });
    for (std::size_t k = 0; k < 40; ++k) {
      hidden.insert(order[k]);
      CHECK_TRUE(
          show(shifted(0.25 * std::sin(0.5 * static_cast<double>(k)), 0.2 * std::sin(0.8 * static_cast<double>(k))))
              .ok());
      nobody_swapped(StringFromFormat("round %d, %d gone", round, static_cast<int>(k)).asCharString());
    }
    hidden.clear();
    for (int k = 0; k < 14; ++k) {
      CHECK_TRUE(show(Warp{}).ok());
      nobody_swapped("all back, round " + std::to_string(round));
    }
    LONGS_EQUAL(0, lost());
  }
}

// Light off for three frames while the gel moves on: all lost, then all back under their own names.
TEST(Tracker, ComesBackAfterBlackPictures) {
  begin({}, scene::cropped_320x240());
  for (int direction = 0; direction < 16; ++direction) {
    const double angle = direction * std::numbers::pi / 8.0;
    for (const std::uint8_t level : {std::uint8_t{0}, std::uint8_t{255}, std::uint8_t{120}}) {
      for (int k = 0; k < 3; ++k) {
        (void)show(flat(320, 240, level));
        LONGS_EQUAL(0, state->field.valid_count());
      }
      for (int k = 0; k < 2; ++k) {
        CHECK_TRUE(show(shifted(0.4 * std::cos(angle), 0.4 * std::sin(angle))).ok());
        nobody_swapped("after black");
      }
      LONGS_EQUAL(0, lost());
    }
  }
}

// Exposure steps by up to a factor of two within one frame: a frame may be lost, nothing may be swapped.
TEST(Tracker, FollowsStepsOfBrightness) {
  begin({}, scene::cropped_320x240());
  const scene::PictureConfig normal = view;
  std::mt19937 random(71);
  for (int step = 0; step < 40; ++step) {
    const double gain = 0.6 + 0.01 * static_cast<double>(random() % 90);
    view.background = normal.background * gain;
    view.dot_level = normal.dot_level * gain;
    view.shading = normal.shading * gain;
    for (int k = 0; k < 2; ++k) {
      CHECK_TRUE(show(shifted(0.05 * (step % 5), 0.0)).ok());
      nobody_swapped("step " + std::to_string(step));
    }
    LONGS_EQUAL_TEXT(0, lost(), StringFromFormat("gain %.2f", gain).asCharString());
  }
}

// 500 frames of everything at once: shift, turn and a local drag of up to 1.2 mm, each walking at random. At least 99 %
// of the markers are seen (DESIGN.md asks that of real clips), and none is ever somebody else.
TEST(Tracker, NeverInvertsTheOrderOnARandomWalk) {
  std::mt19937 random(72);
  const auto draw = [&](double span) { return span * (static_cast<double>(random() % 2001) / 1000.0 - 1.0); };
  for (const Grid& printed : {Grid{}, Grid{8, 10, 1.8}}) {
    begin(printed, scene::cropped_320x240());
    double x = 0.0, y = 0.0, angle = 0.0, drag_x = 0.0, drag_y = 0.0, centre_x = 0.0, centre_y = 0.0;
    const auto walk = [&](double& value, double step, double limit) {
      value = std::clamp(value + draw(step), -limit, limit);
    };
    int seen = 0;
    for (int frame = 0; frame < 500; ++frame) {
      walk(x, 0.15, 0.4);
      walk(y, 0.15, 0.4);
      walk(angle, 0.5, 3.0);
      walk(drag_x, 0.25, 0.85);  // 1.2 mm together
      walk(drag_y, 0.25, 0.85);
      walk(centre_x, 0.2, 5.0);
      walk(centre_y, 0.2, 4.0);
      CHECK_TRUE(
          show(chained(gaussian({centre_x, centre_y}, 3.0, drag_x, drag_y), chained(rotated(angle), shifted(x, y))))
              .ok());
      nobody_swapped("frame " + std::to_string(frame));
      order_kept("frame " + std::to_string(frame));
      seen += state->field.valid_count();
    }
    CHECK_TRUE(seen * 100 >= 99 * 500 * printed.rows * printed.cols);
  }
}

// A marker at the picture's edge is right or invalid: half a dot has its centre in the wrong place.
TEST(Tracker, DeclaresMarkersLostThatLeaveThePicture) {
  begin({}, scene::cropped_320x240());
  for (int frame = 1; frame <= 60; ++frame) {
    const double x = 2.2 * std::sin(frame * std::numbers::pi / 30.0);  // out and back on both sides, 0.23 mm a frame
    CHECK_TRUE(show(shifted(x, 0.0)).ok());
    for (std::size_t i = 0; i < 63; ++i) {
      if (state->field.markers[i].valid)
        CHECK_TRUE_TEXT(
            off(i) <= 2.0,
            StringFromFormat("frame %d marker %d: %.2f px", frame, static_cast<int>(i), off(i)).asCharString());
    }
  }
  CHECK_TRUE(show(Warp{}).ok());
  LONGS_EQUAL(0, lost());
}

// 25 dots vanish one by one, which is no jump but too many holes for a search. The one in their middle comes back
// alone: with no neighbour to say where it belongs it is not looked for, or it could be anybody.
TEST(Tracker, LooksForNobodyWhoseNeighboursAreAllLost) {
  begin({}, scene::cropped_320x240());
  for (std::size_t row = 1; row < 6; ++row) {
    for (std::size_t col = 2; col < 7; ++col) {
      hidden.insert(9 * row + col);
      CHECK_TRUE(show(Warp{}).ok());
    }
  }
  LONGS_EQUAL(25, lost());
  hidden.erase(31);
  for (int k = 0; k < 15; ++k) {
    CHECK_TRUE(show(Warp{}).ok());
    nobody_swapped("alone");
    LONGS_EQUAL(25, lost());
  }
  hidden.erase(30);  // beside the lattice that is left
  hidden.erase(29);
  for (int k = 0; k < 2; ++k) CHECK_TRUE(show(Warp{}).ok());
  nobody_swapped("in company");
  LONGS_EQUAL(22, lost());
}

// Dirt around a dot: what its window measures is round and in its place, and twice as large as the dot was. Lost,
// though a search of the whole picture names it, and back when the dirt is gone.
TEST(Tracker, LosesADotThatDirtMakesLarger) {
  begin({}, scene::cropped_320x240());
  const std::uint32_t searches = state->searches;
  for (int k = 0; k < 3; ++k) {
    Picture shown = picture(Warp{});
    draw_disc(shown, truth[31], 1.4 * 0.5 * view.dot_diameter_mm * view.px_per_mm, 45);
    CHECK_TRUE(show(shown).ok());
    nobody_swapped("dirt");
    LONGS_EQUAL(1, lost());
    CHECK_FALSE(state->field.markers[31].valid);
  }
  LONGS_EQUAL(searches + 1, state->searches);
  for (int k = 0; k < 2; ++k) CHECK_TRUE(show(Warp{}).ok());
  LONGS_EQUAL(0, lost());
}

// At first sight a dot counts when its window says so, too: not with a highlight in its middle, nor when it is a speck.
TEST(Tracker, TakesAtFirstSightWhatTheWindowsConfirm) {
  view.dot_diameter_mm = 0.57;
  config.grid.size = {7, 9};
  hidden = {50};
  Picture shown = picture(Warp{});
  draw_disc(shown, truth[12], 2.5, 150);
  draw_disc(shown, truth[50], 2.8, 45);
  CHECK_TRUE(show(shown).ok());
  LONGS_EQUAL(2, lost());
  CHECK_FALSE(state->field.markers[12].valid);
  CHECK_FALSE(state->field.markers[50].valid);
  hidden.clear();
  for (int k = 0; k < 13; ++k) {
    CHECK_TRUE(show(Warp{}).ok());
    nobody_swapped("confirmed");
  }
  LONGS_EQUAL(0, lost());
}

// A first picture in which no window confirms anything taught the size of a dot as one pixel, and no dot of any later
// picture was like that: all lost until the next start.
TEST(Tracker, StartsAnewWhenNoWindowConfirmsADot) {
  config.grid.size = {7, 9};
  Picture shown = picture(Warp{});
  for (const Point& dot : truth) draw_disc(shown, dot, 4.0, 150);
  for (int k = 0; k < 3; ++k) {
    LONGS_EQUAL(static_cast<int>(Reason::kMarkersLost), static_cast<int>(show(shown).reason));
    CHECK_FALSE(state->acquired);
  }
  CHECK_TRUE(show(Warp{}).ok());
  LONGS_EQUAL(0, lost());
  nobody_swapped("after highlights");
}

// The shadow of a round contact's rim grows over a still gel, 0.75 of a dot's contrast deep and some pixels wide at its
// edge: it takes a part of a dot's surroundings for the dot. Of the markers that stay valid 56 of 2482 are more than
// 2 px off (86 of 2520 before dragged ones were lost); a shadow that drags neighbours alike is not seen.
TEST(Tracker, LosesDotsThatAShadowDrags) {
  std::uniform_real_distribution<double> place(-16.0, 16.0);
  std::mt19937 random(71);
  int valid = 0, dragged = 0, all = 0;
  for (int round = 0; round < 40; ++round) {
    begin({}, scene::cropped_320x240());
    const Point middle{160.0 + place(random), 120.0 + place(random)};
    const double radius_px = 70.0 + place(random);
    for (int frame = 1; frame <= 5; ++frame) {
      Picture shown = picture({});
      for (int y = 0; y < shown.height; ++y) {
        for (int x = 0; x < shown.width; ++x) {
          const double inside = radius_px - distance(middle, {static_cast<double>(x), static_cast<double>(y)});
          const double depth = 0.47 * frame / 5.0 * (0.5 + 0.5 * std::tanh(inside / 2.0));
          std::uint8_t& level = shown.pixels[static_cast<std::size_t>(y * shown.width + x)];
          level = static_cast<std::uint8_t>(level * (1.0 - depth));
        }
      }
      CHECK_TRUE(show(shown).ok());
    }
    for (std::size_t i = 0; i < truth.size(); ++i) {
      ++all;
      if (!state->field.markers[i].valid) continue;
      ++valid;
      dragged += off(i) > 2.0 ? 1 : 0;
    }
  }
  CHECK_TRUE(valid * 100 >= all * 97);
  CHECK_TRUE(dragged * 100 <= valid * 3);
}

// Pressure enlarges dots: by a third of their area, and where they are. At the lattice's edge and corners fewer than
// four neighbours tell whether they moved; a search of the whole picture takes them as well.
TEST(Tracker, KeepsDotsThatOnlyGrow) {
  begin({}, wide_view());
  view.dot_diameter_mm *= 1.15;
  CHECK_TRUE(show(Warp{}).ok());
  LONGS_EQUAL(0, lost());
  nobody_swapped("larger dots");
  const std::uint32_t searches = state->searches;
  CHECK_TRUE(show(shifted(3.0, 2.0)).ok());
  LONGS_EQUAL(searches + 1, state->searches);
  LONGS_EQUAL(0, lost());
  nobody_swapped("larger dots after a jump");
}

TEST(Tracker, WaitsForALatticeAndSaysWhy) {
  for (const std::uint8_t level : {std::uint8_t{0}, std::uint8_t{120}, std::uint8_t{255}}) {
    LONGS_EQUAL(static_cast<int>(Reason::kTooFewDots), static_cast<int>(show(flat(320, 240, level)).reason));
    CHECK_FALSE(state->acquired);
  }
  config.grid.size = {8, 10};
  LONGS_EQUAL(static_cast<int>(Reason::kGridMismatch), static_cast<int>(show(Warp{}).reason));
  CHECK_TRUE((GridSize{7, 9}) == state->found);
  config.grid.size = {7, 9};
  CHECK_TRUE(show(Warp{}).ok());
  LONGS_EQUAL(0, lost());
}

TEST(Tracker, RegistersAnewAfterReset) {
  begin({}, wide_view());
  tracker::reset(*state);
  CHECK_TRUE(show(shifted(1.9, 1.1)).ok());
  LONGS_EQUAL(0, lost());
  nobody_swapped("after reset");
}

// Registered with holes: the marker comes in when the dirt is wiped off.
TEST(Tracker, TakesUpAMarkerThatWasMissingAtTheStart) {
  hidden = {0, 31};
  CHECK_TRUE(show(Warp{}).ok());
  LONGS_EQUAL(2, lost());
  tracker::set_home(*state, state->field);
  for (int k = 0; k < 15; ++k) {
    CHECK_TRUE(show(shifted(0.02 * k, 0.0)).ok());
    nobody_swapped("hole");
    LONGS_EQUAL(2, lost());
  }
  hidden.clear();
  for (int k = 0; k < 13; ++k) {
    CHECK_TRUE(show(shifted(0.2, 0.0)).ok());
    nobody_swapped("wiped");
  }
  LONGS_EQUAL(0, lost());
}
