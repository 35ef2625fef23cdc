// SPDX-License-Identifier: Apache-2.0
#include "tactile/reference.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <vector>

#include "tests/support/draw.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

constexpr std::int32_t kPitchQ8 = 8166;

PixelsQ8 raw(std::int32_t q8) {
  return PixelsQ8::from_raw(q8);
}

MarkerField lattice(GridSize grid = {7, 9}) {
  MarkerField field;
  field.grid = grid;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.cols; ++c) {
      field.markers[static_cast<std::size_t>(r * grid.cols + c)] = {raw(8000 + c * kPitchQ8), raw(6000 + r * kPitchQ8),
                                                                    true};
    }
  }
  return field;
}

MarkerField moved(MarkerField field, std::size_t marker, std::int32_t dx_q8, std::int32_t dy_q8) {
  Marker& m = field.markers[marker];
  m.x = raw(m.x.raw() + dx_q8);
  m.y = raw(m.y.raw() + dy_q8);
  return field;
}

}  // namespace

TEST_GROUP(ReferenceStage) {
  reference::State state;
  reference::Config config;
  bool update(const MarkerField& field) {
    return reference::update(state, config, field);
  }
};

TEST(ReferenceStage, LearnsWithTheLastFrameOfTheCountAndOnlyOnce) {
  for (const int frames : {1, 2, 10, 100}) {
    state = {};
    config.frames = frames;
    for (int k = 1; k < frames; ++k) CHECK_FALSE(update(lattice()));
    CHECK_FALSE(state.known);
    CHECK_TRUE(update(lattice()));
    CHECK_TRUE(state.known);
    LONGS_EQUAL(kPitchQ8, state.pitch.raw());
    CHECK_FALSE(update(moved(lattice(), 5, 4000, 0)));
    LONGS_EQUAL(8000, state.rest.markers[0].x.raw());
  }
}

// 192 / 256 px is still, one step more is touched: whichever marker, axis, sign and frame it is.
TEST(ReferenceStage, StartsAnewWhenAnyMarkerMoves) {
  for (const std::size_t marker : {std::size_t{0}, std::size_t{31}, std::size_t{62}}) {
    for (const auto& [dx, dy] : {std::pair{193, 0}, {-193, 0}, {0, 193}, {0, -193}}) {
      for (int at = 1; at < 10; ++at) {
        state = {};
        for (int k = 0; k < at; ++k) CHECK_FALSE(update(lattice()));
        // The frame that moved is the first of the new mean: nine more make ten.
        for (int k = 0; k < 9; ++k) CHECK_FALSE(update(moved(lattice(), marker, dx, dy)));
        CHECK_TRUE(update(moved(lattice(), marker, dx, dy)));
        LONGS_EQUAL(lattice().markers[marker].x.raw() + dx, state.rest.markers[marker].x.raw());
      }
    }
    state = {};
    for (int k = 0; k < 9; ++k) CHECK_FALSE(update(k % 2 == 0 ? lattice() : moved(lattice(), marker, 192, -192)));
    CHECK_TRUE(update(lattice()));
  }
}

// A gel that creeps 0.1 px a frame never rests, though no two neighbouring frames differ much.
TEST(ReferenceStage, DoesNotLearnASlowDrift) {
  for (int k = 0; k < 200; ++k) {
    MarkerField field = lattice();
    for (std::size_t i = 0; i < 63; ++i) field = moved(field, i, 26 * k, 0);
    CHECK_FALSE(update(field));
  }
}

// One marker that came and went on a dirty gel used to start the mean anew each time: REFERENCE for ever.
TEST(ReferenceStage, DoesNotWaitForAMarkerThatFlickers) {
  for (const std::size_t flickering : {std::size_t{1}, std::size_t{7}, std::size_t{40}}) {
    state = {};
    for (int k = 0; k < 10; ++k) {
      MarkerField field = lattice();
      for (std::size_t i = 0; i < flickering; ++i) field.markers[i].valid = (static_cast<std::size_t>(k) + i) % 2 == 0;
      CHECK_EQUAL(k == 9, update(field));
    }
    LONGS_EQUAL(63, state.rest.valid_count());
    LONGS_EQUAL(kPitchQ8, state.pitch.raw());
  }
}

// Half of the frames are enough for a rest position, fewer are not; at the first frame or the last makes no difference.
TEST(ReferenceStage, NeedsAMarkerInHalfOfItsFrames) {
  for (const int frames : {2, 3, 10, 11}) {
    config.frames = frames;
    for (int seen = 0; seen <= frames; ++seen) {
      for (const bool at_first : {true, false}) {
        state = {};
        for (int k = 0; k < frames; ++k) {
          MarkerField field = lattice();
          field.markers[7].valid = at_first ? k < seen : k >= frames - seen;
          // Where a lost marker was last guessed must not matter.
          if (!field.markers[7].valid) field.markers[7].x = field.markers[7].y = raw(-5000);
          CHECK_EQUAL(k == frames - 1, update(field));
        }
        CHECK_EQUAL(2 * seen >= frames, state.rest.markers[7].valid);
        LONGS_EQUAL(62 + (2 * seen >= frames ? 1 : 0), state.rest.valid_count());
        if (!state.rest.markers[7].valid) continue;
        LONGS_EQUAL(lattice().markers[7].x.raw(), state.rest.markers[7].x.raw());
        LONGS_EQUAL(lattice().markers[7].y.raw(), state.rest.markers[7].y.raw());
      }
    }
  }
}

// The mean in double over the frames in which each marker was seen, with dropouts at random: sums are exact, so a place
// is rounded once. The pitch is that of all links: the roots of their lengths are cut off (1 step), their mean is
// rounded (0.5).
TEST(ReferenceStage, IsTheMeanOfTheFramesInWhichAMarkerWasSeen) {
  test::Draw draw(82);
  config.still = raw(PixelsQ8::kMax);
  config.most_bend_permille = 0;  // no gel has these places
  for (int round = 0; round < 1000; ++round) {
    state = {};
    config.frames = draw.of32(1, 12);
    const GridSize grid = draw.one_of(std::array<GridSize, 4>{{{7, 9}, {3, 3}, {1, 2}, {8, 16}}});
    const std::size_t count = idx(grid.count());
    const auto spread = draw.one_of(std::array{1, 96, 20'000, PixelsQ8::kMax / 2});
    const auto place = [&](std::int32_t around) { return draw.of32(around - spread, around + spread); };
    std::vector<std::int32_t> home_x(count), home_y(count);
    for (std::size_t i = 0; i < count; ++i) {
      home_x[i] = draw.of32(-PixelsQ8::kMax / 2, PixelsQ8::kMax / 2);
      home_y[i] = draw.of32(-PixelsQ8::kMax / 2, PixelsQ8::kMax / 2);
    }
    std::vector<double> sum_x(count), sum_y(count);
    std::vector<int> seen(count);
    for (int frame = 0; frame < config.frames; ++frame) {
      MarkerField field;
      field.grid = grid;
      for (std::size_t i = 0; i < count; ++i) {
        field.markers[i] = {raw(place(home_x[i])), raw(place(home_y[i])), !draw.one_in(4)};
        if (!field.markers[i].valid) continue;
        sum_x[i] += field.markers[i].x.raw();
        sum_y[i] += field.markers[i].y.raw();
        ++seen[i];
      }
      (void)update(field);
    }
    const auto& rest = state.rest.markers;
    for (std::size_t i = 0; i < count; ++i) {
      CHECK_EQUAL(seen[i] > 0 && 2 * seen[i] >= config.frames, rest[i].valid);
      if (!rest[i].valid) continue;
      DOUBLES_EQUAL(sum_x[i] / seen[i], rest[i].x.raw(), 0.5 + 1e-6);
      DOUBLES_EQUAL(sum_y[i] / seen[i], rest[i].y.raw(), 0.5 + 1e-6);
    }
    double length = 0.0;
    int links = 0;
    const auto add = [&](std::size_t a, std::size_t b) {
      if (!rest[a].valid || !rest[b].valid) return;
      length += std::hypot(rest[a].x.raw() - rest[b].x.raw(), rest[a].y.raw() - rest[b].y.raw());
      ++links;
    };
    for (std::size_t i = 0; i < count; ++i) {
      if (i % grid.cols + 1 < grid.cols) add(i, i + 1);
      if (i + grid.cols < count) add(i, i + grid.cols);
    }
    const std::int32_t pitch = reference::pitch_of(state.rest).raw();
    if (links == 0) LONGS_EQUAL(0, pitch);
    if (links > 0) DOUBLES_EQUAL(std::min<double>(length / links, PixelsQ8::kMax) - 0.5, pitch, 1.0 + 1e-6);
    CHECK_EQUAL(pitch > 0, state.known);
  }
}

// A marker that is away while it is pushed is touched all the same: it comes back at another place.
TEST(ReferenceStage, StartsAnewWhenAFlickeringMarkerComesBackElsewhere) {
  MarkerField away = lattice();
  away.markers[7].valid = false;
  for (const std::int32_t push : {192, 193}) {
    state = {};
    for (int k = 0; k < 4; ++k) CHECK_FALSE(update(lattice()));
    for (int k = 0; k < 4; ++k) CHECK_FALSE(update(away));
    const MarkerField back = moved(lattice(), 7, push, 0);
    CHECK_FALSE(update(back));
    if (push == 192) {
      CHECK_TRUE(update(back));
      continue;
    }
    for (int k = 0; k < 8; ++k) CHECK_FALSE(update(back));
    CHECK_TRUE(update(back));
    LONGS_EQUAL(lattice().markers[7].x.raw() + push, state.rest.markers[7].x.raw());
  }
}

// The same for one that was not there at first: where it was seen first is what it is compared with.
TEST(ReferenceStage, StartsAnewWhenAMarkerThatCameLateMoves) {
  MarkerField field = lattice();
  field.markers[7].valid = false;
  field.markers[7].x = raw(0);  // a guess, far off
  for (int k = 0; k < 4; ++k) CHECK_FALSE(update(field));
  for (int k = 0; k < 4; ++k) CHECK_FALSE(update(lattice()));
  for (int k = 0; k < 9; ++k) CHECK_FALSE(update(moved(lattice(), 7, 0, -193)));
  CHECK_TRUE(update(moved(lattice(), 7, 0, -193)));
}

TEST(ReferenceStage, StartsAnewForAnotherLattice) {
  for (int k = 0; k < 9; ++k) CHECK_FALSE(update(lattice()));
  for (int k = 0; k < 9; ++k) CHECK_FALSE(update(lattice({8, 10})));
  CHECK_TRUE(update(lattice({8, 10})));
  CHECK_TRUE((GridSize{8, 10}) == state.rest.grid);
}

TEST(ReferenceStage, LearnsAgainAfterForget) {
  config.frames = 3;
  for (int k = 0; k < 3; ++k) (void)update(lattice());
  CHECK_TRUE(state.known);
  reference::forget(state);
  CHECK_FALSE(state.known);
  MarkerField field = lattice();
  for (std::size_t i = 0; i < 63; ++i) field = moved(field, i, 300, 0);
  CHECK_FALSE(update(field));
  CHECK_FALSE(update(field));
  CHECK_TRUE(update(field));
  LONGS_EQUAL(8300, state.rest.markers[0].x.raw());
}

// Against double: a field of independent offsets of sigma s bends by s sqrt(1 + 4 + 1). Whole thousandths, and the root
// is cut: one below.
TEST(ReferenceStage, BendIsTheRootMeanSquareOfTheSecondDifferences) {
  std::mt19937 random(91);
  for (int round = 0; round < 50; ++round) {
    std::uniform_int_distribution<std::int32_t> offset(-40 * round, 40 * round);
    MarkerField field = lattice({7, 10});
    for (std::size_t i = 0; i < 70; ++i) field = moved(field, i, offset(random), offset(random));
    if (round % 2 == 1) field.markers[33].valid = false;
    double sum = 0.0;
    int terms = 0;
    const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
      const auto& m = field.markers;
      if (!m[a].valid || !m[b].valid || !m[c].valid) return;
      const double x = m[a].x.raw() - 2.0 * m[b].x.raw() + m[c].x.raw();
      const double y = m[a].y.raw() - 2.0 * m[b].y.raw() + m[c].y.raw();
      sum += x * x + y * y;
      terms += 2;
    };
    for (std::size_t r = 0; r < 7; ++r) {
      for (std::size_t c = 0; c < 10; ++c) {
        if (c < 8) add(10 * r + c, 10 * r + c + 1, 10 * r + c + 2);
        if (r < 5) add(10 * r + c, 10 * r + c + 10, 10 * r + c + 20);
      }
    }
    const double want = std::sqrt(sum / terms) * 1000.0 / reference::pitch_of(field).raw();
    DOUBLES_EQUAL(want, reference::bend_permille(field), 1.2);
  }
  LONGS_EQUAL(0, reference::bend_permille(lattice()));
  LONGS_EQUAL(0, reference::bend_permille(MarkerField{}));
  MarkerField point = lattice();
  for (Marker& marker : point.markers) marker = {PixelsQ8::from_raw(256), PixelsQ8::from_raw(256), true};
  LONGS_EQUAL(0, reference::bend_permille(point));  // no pitch
}

// A lattice that a ball presses apart in its middle is refused for as long as it is pressed; what is learned is the
// empty gel afterwards. Shear, turning and scale bend nothing. Whoever confirms it gets what he asked for.
TEST(ReferenceStage, RefusesABentLatticeUnlessItIsConfirmed) {
  const auto pressed = [](double by_pitches) {
    MarkerField field = lattice();
    for (int r = 0; r < 7; ++r) {
      for (int c = 0; c < 9; ++c) {
        const double x = c - 4.0, y = r - 3.0;
        const double out = by_pitches * kPitchQ8 * std::exp(-(x * x + y * y) / 4.5);
        field = moved(field, static_cast<std::size_t>(9 * r + c), static_cast<std::int32_t>(out * x),
                      static_cast<std::int32_t>(out * y));
      }
    }
    return field;
  };
  CHECK_TRUE(reference::bend_permille(pressed(0.6)) > config.most_bend_permille);
  for (int k = 0; k < 100; ++k) {
    CHECK_FALSE(update(pressed(0.6)));
    CHECK_EQUAL(k >= 9, state.bent);
  }
  for (int k = 1; k <= 10; ++k) CHECK_EQUAL(k == 10, update(lattice()));
  CHECK_FALSE(state.bent);
  LONGS_EQUAL(8000, state.rest.markers[0].x.raw());

  MarkerField sheared = lattice();
  for (int i = 0; i < 63; ++i) sheared = moved(sheared, static_cast<std::size_t>(i), 900 * (i / 9), 500 * (i % 9));
  reference::forget(state);
  for (int k = 1; k <= 10; ++k) CHECK_EQUAL(k == 10, update(sheared));

  reference::forget(state);
  state.confirmed = true;
  for (int k = 1; k <= 10; ++k) CHECK_EQUAL(k == 10, update(pressed(0.6)));
  CHECK_TRUE(state.known);
}

// Nothing to learn from: no markers, or none beside another. It must not claim a reference, nor divide by zero; and it
// learns from the next frames as if nothing had been.
TEST(ReferenceStage, LearnsNothingWithoutNeighbours) {
  config.frames = 2;
  MarkerField field = lattice();
  for (std::size_t i = 0; i < 63; ++i) field.markers[i].valid = false;
  for (int k = 0; k < 5; ++k) CHECK_FALSE(update(field));
  field.markers[0].valid = true;
  for (int k = 0; k < 5; ++k) CHECK_FALSE(update(field));
  CHECK_FALSE(state.known);
  CHECK_FALSE(update(lattice()));
  CHECK_TRUE(update(lattice()));
}

// All markers a little aside, as when the gel warms: the rest position comes after them, in steps of a quarter, and the
// last quarter of a step stays (a Q8 step is 1/256 px).
TEST(ReferenceStage, FollowsTheDriftOfAnEmptyGel) {
  config.frames = 1;
  CHECK_TRUE(update(lattice()));
  MarkerField field = lattice();
  for (std::size_t i = 0; i < 63; ++i) field = moved(field, i, 20, -12);
  int steps = 0;
  for (int k = 0; k < 20 * config.follow_frames; ++k) steps += reference::follow(state, config, field) ? 1 : 0;
  CHECK_TRUE(steps > 3 && steps < 20);
  for (std::size_t i = 0; i < 63; ++i) {
    CHECK_TRUE(std::abs(state.rest.markers[i].x.raw() - lattice().markers[i].x.raw() - 20) <= 2);
    CHECK_TRUE(std::abs(state.rest.markers[i].y.raw() - lattice().markers[i].y.raw() + 12) <= 2);
  }
}

// Every 64 frames by a quarter of what is left: 20, 15, 11 to the right; 12, 9, 7 up.
TEST(ReferenceStage, FollowsByAQuarter) {
  config.frames = 1;
  CHECK_TRUE(update(lattice()));
  const MarkerField field = moved(lattice(), 30, 20, -12);
  for (const auto& [x, y] : {std::pair{5, -3}, {9, -5}}) {
    for (int k = 1; k <= 64; ++k) CHECK_EQUAL(k == 64, reference::follow(state, config, field));
    LONGS_EQUAL(lattice().markers[30].x.raw() + x, state.rest.markers[30].x.raw());
    LONGS_EQUAL(lattice().markers[30].y.raw() + y, state.rest.markers[30].y.raw());
  }
}

// A touch that nobody noticed moves it by 1/32 px in 64 frames at most, and a shear that goes on no further than 0.1
// mm.
TEST(ReferenceStage, FollowsSlowlyAndNotFar) {
  config.frames = 1;
  CHECK_TRUE(update(lattice()));
  const MarkerField far = moved(lattice(), 30, 5000, 0);
  std::int32_t before = state.rest.markers[30].x.raw();
  for (int k = 0; k < 200 * config.follow_frames; ++k) {
    const bool stepped = reference::follow(state, config, far);
    const std::int32_t now = state.rest.markers[30].x.raw();
    CHECK_TRUE(now - before <= 8 && (stepped || now == before));
    before = now;
  }
  LONGS_EQUAL(kPitchQ8 / 20, before - lattice().markers[30].x.raw());
  LONGS_EQUAL(lattice().markers[31].x.raw(), state.rest.markers[31].x.raw());
}

// A marker follows what was seen of itself: in half of the frames at least, and from a rest position that it has. All
// of it along y, and wherever a hidden one was guessed.
TEST(ReferenceStage, FollowsMarkersThatWereSeenInHalfOfTheFrames) {
  config.frames = 1;
  for (const int hidden : {config.follow_frames / 2, config.follow_frames / 2 + 1}) {
    state = {};
    MarkerField learned = lattice();
    learned.markers[7].valid = false;
    CHECK_TRUE(update(learned));
    for (int k = 1; k <= config.follow_frames; ++k) {
      MarkerField field = lattice();
      for (std::size_t i = 0; i < 63; ++i) field = moved(field, i, 0, 40);
      if (k <= hidden) field.markers[30] = {raw(-5000), raw(-5000), false};
      CHECK_EQUAL(k == config.follow_frames, reference::follow(state, config, field));
    }
    const auto gone_px_q8 = [&](std::size_t i) { return state.rest.markers[i].y.raw() - lattice().markers[i].y.raw(); };
    LONGS_EQUAL(8, gone_px_q8(31));
    LONGS_EQUAL(0, gone_px_q8(7));
    LONGS_EQUAL(hidden * 2 <= config.follow_frames ? 8 : 0, gone_px_q8(30));
    for (std::size_t i = 0; i < 63; ++i) LONGS_EQUAL(lattice().markers[i].x.raw(), state.rest.markers[i].x.raw());
  }
}

// Before there is a rest position nothing can drift from it, and the mean that is being learned is not that of a drift.
TEST(ReferenceStage, NeitherFollowsNorForgetsWhileItLearns) {
  config.frames = 3;
  CHECK_FALSE(update(lattice()));
  reference::pause(state);
  CHECK_FALSE(reference::follow(state, config, lattice()));
  CHECK_FALSE(update(lattice()));
  CHECK_TRUE(update(lattice()));
}

// Only an unbroken run of empty frames counts: a touch in its middle begins it anew.
TEST(ReferenceStage, ForgetsTheMeanWhenSomethingTouches) {
  config.frames = 1;
  CHECK_TRUE(update(lattice()));
  const MarkerField aside = moved(lattice(), 30, 100, 0);
  for (int k = 0; k < 50; ++k) {
    for (int frame = 0; frame + 1 < config.follow_frames; ++frame) {
      CHECK_FALSE(reference::follow(state, config, aside));
    }
    reference::pause(state);
  }
  LONGS_EQUAL(lattice().markers[30].x.raw(), state.rest.markers[30].x.raw());
  CHECK_FALSE(reference::follow(state, config, lattice({8, 10})));
}
