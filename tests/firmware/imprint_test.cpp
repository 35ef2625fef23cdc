// SPDX-License-Identifier: Apache-2.0
// Oracles: the definitions in double (support/imprint_reference.hpp), and pictures of a relief that moves a known way.
#include "tactile/imprint.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "base/math.hpp"
#include "tests/support/imprint_reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

constexpr double kPitch_mm = 2.02;

struct Mm {
  double x = 0.0;
  double y = 0.0;
};

// A gel as the camera sees it: dots of 1.05 mm on a lattice in the middle of the picture, and a relief in levels.
struct Gel {
  GridSize grid{7, 9};
  double px_per_mm = 15.8;
  int width = 320;
  int height = 240;
  double noise = 0.0;  // sigma, levels
  std::function<double(Mm)> relief = [](Mm) { return 0.0; };
  Mm dots{};                                             // where all dots have moved
  std::function<Mm(Mm)> bend = [](Mm) { return Mm{}; };  // and each of them by itself, from its rest position
  std::vector<int> lost{};
  std::vector<int> without_rest{};  // not there when the rest position was learned; guessed far off

  [[nodiscard]] Mm rest_of(int marker) const {
    const int row = marker / grid.cols;
    return {(marker % grid.cols - (grid.cols - 1) / 2.0) * kPitch_mm, (row - (grid.rows - 1) / 2.0) * kPitch_mm};
  }
  [[nodiscard]] MarkerField field(Mm moved) const {
    MarkerField out;
    out.grid = grid;
    for (int i = 0; i < grid.count(); ++i) {
      const Mm rest = rest_of(i);
      const Mm own = bend(rest);
      const Mm at{rest.x + own.x, rest.y + own.y};
      const auto px = [&](double mm, int size) {
        return PixelsQ8::from_raw(static_cast<int>(std::lround(256.0 * (mm * px_per_mm + (size - 1) / 2.0))));
      };
      out.markers[idx(i)] = {px(at.x + moved.x, width), px(at.y + moved.y, height), true};
    }
    for (const int i : lost) out.markers[idx(i)].valid = false;
    return out;
  }
  [[nodiscard]] PixelsQ8 pitch() const {
    return PixelsQ8::from_raw(static_cast<int>(std::lround(256.0 * kPitch_mm * px_per_mm)));
  }
  [[nodiscard]] std::vector<std::uint8_t> picture(std::mt19937& random) const {
    std::normal_distribution<double> normal(0.0, 1.0);
    std::vector<std::uint8_t> out;
    out.reserve(static_cast<std::size_t>(width * height));
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const Mm at{(x - (width - 1) / 2.0) / px_per_mm, (y - (height - 1) / 2.0) / px_per_mm};
        const auto nearest = [](double from, int count) {
          const double first = -(count - 1) / 2.0;
          return (std::clamp(std::round(from / kPitch_mm - first), 0.0, count - 1.0) + first) * kPitch_mm;
        };
        const Mm own = bend({at.x - dots.x, at.y - dots.y});  // near enough where it is much less than a pitch
        const Mm from{at.x - dots.x - own.x, at.y - dots.y - own.y};
        const double dx = from.x - nearest(from.x, grid.cols);
        const double dy = from.y - nearest(from.y, grid.rows);
        const double dot = 1.0 / (1.0 + std::exp((std::hypot(dx, dy) - 0.525) / 0.03));
        const double level = (120.0 + relief(at)) * (1.0 - dot) + 45.0 * dot + noise * normal(random);
        out.push_back(static_cast<std::uint8_t>(std::clamp(std::lround(level), 0L, 255L)));
      }
    }
    return out;
  }
};

// Waves of 1.3 to 2 mm in 8 directions, about `levels` RMS: no direction of its own.
std::function<double(Mm)> grain(double levels, Mm moved = {}) {
  return [=](Mm at) {
    double sum = 0.0;
    for (int k = 0; k < 8; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / 8.0;
      const double number = 2.0 * std::numbers::pi / (1.3 + 0.1 * ((k * 3) % 8));
      sum += std::sin(number * (std::cos(angle) * (at.x - moved.x) + std::sin(angle) * (at.y - moved.y)) + 1.7 * k * k);
    }
    return levels * sum / 2.0;
  };
}

// Waves along x only.
std::function<double(Mm)> ribs(double levels, double wavelength_mm, Mm moved = {}) {
  return [=](Mm at) { return levels * std::sin(2.0 * std::numbers::pi / wavelength_mm * (at.x - moved.x)); };
}

// Motion of the header's formula, from the relief itself: no picture, no dots, no pixels. What the camera's smoothing
// takes it takes from change and gradient alike.
double motion_of(const Gel& gel, const std::function<double(Mm)>& then, const std::function<double(Mm)>& now) {
  constexpr double kStep_mm = kPitch_mm / imprint::kStepsPerPitch;
  double change = 0.0, energy = 0.0;
  for (int dot = 0; dot < gel.grid.count(); ++dot) {
    for (const int sx : {1, -1}) {
      for (const int sy : {1, -1}) {
        const auto at = [&](const std::function<double(Mm)>& relief, double a, double b) {
          const Mm from = gel.rest_of(dot);
          return relief({from.x + sx * (a + 0.5) * kStep_mm, from.y + sy * (b + 0.5) * kStep_mm});
        };
        double sum = 0.0, squares = 0.0;
        for (int b = 0; b < imprint::kSide; ++b) {
          for (int a = 0; a < imprint::kSide; ++a) {
            if (!imprint::is_free(a, b)) continue;
            const double r = at(now, a, b) - at(then, a, b);
            sum += r;
            squares += r * r;
            if (imprint::is_free(a + 1, b)) energy += std::pow(at(now, a + 1, b) - at(now, a, b), 2);
            if (imprint::is_free(a, b + 1)) energy += std::pow(at(now, a, b + 1) - at(now, a, b), 2);
          }
        }
        change += (squares - sum * sum / imprint::kFree) / imprint::kFree;
      }
    }
  }
  return 1e3 * kStep_mm * std::sqrt(change / (energy / imprint::kPairs));
}

// Firmware and reference side by side.
struct Bench {
  explicit Bench(Gel empty_gel, bool compare = false, int seed = 1)
      : gel(std::move(empty_gel)), random(static_cast<unsigned>(seed)), compares(compare) {
    const std::vector<std::uint8_t> pixels = gel.picture(random);
    for (int k = 0; k < 12; ++k) (void)step(gel.noise > 0.0 ? gel.picture(random) : pixels, true);
  }

  ImprintFeatures step(bool empty = false) { return step(gel.picture(random), empty); }
  ImprintFeatures step(const std::vector<std::uint8_t>& pixels, bool empty) {
    const LumaView view{pixels.data(), gel.width, gel.height, gel.width};
    const MarkerField now = gel.field(gel.dots);
    Gel still = gel;
    still.bend = Gel{}.bend;
    MarkerField home = still.field({});
    for (Marker& marker : home.markers) marker.valid = true;
    for (const int i : gel.without_rest) {
      home.markers[idx(i)] = {PixelsQ8::from_raw(-200'000), PixelsQ8::from_raw(200'000), false};
    }
    time += Micros{std::llround(1e6 / fps)};
    if (compares) {
      expected = reference.update(view, now, home, gel.pitch(), empty, static_cast<double>(time.count()) * 1e-6);
    }
    return imprint::update(*state, config, view, now, home, gel.pitch(), empty, time, saturations);
  }
  // `frames` of the same picture, noise and all; the last one's features.
  ImprintFeatures wait(int frames) {
    const std::vector<std::uint8_t> pixels = gel.picture(random);
    ImprintFeatures last{};
    for (int k = 0; k < frames; ++k) last = step(pixels, false);
    return last;
  }

  Gel gel;
  std::mt19937 random;
  bool compares;
  double fps = 25.0;
  Micros time{0};
  imprint::Config config;
  std::unique_ptr<imprint::State> state = std::make_unique<imprint::State>();
  Saturations saturations;
  std::unique_ptr<test::ImprintReference> reference_memory = std::make_unique<test::ImprintReference>(config);
  test::ImprintReference& reference = *reference_memory;
  test::ImprintReference::Seen expected;
};

std::int64_t usable(const imprint::State& state) {
  return std::count_if(state.frames.begin(), state.frames.end(), [](const imprint::Frame& f) { return f.usable; });
}

double um(Log2Q8 motion) {
  return std::exp2(motion.raw() / 256.0);
}

// Ribs on an empty gel's picture that move by 0.08 mm: as much as that is in these patches.
void sees_ribs_move(Bench& bench) {
  bench.gel.relief = ribs(12.0, 2.4);
  (void)bench.wait(8);
  bench.gel.relief = ribs(12.0, 2.4, {0.08, 0.0});
  const double expected = motion_of(bench.gel, ribs(12.0, 2.4), ribs(12.0, 2.4, {0.08, 0.0}));
  DOUBLES_EQUAL(expected, um(bench.step().motion), 0.1 * expected);
}

}  // namespace

TEST_GROUP(Imprint){};

TEST(Imprint, EmptyGelShowsNothing) {
  Gel gel;
  gel.noise = 2.5;
  Bench bench(gel);
  for (int k = 0; k < 30; ++k) {
    const ImprintFeatures seen = bench.step(true);
    CHECK(seen.patches.raw() < bench.config.least_patches);
    LONGS_EQUAL(0, seen.motion.raw());
  }
}

// 8 %: the regularisation takes 3, pixels of 0.127 mm the rest.
TEST(Imprint, ShiftOfAReliefIsWhatTheFormulaSays) {
  const std::vector<std::function<std::function<double(Mm)>(Mm)>> reliefs{
      [](Mm moved) { return ribs(12.0, 1.2, moved); }, [](Mm moved) { return ribs(12.0, 2.4, moved); },
      [](Mm moved) { return grain(10.0, moved); }};
  for (const auto& relief : reliefs) {
    for (const Mm shift : {Mm{0.03, 0.0}, Mm{0.08, 0.0}, Mm{-0.06, 0.08}}) {
      Gel gel;
      Bench bench(gel);
      bench.gel.relief = relief({});
      (void)bench.wait(20);
      bench.gel.relief = relief(shift);
      const ImprintFeatures seen = bench.step();
      CHECK(seen.patches.raw() > 200);
      const double expected = motion_of(gel, relief({}), relief(shift));
      DOUBLES_EQUAL(expected, um(seen.motion), 0.08 * expected + 1.0);
      DOUBLES_EQUAL(um(seen.motion), um(seen.motion_short), 1.0);
      DOUBLES_EQUAL(um(seen.motion), um(seen.motion_long), 1.0);
    }
  }
}

// Along its waves, if they are short against a patch, a relief moves by its own length.
TEST(Imprint, ShortWavesMoveByTheirLength) {
  const Gel gel;
  DOUBLES_EQUAL(50.0, motion_of(gel, ribs(12.0, 1.0), ribs(12.0, 1.0, {0.05, 0.0})), 5.0);
}

TEST(Imprint, WhatMovesWithTheGelDoesNotMove) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = grain(10.0);
  (void)bench.wait(20);
  for (int k = 1; k <= 20; ++k) {  // up to 1 mm, half of the pitch
    bench.gel.dots = {0.05 * k, -0.03 * k};
    bench.gel.relief = grain(10.0, bench.gel.dots);
    const ImprintFeatures seen = bench.step();
    CHECK(seen.patches.raw() > 150);
    CHECK(um(seen.motion) < 15.0);  // interpolation between pixels of 0.127 mm
  }
  // The same relief left behind: as far as the gel goes.
  Bench slips(gel);
  slips.gel.relief = grain(10.0);
  (void)slips.wait(20);
  slips.gel.dots = {0.1, 0.0};
  const double expected = motion_of(gel, grain(10.0), grain(10.0, {0.1, 0.0}));
  DOUBLES_EQUAL(expected, um(slips.step().motion), 0.1 * expected);
}

// Beside a contact the gel bends within a pitch, and what rides on it between the dots is not where they say. That is
// no slip; a slip on top of it still is.
TEST(Imprint, GelThatBendsBetweenTheDotsIsNoMotion) {
  const auto wave = [](Mm at) { return Mm{0.2 * std::sin(2.0 * std::numbers::pi / 4.5 * at.x), 0.0}; };
  Gel gel;
  const auto seen_after = [&](Mm slip) {
    Bench now(gel);
    now.gel.relief = grain(10.0);
    (void)now.wait(20);
    now.gel.bend = wave;
    now.gel.relief = [=, still = grain(10.0)](Mm at) {
      const Mm own = wave(at);
      return still({at.x - own.x - slip.x, at.y - own.y - slip.y});
    };
    return um(now.step().motion);
  };
  const double stuck = seen_after({});
  const double slipped = seen_after({0.4, 0.0});
  CHECK_TEXT(stuck < 20.0, std::to_string(stuck).c_str());  // 58 if the bend were not taken off
  CHECK_TEXT(slipped > 80.0, std::to_string(slipped).c_str());
}

TEST(Imprint, FlatLightIsNoTextureAndLightThatChangesIsNoMotion) {
  Gel gel;
  gel.noise = 1.0;
  Bench bench(gel);
  for (int k = 0; k < 20; ++k) {
    bench.gel.relief = [k](Mm) { return 2.0 * k; };
    const ImprintFeatures seen = bench.step();
    LONGS_EQUAL(0, seen.patches.raw());
    LONGS_EQUAL(0, seen.motion.raw());
  }
  Bench held(gel);
  for (int k = 0; k < 40; ++k) {
    held.gel.relief = [k, relief = grain(10.0)](Mm at) { return relief(at) + 0.5 * k; };
    const double moved = um(held.step().motion);
    if (k > 6) CHECK_TEXT(moved < 25.0, std::to_string(moved).c_str());  // before it has just been pressed on
  }
}

TEST(Imprint, SameForEveryScaleOfThePicture) {
  for (const auto& [width, height, px_per_mm] :
       {std::array{320.0, 240.0, 15.8}, {410.0, 308.0, 14.43}, {820.0, 616.0, 28.87}, {1640.0, 1232.0, 57.74}}) {
    Gel gel;
    gel.width = static_cast<int>(width);
    gel.height = static_cast<int>(height);
    gel.px_per_mm = px_per_mm;
    Bench bench(gel);
    sees_ribs_move(bench);
  }
}

// A large lattice of a small pitch covers more reduced pixels than there is memory for: reduced once more, to 11 a
// pitch, it shows the same.
TEST(Imprint, ALatticeTooLargeForTheMemoryIsReducedOnceMore) {
  Gel gel;
  gel.grid = {8, 16};
  gel.width = 820;
  gel.height = 616;
  gel.px_per_mm = 22.2 / kPitch_mm;
  Bench bench(gel);
  LONGS_EQUAL(1, bench.state->picture.reduction_log2);
  LONGS_EQUAL(4 * 64, usable(*bench.state));  // of every second dot
  CHECK(bench.state->picture.width * bench.state->picture.height <= imprint::kMaxReducedPixels);
  sees_ribs_move(bench);
}

TEST(Imprint, TheLargestGridSoldHasPatchesAtEveryDot) {
  Gel gel;
  gel.grid = {8, 10};
  gel.px_per_mm = 14.0;
  Bench bench(gel);
  LONGS_EQUAL(4 * 80, usable(*bench.state));
  sees_ribs_move(bench);
}

// Two pitches around the lattice, whichever of its corners sticks out, in whole boxes; cut at the picture's edges.
TEST(Imprint, OnlyWhatTheLatticeCanReachIsReduced) {
  for (const auto& [width, height, pitch_px, side] :
       {std::array{320, 240, 20, 1}, {200, 150, 20, 1}, {640, 480, 33, 2}, {321, 241, 33, 2}}) {
    for (const int corner : {0, 8, 54, 62}) {
      Gel gel;
      gel.width = width;
      gel.height = height;
      gel.px_per_mm = pitch_px / kPitch_mm;
      MarkerField rest = gel.field({});
      Marker& out = rest.markers[idx(corner)];
      out.x = PixelsQ8::from_raw(out.x.raw() + (corner % 9 == 0 ? -2'560 : 2'560));
      out.y = PixelsQ8::from_raw(out.y.raw() + (corner < 9 ? -2'560 : 2'560));
      double left = 1e9, top = 1e9, right = -1e9, bottom = -1e9;
      for (int i = 0; i < gel.grid.count(); ++i) {
        const double x = rest.markers[idx(i)].x.raw() / 256.0, y = rest.markers[idx(i)].y.raw() / 256.0;
        left = std::min(left, x - 2 * pitch_px);
        top = std::min(top, y - 2 * pitch_px);
        right = std::max(right, x + 2 * pitch_px);
        bottom = std::max(bottom, y + 2 * pitch_px);
      }
      const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width * height), 200);
      auto state = std::make_unique<imprint::State>();
      Saturations saturations;
      (void)imprint::update(*state, {}, {pixels.data(), width, height, width}, rest, rest, gel.pitch(), true,
                            Micros{40'000}, saturations);
      const auto boxes = [side = side](double px) { return static_cast<int>(std::floor(px)) / side; };
      LONGS_EQUAL(boxes(std::max(left, 0.0)), state->picture.left);
      LONGS_EQUAL(boxes(std::max(top, 0.0)), state->picture.top);
      LONGS_EQUAL(boxes(std::min(right + 1.0, double(width))), state->picture.left + state->picture.width);
      LONGS_EQUAL(boxes(std::min(bottom + 1.0, double(height))), state->picture.top + state->picture.height);
    }
  }
}

// 11 to 23 pixels a pitch, up to 16 from one; light that is the same everywhere stays as it is, 16 times.
TEST(Imprint, ReducedByPowersOfTwo) {
  for (const double pitch_px : {8.0, 20.0, 22.6, 22.7, 40.0, 45.2, 45.3, 90.0, 91.0, 180.0, 182.0, 360.0, 370.0}) {
    Gel gel;
    gel.grid = {3, 3};
    gel.width = std::min(1640, static_cast<int>(8 * pitch_px));
    gel.height = std::min(1232, static_cast<int>(8 * pitch_px));
    gel.px_per_mm = pitch_px / kPitch_mm;
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(gel.width * gel.height), 255);
    auto state = std::make_unique<imprint::State>();
    Saturations saturations;
    (void)imprint::update(*state, {}, {pixels.data(), gel.width, gel.height, gel.width}, gel.field({}), gel.field({}),
                          gel.pitch(), true, Micros{40'000}, saturations);
    const imprint::Reduced& reduced = state->picture;
    LONGS_EQUAL(std::clamp(std::lround(std::log2(pitch_px / 16.0)), 0L, 4L), reduced.reduction_log2);
    for (int i = 0; i < reduced.width * reduced.height; ++i) LONGS_EQUAL(16 * 255, reduced.pixels[idx(i)]);
    for (int p = 0; p < 4 * gel.grid.count(); ++p) {
      CHECK(state->last.seen[idx(p)]);
      for (const std::int16_t sample : state->last.samples[idx(p)]) LONGS_EQUAL(16 * 255, sample);
    }
  }
}

// Means of boxes, then 1-2-1 both ways, the edges repeated. Rounded once, to nearest; boxes of 4x4 pixels and more once
// before, to a quarter of a level.
TEST(Imprint, ReducedPixelsAreSmoothedMeansOfBoxes) {
  std::mt19937 random(4);
  for (const int side : {1, 2, 4, 8, 16}) {
    Gel gel;
    gel.grid = {2, 3};
    gel.width = 90 * side;
    gel.height = 70 * side;
    gel.px_per_mm = 16.0 * side / kPitch_mm;
    std::vector<std::uint8_t> pixels(static_cast<std::size_t>(gel.width * gel.height));
    for (std::uint8_t& pixel : pixels) pixel = static_cast<std::uint8_t>(random());
    auto state = std::make_unique<imprint::State>();
    Saturations saturations;
    (void)imprint::update(*state, {}, {pixels.data(), gel.width, gel.height, gel.width}, gel.field({}), gel.field({}),
                          gel.pitch(), true, Micros{40'000}, saturations);
    const imprint::Reduced& reduced = state->picture;
    std::vector<double> boxes(static_cast<std::size_t>(reduced.width * reduced.height));
    for (int y = 0; y < reduced.height * side; ++y) {
      for (int x = 0; x < reduced.width * side; ++x) {
        const int pixel = pixels[idx((reduced.top * side + y) * gel.width + reduced.left * side + x)];
        boxes[idx(y / side * reduced.width + x / side)] += pixel / double(side * side);
      }
    }
    for (int y = 0; y < reduced.height; ++y) {
      for (int x = 0; x < reduced.width; ++x) {
        double want = 0.0;
        for (int v = -1; v <= 1; ++v) {
          for (int u = -1; u <= 1; ++u) {
            const int row = std::clamp(y + v, 0, reduced.height - 1), col = std::clamp(x + u, 0, reduced.width - 1);
            want += (2 - std::abs(v)) * (2 - std::abs(u)) * boxes[idx(row * reduced.width + col)];
          }
        }
        DOUBLES_EQUAL(want, reduced.pixels[idx(y * reduced.width + x)], side <= 2 ? 0.5 : 2.5);
      }
    }
  }
}

// At every scale: a box's centre lies between its pixels. Rounding: a 4096th for the place, half of one for each step.
TEST(Imprint, APatchBeginsHalfAStepFromItsDot) {
  for (const int side : {1, 2, 4, 8, 16}) {
    Gel gel;
    gel.grid = {2, 2};
    gel.width = gel.height = 70 * side;
    gel.px_per_mm = 16.0 * side / kPitch_mm;
    const MarkerField rest = gel.field({});
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(gel.width * gel.height), 200);
    auto state = std::make_unique<imprint::State>();
    Saturations saturations;
    (void)imprint::update(*state, {}, {pixels.data(), gel.width, gel.height, gel.width}, rest, rest, gel.pitch(), true,
                          Micros{40'000}, saturations);
    LONGS_EQUAL(side, 1 << state->picture.reduction_log2);
    for (int p = 0; p < 16; ++p) {
      const Marker& dot = rest.markers[idx(p / 4)];
      const auto want = [&](int q8, int towards, int origin) {
        return (q8 / 256.0 + towards * 0.5 * side - (side - 1) / 2.0) / side - origin;
      };
      const imprint::Frame& frame = state->frames[idx(p)];
      DOUBLES_EQUAL(want(dot.x.raw(), p % 2 == 0 ? 1 : -1, state->picture.left), frame.x_q12 / 4096.0, 2.0 / 4096);
      DOUBLES_EQUAL(want(dot.y.raw(), p % 4 < 2 ? 1 : -1, state->picture.top), frame.y_q12 / 4096.0, 2.0 / 4096);
    }
  }
}

// To a 256th of a pixel: from the centre of the first pixel up to that of the last, which it does not reach. The
// slanted lattice's links are (20, 2) and (2, 20) pixels, so a patch's far corner lies 7.5 / 16 of 22 pixels from its
// dot.
TEST(Imprint, APatchIsSeenUntilItsFarCornerLeavesThePicture) {
  constexpr int kWidth = 100, kHeight = 80;
  constexpr int kFar_q8 = 22 * 256 * 15 / 32;
  const std::vector<std::uint8_t> pixels(kWidth * kHeight, 200);
  const auto lattice = [](int dx_q8, int dy_q8) {
    MarkerField field;
    field.grid = {3, 3};
    for (int i = 0; i < 9; ++i) {
      const int row = i / 3, col = i % 3;
      field.markers[idx(i)] = {PixelsQ8::from_raw(256 * (30 + 20 * col + 2 * row) + dx_q8),
                               PixelsQ8::from_raw(256 * (20 + 20 * row + 2 * col) + dy_q8), true};
    }
    return field;
  };
  const auto sees = [&](int patch, int dx_q8, int dy_q8) {
    auto state = std::make_unique<imprint::State>();
    Saturations saturations;
    (void)imprint::update(*state, {}, {pixels.data(), kWidth, kHeight, kWidth}, lattice(dx_q8, dy_q8), lattice(0, 0),
                          PixelsQ8::from_raw(20 * 256), true, Micros{40'000}, saturations);
    return state->last.seen[idx(patch)];
  };
  constexpr int kFirst = 4 * 0 + 3, kLast = 4 * 8;  // the first dot's towards (-x, -y), the last one's towards (+x, +y)
  const int left = kFar_q8 - 256 * 30, top = kFar_q8 - 256 * 20;
  CHECK(sees(kFirst, left, 0));
  CHECK_FALSE(sees(kFirst, left - 1, 0));
  CHECK(sees(kFirst, 0, top));
  CHECK_FALSE(sees(kFirst, 0, top - 1));
  const int right = 256 * (kWidth - 1 - 74) - kFar_q8, bottom = 256 * (kHeight - 1 - 64) - kFar_q8;
  CHECK(sees(kLast, right - 1, 0));
  CHECK_FALSE(sees(kLast, right, 0));
  CHECK(sees(kLast, 0, bottom - 1));
  CHECK_FALSE(sees(kLast, 0, bottom));
}

// A picture that brightens by a level a pixel, on a gel that was learned without noise: relief and change are whole
// numbers that do not depend on the place. 16 patches.
struct Slope {
  explicit Slope(int pitch_px) : size(3 * pitch_px), pitch_q8(256 * pitch_px) {
    for (int k = 0; k < 12; ++k) (void)step(0, true);
  }
  ImprintFeatures step(int levels_per_px, bool empty = false) {
    std::vector<std::uint8_t> pixels(static_cast<std::size_t>(size * size));
    for (int i = 0; i < size * size; ++i) {
      pixels[idx(i)] = static_cast<std::uint8_t>(120 + levels_per_px * (i % size - size / 2));
    }
    MarkerField lattice;
    lattice.grid = {2, 2};
    for (int i = 0; i < 4; ++i) {
      lattice.markers[idx(i)] = {PixelsQ8::from_raw(pitch_q8 * (1 + i % 2)), PixelsQ8::from_raw(pitch_q8 * (1 + i / 2)),
                                 true};
    }
    time += Micros{120'000};
    return imprint::update(*state, config, {pixels.data(), size, size, size}, lattice, lattice,
                           PixelsQ8::from_raw(pitch_q8), empty, time, saturations);
  }

  int size, pitch_q8;
  Micros time{0};
  imprint::Config config;
  Saturations saturations;
  std::unique_ptr<imprint::State> state = std::make_unique<imprint::State>();
};

// Samples 1.25 pixels apart differ by 20: G = 400. At a pitch of 10 or 11 pixels it is 100 or 121, of which the second
// is above 0.47 levels^2.
TEST(Imprint, AReliefMustExceedTheThreshold) {
  LONGS_EQUAL(0, Slope(10).step(1).patches.raw());
  LONGS_EQUAL(16, Slope(11).step(1).patches.raw());
  Slope slope(20);
  for (const int floor_q8 : {399, 400}) {
    slope.config.contact_floor_q8 = floor_q8;
    LONGS_EQUAL(floor_q8 == 399 ? 16 : 0, slope.step(1).patches.raw());
    CHECK_EQUAL(floor_q8 == 399, slope.step(-1).motion_short.raw() > 0);
  }
}

// 1.2 levels^2 and 0.12 for each patch are added to both reliefs, and what noise has in them taken off. Here, half a
// pixel apart, samples differ by 8, and those of the empty gel by nothing. Rounding: three logarithms, two of them
// halved.
TEST(Imprint, OfAWeakReliefMotionIsHeldDown) {
  double sum = 0.0, squares = 0.0;
  for (int b = 0; b < imprint::kSide; ++b) {
    for (int a = 0; a < imprint::kSide; ++a) {
      if (!imprint::is_free(a, b)) continue;
      sum += 8.0 * a;
      squares += 8.0 * a * 8.0 * a;
    }
  }
  const double change = squares / imprint::kFree - std::pow(sum / imprint::kFree, 2);
  for (const int noise : {0, 8}) {
    Slope slope(8);
    slope.config.contact_floor_q8 = 10;
    slope.state->empty.noise_relief = noise * imprint::kPairs;
    const double relief = (64.0 - 2 * noise + 2 * 256 * (1.2 / 16 + 0.12)) / 2;
    const double want_um = slope.config.pitch_um / 16.0 * std::sqrt(change / relief);
    DOUBLES_EQUAL(256.0 * std::log2(want_um), slope.step(1).motion_short.raw(), 2.0);
  }
}

// Whose time stood later.
TEST(Imprint, PicturesOfAnotherStreamDoNotCount) {
  Gel gel;
  Bench bench(gel);
  bench.time += Micros{2'000'000};
  bench.gel.relief = ribs(12.0, 2.4);
  (void)bench.step();
  bench.time -= Micros{140'000};
  bench.gel.relief = ribs(12.0, 2.4, {0.08, 0.0});
  (void)bench.step();
  bench.fps = 1e6 / 220'000;  // 120 ms after the picture of the other stream
  LONGS_EQUAL(0, bench.step().motion_short.raw());
}

TEST(Imprint, APictureBesideTheLatticeTellsNothingOfTheEmptyGel) {
  const Gel gel;
  const std::uint8_t pixel = 120;
  auto state = std::make_unique<imprint::State>();
  Saturations saturations;
  (void)imprint::update(*state, {}, {&pixel, 1, 1, 1}, gel.field({}), gel.field({}), gel.pitch(), true, Micros{40'000},
                        saturations);
  LONGS_EQUAL(0, state->empty.frames);
}

// Two thirds and four thirds of it still count.
TEST(Imprint, APictureCountsWithinAThirdOfItsLag) {
  Gel gel;
  Bench bench(gel);
  const auto moves = [&](std::int64_t age_us) {
    bench.time += Micros{2'000'000};
    bench.gel.relief = ribs(12.0, 2.4);
    (void)bench.step();
    bench.gel.relief = ribs(12.0, 2.4, {0.08, 0.0});
    bench.fps = 1e6 / static_cast<double>(age_us);
    return bench.step();
  };
  CHECK(moves(80'000).motion_short.raw() > 0);
  LONGS_EQUAL(0, moves(79'999).motion_short.raw());
  CHECK(moves(160'000).motion_short.raw() > 0);
  LONGS_EQUAL(0, moves(160'001).motion_short.raw());
  CHECK(moves(160'000).motion.raw() > 0);
  LONGS_EQUAL(0, moves(159'999).motion.raw());
  CHECK(moves(320'000).motion.raw() > 0);
  LONGS_EQUAL(0, moves(320'001).motion.raw());
  CHECK(moves(320'000).motion_long.raw() > 0);
  LONGS_EQUAL(0, moves(319'999).motion_long.raw());
  CHECK(moves(640'000).motion_long.raw() > 0);
  LONGS_EQUAL(0, moves(640'001).motion_long.raw());
}

TEST(Imprint, PicturesAreKeptEvery35Milliseconds) {
  Gel gel;
  for (const int apart_us : {34'999, 35'000}) {
    Bench bench(gel);
    bench.time += Micros{2'000'000};
    bench.gel.relief = ribs(12.0, 2.4);
    (void)bench.step();
    bench.fps = 1e6 / apart_us;
    (void)bench.step();
    bench.gel.relief = ribs(12.0, 2.4, {0.08, 0.0});
    bench.fps = 1e6 / 160'000;  // too long after the first of the two for the shortest lag
    CHECK_EQUAL(apart_us == 35'000, bench.step().motion_short.raw() > 0);
  }
}

TEST(Imprint, LagsAreTimesNotFrames) {
  constexpr double kSpeed_mm_s = 0.5;
  for (const double fps : {6.3, 8.33, 10.0, 11.2, 12.0, 12.5, 13.3, 15.0, 18.75, 25.0, 27.0, 60.0}) {
    Gel gel;
    Bench bench(gel);
    bench.fps = fps;
    ImprintFeatures seen{};
    for (int k = 0; k < fps; ++k) {
      bench.gel.relief = ribs(12.0, 2.4, {kSpeed_mm_s * k / fps, 0.0});
      seen = bench.step();
    }
    const auto expected = [&](double lag_s) {
      return motion_of(gel, ribs(12.0, 2.4), ribs(12.0, 2.4, {kSpeed_mm_s * lag_s, 0.0}));
    };
    // The lag itself may be off by a third.
    DOUBLES_EQUAL(expected(0.12), um(seen.motion_short), 0.4 * expected(0.12));
    DOUBLES_EQUAL(expected(0.24), um(seen.motion), 0.4 * expected(0.24));
    DOUBLES_EQUAL(expected(0.48), um(seen.motion_long), 0.4 * expected(0.48));
  }
}

TEST(Imprint, NothingToCompareWithIsNoMotion) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = grain(10.0);
  (void)bench.wait(20);
  bench.gel.relief = grain(10.0, {0.1, 0.0});
  bench.time += Micros{2'000'000};
  LONGS_EQUAL(0, bench.step().motion.raw());
  (void)bench.wait(20);
  bench.time = Micros{1000};  // another stream
  bench.gel.relief = grain(10.0);
  LONGS_EQUAL(0, bench.step().motion.raw());
  imprint::forget(*bench.state);
  LONGS_EQUAL(0, bench.wait(20).patches.raw());  // no empty gel was seen
}

// A lost dot takes the patches with it whose displacement it tells: 4 of its own, 12 of its neighbours.
TEST(Imprint, LostDotsTakeTheirPatchesWithThem) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = grain(14.0);
  const int all = bench.wait(10).patches.raw();
  bench.gel.lost = {31};
  const int less = bench.step().patches.raw();
  CHECK(all - less >= 8 && all - less <= 16);
  for (int i = 0; i < 63; ++i) bench.gel.lost.push_back(i);
  const ImprintFeatures none = bench.step();
  LONGS_EQUAL(0, none.patches.raw());
  LONGS_EQUAL(0, none.motion.raw());
  // The same when it is the rest position that does not know it any more.
  bench.gel.lost.clear();
  LONGS_EQUAL(all, bench.step().patches.raw());
  bench.gel.without_rest = {31};
  LONGS_EQUAL(less, bench.step().patches.raw());
}

// No patch is laid out at a dot that has no rest position, beside it or across from it: 16 inside the lattice, fewer at
// its edge. Where such a dot was guessed does not count for what part of the picture is looked at.
TEST(Imprint, DotsWithoutARestPositionHaveNoPatches) {
  const Bench whole{Gel{}};
  LONGS_EQUAL(4 * 63, usable(*whole.state));
  for (const auto& [dot, patches] : {std::pair{31, 16}, {0, 9}, {1, 14}, {9, 14}, {62, 9}}) {
    Gel gel;
    gel.without_rest = {dot};
    const Bench bench(gel);
    LONGS_EQUAL(4 * 63 - patches, usable(*bench.state));
    LONGS_EQUAL(whole.state->picture.width, bench.state->picture.width);
    LONGS_EQUAL(whole.state->picture.height, bench.state->picture.height);
  }
}

// Nothing is learned of the noise of a gel that is empty, but of which nothing is seen.
TEST(Imprint, AnEmptyGelThatIsNotSeenHasNoNoise) {
  Gel gel;
  gel.noise = 2.0;
  Bench bench(gel);
  for (int k = 0; k < 10; ++k) (void)bench.step(true);
  const auto before = std::make_unique<imprint::Empty>(bench.state->empty);
  CHECK(before->noise_relief > 0 && before->noise_motion[0] > 0);
  for (int i = 0; i < 63; ++i) bench.gel.lost.push_back(i);
  for (int k = 0; k < 2; ++k) (void)bench.step(true);
  CHECK(before->noise_relief == bench.state->empty.noise_relief);
  CHECK(before->noise_motion == bench.state->empty.noise_motion);
  CHECK(before->noise_frames == bench.state->empty.noise_frames);
}

// A corner marker twenty pitches outside takes the patches that hang on it out of the picture, but for the one that
// hangs on it least: bent by five pitches, which no gel is. What a patch says of the bend has an end, so that the slip
// of all the others is still heard.
TEST(Imprint, OneDotThatJumpsDoesNotSilenceTheRest) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = ribs(12.0, 2.4);
  (void)bench.wait(20);
  bench.gel.bend = [&gel](Mm at) {
    const Mm corner = gel.rest_of(0);
    return std::hypot(at.x - corner.x, at.y - corner.y) < 0.1 ? Mm{-20.0 * kPitch_mm, 0.0} : Mm{};
  };
  bench.gel.relief = ribs(12.0, 2.4, {0.4, 0.0});
  const double slipped = um(bench.step().motion);
  CHECK_TEXT(slipped > 200.0, std::to_string(slipped).c_str());
}

// Rounding of samples to 1/16 level and of logarithms to 1/256: below 0.02 of log2 unless a patch is so near to
// its threshold that the two count it differently.
TEST(Imprint, EqualsTheReferenceInDouble) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  double worst = 0.0;
  int compared = 0;
  for (int trial = 0; trial < 4; ++trial) {
    Gel gel;
    if (trial % 3 == 1) gel = {.px_per_mm = 14.43, .width = 410, .height = 308};
    gel.noise = trial % 2 == 0 ? 0.0 : 2.0;
    Bench bench(gel, true, trial);
    Mm dots{}, object{};
    const double levels = 4.0 + trial;
    for (int k = 0; k < 20; ++k) {
      if (k > 4) dots = {dots.x + 0.02 * uniform(random), dots.y + 0.02 * uniform(random)};
      object = k < 10 ? dots : Mm{object.x + 0.03 * uniform(random), object.y + 0.02};
      bench.gel.dots = dots;
      bench.gel.bend = [=](Mm at) { return Mm{0.004 * k * std::sin(at.x + at.y), -0.002 * k * std::cos(at.y)}; };
      bench.gel.relief = grain(levels, object);
      const ImprintFeatures seen = bench.step();
      CHECK(std::abs(seen.patches.raw() - bench.expected.patches) <= 2);
      const double expected[] = {bench.expected.motion_um[0], bench.expected.motion_um[1], bench.expected.motion_um[2]};
      const Log2Q8 motions[] = {seen.motion_short, seen.motion, seen.motion_long};
      for (int m = 0; m < 3; ++m) {
        if (bench.expected.close[m]) continue;
        CHECK((expected[m] > 0) == (motions[m].raw() > 0) || expected[m] < 3.0);
        if (expected[m] < 10.0) continue;  // below a tenth of a sample it is rounding that is measured
        worst = std::max(worst, std::abs(motions[m].raw() / 256.0 - std::log2(expected[m])));
        ++compared;
      }
    }
  }
  std::printf("\nimprint against double: worst %.3f of log2 in %d motions\n", worst, compared);
  CHECK(compared > 80);
  CHECK(worst <= 0.02);
}

// What no sensor shows: nothing may be read or written outside, and nothing may wrap (sanitizers see to it).
TEST(Imprint, ExtremesStayInRange) {
  for (const int level : {0, 255}) {
    Gel gel;
    Bench bench(gel);
    std::vector<std::uint8_t> flat(static_cast<std::size_t>(gel.width * gel.height), static_cast<std::uint8_t>(level));
    const LumaView view{flat.data(), gel.width, gel.height, gel.width};
    for (const double far_mm : {0.0, 0.5, 5.0, 50.0, -200.0}) {
      bench.time += Micros{40'000};
      const ImprintFeatures seen = imprint::update(*bench.state, bench.config, view, gel.field({far_mm, -far_mm}),
                                                   gel.field({}), gel.pitch(), false, bench.time, bench.saturations);
      CHECK(seen.patches.raw() <= imprint::kMaxPatches);
    }
    // Black and white pixels by turns: the largest differences there are.
    for (std::size_t i = 0; i < flat.size(); ++i) flat[i] = (i / 16 + i / 5120) % 2 == 0 ? 0 : 255;
    for (int k = 0; k < 20; ++k) {
      bench.time += Micros{40'000};
      (void)imprint::update(*bench.state, bench.config, view, gel.field({}), gel.field({}), gel.pitch(), false,
                            bench.time, bench.saturations);
      for (std::uint8_t& pixel : flat) pixel = static_cast<std::uint8_t>(255 - pixel);
    }
  }
  LONGS_EQUAL(0, 0);
}

// A camera that changes its picture's size mid-stream: what was laid out for the larger one must not read beyond the
// smaller one (sanitizers see to it).
TEST(Imprint, SmallerPictureIsLaidOutAnew) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = grain(10.0);
  CHECK(bench.wait(10).patches.raw() > 200);
  for (const auto& [width, height] : {std::array{160, 120}, {8, 8}, {64, 240}, {64, 120}, {320, 1}, {1, 1}}) {
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width * height), 200);
    const LumaView view{pixels.data(), width, height, width};
    bench.time += Micros{40'000};
    const ImprintFeatures seen = imprint::update(*bench.state, bench.config, view, gel.field({}), gel.field({}),
                                                 gel.pitch(), false, bench.time, bench.saturations);
    CHECK(seen.patches.raw() < 100);  // those that the smaller picture still shows
  }
  CHECK(bench.wait(2).patches.raw() > 200);
}

// Lattices up to the largest, in the smallest and largest pictures, crooked and out of the picture.
TEST(Imprint, AnyLatticeInAnyPicture) {
  std::mt19937 random(3);
  for (const GridSize grid : {GridSize{1, 1}, GridSize{1, 9}, GridSize{7, 1}, GridSize{3, 3}, GridSize{7, 9},
                              GridSize{8, 10}, GridSize{8, 16}, GridSize{16, 8}}) {
    for (const auto& [width, height] : {std::array{64, 48}, {320, 240}, {1640, 1232}}) {
      for (const double fill : {0.3, 1.5}) {
        Gel gel;
        gel.grid = grid;
        gel.width = width;
        gel.height = height;
        gel.px_per_mm = fill * width / (kPitch_mm * std::max<int>(grid.cols, grid.rows / 2));
        const std::vector<std::uint8_t> pixels = gel.picture(random);
        const LumaView view{pixels.data(), width, height, width};
        auto state = std::make_unique<imprint::State>();
        Saturations saturations;
        MarkerField rest = gel.field({});
        for (Marker& marker : rest.markers) {  // crooked by up to a pixel
          marker.x = PixelsQ8::saturate(marker.x.raw() + static_cast<int>(random() % 512) - 256, saturations);
        }
        for (int k = 0; k < 4; ++k) {
          (void)imprint::update(*state, {}, view, gel.field({0.3 * k, 0.1 * k}), rest, gel.pitch(), k < 2,
                                Micros{40'000 * (k + 1)}, saturations);
        }
        LONGS_EQUAL(0, saturations.count);
        // A single line tells nothing of what lies beside it.
        if (grid.rows > 1 && grid.cols > 1) continue;
        CHECK(
            std::none_of(state->frames.begin(), state->frames.end(), [](const imprint::Frame& f) { return f.usable; }));
      }
    }
  }
}
