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

double um(Log2Q8 motion) {
  return std::exp2(motion.raw() / 256.0);
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
    bench.gel.relief = ribs(12.0, 2.4);
    (void)bench.wait(8);
    bench.gel.relief = ribs(12.0, 2.4, {0.08, 0.0});
    const double expected = motion_of(gel, ribs(12.0, 2.4), ribs(12.0, 2.4, {0.08, 0.0}));
    DOUBLES_EQUAL(expected, um(bench.step().motion), 0.1 * expected);
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
  CHECK(bench.state->picture.width * bench.state->picture.height <= imprint::kMaxReducedPixels);
  bench.gel.relief = ribs(12.0, 2.4);
  (void)bench.wait(8);
  bench.gel.relief = ribs(12.0, 2.4, {0.08, 0.0});
  const double expected = motion_of(gel, ribs(12.0, 2.4), ribs(12.0, 2.4, {0.08, 0.0}));
  DOUBLES_EQUAL(expected, um(bench.step().motion), 0.1 * expected);
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
  const auto usable = [](const imprint::State& state) {
    return std::count_if(state.frames.begin(), state.frames.end(), [](const imprint::Frame& f) { return f.usable; });
  };
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
