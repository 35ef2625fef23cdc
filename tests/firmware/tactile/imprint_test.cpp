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
  std::function<double(Mm)> light = [](Mm) { return 0.0; };  // that the empty gel shows, fixed to the camera
  Mm dots{};                                                 // where all dots have moved
  std::function<Mm(Mm)> bend = [](Mm) { return Mm{}; };      // and each of them by itself, from its rest position
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
        const double level = (120.0 + light(at) + relief(at)) * (1.0 - dot) + 45.0 * dot + noise * normal(random);
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

// The light on a ball in the middle of the gel, or moved from there.
std::function<double(Mm)> dome(double levels, Mm moved = {}, double sigma_mm = 2.0) {
  return [=](Mm at) {
    const double x = at.x - moved.x, y = at.y - moved.y;
    return levels * std::exp(-(x * x + y * y) / (2.0 * sigma_mm * sigma_mm));
  };
}

// Sum of the squares of the patches' means, from the relief itself. Where the quiet patches show none.
double shading_of(const Gel& gel, const std::function<double(Mm)>& relief) {
  constexpr double kStep_mm = kPitch_mm / imprint::kStepsPerPitch;
  double energy = 0.0;
  for (int dot = 0; dot < gel.grid.count(); ++dot) {
    const Mm from = gel.rest_of(dot);
    for (const int sx : {1, -1}) {
      for (const int sy : {1, -1}) {
        double mean = 0.0;
        for (int b = 0; b < imprint::kSide; ++b) {
          for (int a = 0; a < imprint::kSide; ++a) {
            if (!imprint::is_free(a, b)) continue;
            mean += relief({from.x + sx * (a + 0.5) * kStep_mm, from.y + sy * (b + 0.5) * kStep_mm}) / imprint::kFree;
          }
        }
        energy += mean * mean;
      }
    }
  }
  return energy;
}

// Motion of the header's formula, from the relief itself: no picture, no dots, no pixels, no noise. What the camera's
// smoothing takes it takes from change and gradient alike. `covered`: what changes is no noise anywhere.
double motion_of(const Gel& gel, const std::function<double(Mm)>& then, const std::function<double(Mm)>& now,
                 bool covered = false) {
  constexpr double kStep_mm = kPitch_mm / imprint::kStepsPerPitch;
  double evidence = 0.0, energy = 0.0;
  std::vector<std::pair<double, double>> all;  // g and R
  for (int dot = 0; dot < gel.grid.count(); ++dot) {
    for (const int sx : {1, -1}) {
      for (const int sy : {1, -1}) {
        const auto at = [&](const std::function<double(Mm)>& relief, double a, double b) {
          const Mm from = gel.rest_of(dot);
          return relief({from.x + sx * (a + 0.5) * kStep_mm, from.y + sy * (b + 0.5) * kStep_mm});
        };
        double sum = 0.0, squares = 0.0, g = 0.0;
        for (int b = 0; b < imprint::kSide; ++b) {
          for (int a = 0; a < imprint::kSide; ++a) {
            if (!imprint::is_free(a, b)) continue;
            const double change = at(now, a, b) - at(then, a, b);
            sum += change;
            squares += change * change;
            for (const auto& relief : {then, now}) {
              const double here = at(relief, a, b);
              if (imprint::is_free(a + 1, b)) g += std::pow(at(relief, a + 1, b) - here, 2);
              if (imprint::is_free(a, b + 1)) g += std::pow(at(relief, a, b + 1) - here, 2);
            }
          }
        }
        all.emplace_back(g / (2 * imprint::kPairs), (squares - sum * sum / imprint::kFree) / imprint::kFree);
      }
    }
  }
  std::sort(all.begin(), all.end());
  std::vector<double> quiet;
  for (std::size_t i = 0; i < all.size() * 2 / 5; ++i) quiet.push_back(all[i].second);
  std::sort(quiet.begin(), quiet.end());
  const double noise = covered ? 0.0 : quiet[(quiet.size() - 1) * 3 / 4];
  for (const auto& [g, change] : all) {
    evidence += g * (change - noise);
    energy += g * g;
  }
  return 1e3 * kStep_mm * std::sqrt(std::max(0.0, evidence) / energy);
}

// A contact in the middle of the gel, round, of this radius: a relief outside of it is pressed in nowhere.
std::function<double(Mm)> within(double radius_mm, const std::function<double(Mm)>& relief) {
  return [=](Mm at) {
    const double r = std::hypot(at.x, at.y);
    return relief(at) / (1.0 + std::exp((r - radius_mm) / 0.2));
  };
}
constexpr double kContact_mm = 4.5;

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
    const ImprintFeatures seen =
        imprint::update(*state, config, view, now, home, gel.pitch(), time, saturations, raised);
    if (empty) imprint::learn_empty(*state, config);
    return seen;
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
  bool raised = false;
  Micros time{0};
  imprint::Config config;
  std::unique_ptr<imprint::State> state = std::make_unique<imprint::State>();
  Saturations saturations;
  std::unique_ptr<test::ImprintReference> reference_memory = std::make_unique<test::ImprintReference>(config);
  test::ImprintReference& reference = *reference_memory;
  test::ImprintReference::Seen expected;
};

std::int64_t usable(const imprint::State& state) {
  std::int64_t count = 0;
  for (const imprint::Layout& eight : state.layout) count += std::count(eight.usable.begin(), eight.usable.end(), -1);
  return count;
}

// After one picture.
std::unique_ptr<imprint::State> state_after(const LumaView& view, const MarkerField& now, const MarkerField& rest,
                                            PixelsQ8 pitch) {
  auto state = std::make_unique<imprint::State>();
  Saturations saturations;
  (void)imprint::update(*state, {}, view, now, rest, pitch, Micros{40'000}, saturations);
  return state;
}
std::unique_ptr<imprint::State> state_after(const Gel& gel, const std::vector<std::uint8_t>& pixels) {
  return state_after({pixels.data(), gel.width, gel.height, gel.width}, gel.field({}), gel.field({}), gel.pitch());
}

double um(Log2Q8 motion) {
  return std::exp2(motion.raw() / 256.0);
}

// Ribs on an empty gel's picture that move by 0.08 mm: as much as that is in these patches.
void sees_ribs_move(Bench& bench) {
  const auto then = within(kContact_mm, ribs(12.0, 2.4)), now = within(kContact_mm, ribs(12.0, 2.4, {0.08, 0.0}));
  bench.gel.relief = then;
  (void)bench.wait(8);
  bench.gel.relief = now;
  const double expected = motion_of(bench.gel, then, now);
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
    CHECK(seen.patches.raw() < 5);
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
      bench.gel.relief = within(kContact_mm, relief({}));
      (void)bench.wait(20);
      bench.gel.relief = within(kContact_mm, relief(shift));
      const ImprintFeatures seen = bench.step();
      CHECK(seen.patches.raw() > 60);
      const double expected = motion_of(gel, within(kContact_mm, relief({})), within(kContact_mm, relief(shift)));
      DOUBLES_EQUAL(expected, um(seen.motion), 0.08 * expected + 1.0);
      CHECK(std::abs(seen.growth.raw()) < 26);  // a tenth of an octave: as much relief as before
    }
  }
}

// Also where no patch is free of it, so that what changes in the least of them is no noise; and what stands still there
// does not move, though the camera's noise is as strong as on the empty gel. 8 %: as above.
TEST(Imprint, AReliefThatCoversTheGelMovesAsAnyOther) {
  const std::vector<std::function<std::function<double(Mm)>(Mm)>> reliefs{
      [](Mm moved) { return ribs(12.0, 1.2, moved); }, [](Mm moved) { return ribs(12.0, 2.4, moved); },
      [](Mm moved) { return grain(10.0, moved); }};
  for (const auto& relief : reliefs) {
    for (const double noise : {0.0, 1.0}) {
      Gel gel;
      gel.noise = noise;
      Bench bench(gel, true);
      bench.gel.relief = relief({});
      for (int k = 0; k < 20; ++k) (void)bench.step();
      const ImprintFeatures held = bench.step();
      CHECK(um(held.motion) < 10.0 && std::abs(held.growth.raw()) < 8);
      LONGS_EQUAL(held.patches.raw(), bench.expected.patches);
      CHECK(bench.expected.covering > 2.0);
      bench.gel.relief = relief({0.08, 0.03});
      const ImprintFeatures seen = bench.step();
      const double expected = motion_of(gel, relief({}), relief({0.08, 0.03}), true);
      DOUBLES_EQUAL(expected, um(seen.motion), 0.08 * expected + 1.0);
      CHECK(std::abs(seen.growth.raw()) < 26);
      DOUBLES_EQUAL(bench.expected.growth, seen.growth.raw() / 256.0, 3.0 / 256);
      // Pressed in half as deep again: growth is that of the relief, 2.25 times the energy.
      const auto deeper = [&](Mm at) { return 1.5 * relief({0.08, 0.03})(at); };
      bench.gel.relief = deeper;
      DOUBLES_EQUAL(std::log2(2.25), bench.step().growth.raw() / 256.0, 0.05);
    }
  }
}

// Twice the shading is four times its energy, and the level^2 a patch counts beside it: 1.5 and 1.9. 0.03 of log2:
// logarithms to 1/256, and 0.5 % of the energy that the camera's smoothing takes from the dome's rim.
TEST(Imprint, GrowthIsTheShadingsEnergyNowOverThen) {
  for (const double levels : {6.0, 15.0}) {
    Gel gel;
    Bench bench(gel);
    const auto weak = within(kContact_mm, dome(levels)), strong = within(kContact_mm, dome(2.0 * levels));
    const double n = 4.0 * gel.grid.count();
    const double expected = std::log2((shading_of(gel, strong) + n) / (shading_of(gel, weak) + n));
    bench.gel.relief = weak;
    (void)bench.wait(8);
    bench.gel.relief = strong;
    DOUBLES_EQUAL(expected, bench.step().growth.raw() / 256.0, 0.03);
    (void)bench.wait(8);
    bench.gel.relief = weak;
    DOUBLES_EQUAL(-expected, bench.step().growth.raw() / 256.0, 0.03);
  }
}

// Light on the quiet patches is light everywhere, no shading of the contact. 2/256 for the logarithms.
TEST(Imprint, LightIsNoGrowth) {
  Bench bench(Gel{});
  const auto held = within(kContact_mm, dome(20.0));
  bench.gel.relief = held;
  (void)bench.wait(8);
  bench.gel.relief = [=](Mm at) { return held(at) + 25.0; };
  CHECK(std::abs(bench.step().growth.raw()) <= 2);
}

// A ball that is pressed in at a constant rate, from a quarter of its shading to all of it in a second: growth is above
// what a slip may have (learn::kMostGrowth, 31), and nothing moves.
TEST(Imprint, AContactThatGrowsHasGrowth) {
  Gel gel;
  gel.noise = 1.0;
  Bench bench(gel);
  for (int k = 0; k <= 25; ++k) {
    bench.gel.relief = dome(10.0 + 30.0 * k / 25.0, {}, 1.5);
    const ImprintFeatures seen = bench.step();
    if (k < 5) continue;  // compared with the empty gel
    CHECK_TEXT(seen.growth.raw() > 31, std::to_string(seen.growth.raw()).c_str());
    LONGS_EQUAL(0, seen.coarse.raw());
  }
  // Let go, it shrinks.
  bench.gel.relief = dome(30.0, {}, 1.5);
  CHECK(bench.step().growth.raw() < -31);
}

// A ball's shading is too smooth for a patch, which sees hardly more than its mean change. All patches together see it
// move by about its length, less what linear light could have done.
TEST(Imprint, CoarseMotionSeesASmoothDomeMove) {
  for (const Mm shift : {Mm{0.15, 0.0}, Mm{0.0, -0.15}, Mm{-0.2, 0.2}}) {
    Gel gel;
    gel.noise = 0.5;
    Bench bench(gel);
    bench.gel.relief = dome(25.0);
    (void)bench.wait(8);
    LONGS_EQUAL(0, bench.step().coarse.raw());
    bench.gel.relief = dome(25.0, shift);
    const ImprintFeatures seen = bench.step();
    const double length_um = 1e3 * std::hypot(shift.x, shift.y);
    CHECK(um(seen.coarse) > 0.85 * length_um && um(seen.coarse) < 1.05 * length_um);
    CHECK(um(seen.motion) < 0.5 * um(seen.coarse));
    CHECK(std::abs(seen.growth.raw()) <= 31);
  }
}

// With the gel it does not move; left behind by the gel it does.
TEST(Imprint, CoarseMotionIsAgainstTheGel) {
  Gel gel;
  gel.noise = 0.5;
  Bench bench(gel);
  bench.gel.relief = dome(25.0);
  (void)bench.wait(8);
  bench.gel.dots = {0.15, 0.1};
  bench.gel.relief = dome(25.0, bench.gel.dots);
  LONGS_EQUAL(0, bench.step().coarse.raw());
  bench.gel.dots = {0.3, 0.2};
  (void)bench.wait(3);
  const ImprintFeatures left = bench.step();
  CHECK(um(left.coarse) > 100.0);
}

// Up to 0.35 levels^2 of relief; with more, the patches themselves tell what moves.
TEST(Imprint, CoarseMotionIsForWeakRelief) {
  int weak = 0, strong = 0;
  for (double fine = 0.5; fine < 1.5; fine += 0.1) {
    Bench bench(Gel{}, true);
    const auto at = [fine](Mm moved) {
      return [=](Mm place) { return dome(25.0, moved)(place) + grain(fine, moved)(place); };
    };
    bench.gel.relief = at({});
    (void)bench.wait(8);
    bench.gel.relief = at({0.15, 0.0});
    const bool moves = bench.step().coarse.raw() > 0;
    const double relief = bench.expected.relief;
    if (std::abs(relief - test::ImprintReference::kMostReliefForCoarse) < 0.01) continue;
    CHECK_EQUAL_TEXT(relief < test::ImprintReference::kMostReliefForCoarse, moves, std::to_string(relief).c_str());
    if (relief > 0.25 && relief < 0.35) ++weak;
    if (relief > 0.35 && relief < 0.45) ++strong;
  }
  CHECK(weak > 0);
  CHECK(strong > 0);
}

// Of waves along x that are shorter than a patch, 1 - cos(2 pi shift / wave) is replaced; beyond a quarter of a wave,
// all. A patch holds little more than a wave of them, so that its means and edges change that by up to 0.1.
TEST(Imprint, TurnoverIsTheShareOfTheReliefThatIsAnother) {
  constexpr double kWave_mm = 0.8;
  for (const double shift_mm : {0.0, 0.05, 0.08, 0.12, 0.25, 0.4}) {
    Bench bench(Gel{});
    bench.gel.relief = within(kContact_mm, ribs(6.0, kWave_mm));
    (void)bench.wait(8);
    bench.gel.relief = within(kContact_mm, ribs(6.0, kWave_mm, {shift_mm, 0.0}));
    const double expected = std::min(1.0, 1.0 - std::cos(2.0 * std::numbers::pi * shift_mm / kWave_mm));
    DOUBLES_EQUAL(expected, bench.step().turnover.raw() / 1024.0, shift_mm > 0.0 ? 0.1 : 0.0);
  }
}

// A pattern that is pressed harder, let go of or lit otherwise is the same pattern, however much that changes the
// picture. Noise of the camera is none of it.
TEST(Imprint, WhatGrowsOrFadesInPlaceIsNoTurnover) {
  for (const double factor : {0.5, 0.8, 1.25, 2.0, 3.0}) {
    Gel gel;
    gel.noise = 2.0;
    Bench bench(gel);
    const auto relief = within(kContact_mm, grain(6.0));
    bench.gel.relief = relief;
    (void)bench.wait(8);
    bench.gel.relief = [=](Mm at) { return factor * relief(at) + 10.0; };
    const ImprintFeatures seen = bench.step();
    CHECK_TEXT(seen.turnover.raw() <= 20, std::to_string(seen.turnover.raw()).c_str());
    CHECK(seen.motion.raw() > 1000);  // of its energy much has changed
  }
}

// A grip that is eased. Three quarters of the change are taken off, half of its length is left. 10 %: the rim of the
// contact, and pixels.
TEST(Imprint, OfWhatFadesInPlaceHalfIsLeft) {
  for (const double factor : {0.5, 0.7}) {
    Bench bench(Gel{});
    const auto strong = within(kContact_mm, grain(10.0));
    const auto weak = [=](Mm at) { return factor * strong(at); };
    bench.gel.relief = strong;
    (void)bench.wait(8);
    bench.gel.relief = weak;
    const double all = motion_of(bench.gel, strong, weak);
    DOUBLES_EQUAL(0.5 * all, um(bench.step().motion), 0.05 * all);
    // What grows is another matter: growth tells it.
    (void)bench.wait(8);
    bench.gel.relief = strong;
    DOUBLES_EQUAL(all, um(bench.step().motion), 0.1 * all);
  }
}

// Ridges at the speed at which each has taken the place of the next one a lag ago: of four frames at 25 a second, of
// five in every other frame at 30. At 8 that is the frame before, and no later one is there to compare with.
TEST(Imprint, ReliefThatRepeatsItselfGoesOnWhileSlipIsRaised) {
  for (const auto& [fps, frames] : {std::pair{25.0, 4}, std::pair{30.0, 5}, std::pair{8.0, 1}}) {
    std::array<std::vector<std::int32_t>, 2> growth;  // of the lag, whether something else is looked at or not
    for (const bool raised : {false, true}) {
      const bool sees = raised && frames > 1;
      constexpr double kPitch_mm = 1.2;
      Bench bench(Gel{});
      bench.fps = fps;
      bench.raised = raised;
      double least_um = 1e9;
      int least_turnover = 1024;
      for (int k = 0; k < 20; ++k) {
        bench.gel.relief = within(kContact_mm, ribs(12.0, kPitch_mm, {k * kPitch_mm / frames, 0.0}));
        const ImprintFeatures seen = bench.step();
        if (k < 8) continue;
        least_um = std::min(least_um, um(seen.motion));
        least_turnover = std::min(least_turnover, static_cast<int>(seen.turnover.raw()));
        growth[raised ? 1 : 0].push_back(seen.growth.raw());
      }
      CHECK_TEXT(sees ? least_um > 150.0 : least_um < 2.0, std::to_string(least_um).c_str());
      CHECK_TEXT(sees ? least_turnover > 700 : least_turnover < 50, std::to_string(least_turnover).c_str());
    }
    CHECK_TRUE(growth[0] == growth[1]);
  }
}

// Half a permille for each um that the gel was carried: what is followed between dots changes a little on the way.
TEST(Imprint, TurnoverAllowsForTheWayOfTheGel) {
  for (const double way_mm : {0.0, 0.3, 0.6}) {
    Bench bench(Gel{});
    bench.gel.relief = within(kContact_mm, ribs(6.0, 0.8));
    (void)bench.wait(8);
    bench.gel.dots = {0.0, way_mm};
    bench.gel.relief = within(kContact_mm, ribs(6.0, 0.8, {0.4, way_mm}));
    DOUBLES_EQUAL(1.0 - 0.5 * way_mm, bench.step().turnover.raw() / 1024.0, 0.01);
  }
}

// Below 0.2 levels^2 nothing is told, whatever moves.
TEST(Imprint, TurnoverNeedsARelief) {
  int told = 0, silent = 0;
  for (double levels = 0.1; levels < 3.0; levels += 0.1) {
    Bench bench(Gel{}, true);
    bench.gel.relief = within(kContact_mm, ribs(levels, 0.8));
    (void)bench.wait(8);
    bench.gel.relief = within(kContact_mm, ribs(levels, 0.8, {0.4, 0.0}));
    const bool turned = bench.step().turnover.raw() > 0;
    if (!bench.expected.tells_turnover()) continue;
    const bool expected = bench.expected.shows_relief();
    CHECK_EQUAL_TEXT(expected, turned, std::to_string(bench.expected.variance).c_str());
    ++(turned ? told : silent);
  }
  CHECK(told > 3);
  CHECK(silent > 3);
}

// What changes everywhere alike is noise of these two pictures: light that flickers, a codec's key frame.
TEST(Imprint, WhatChangesWhereNothingIsPressedInIsNoMotion) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = within(kContact_mm, grain(10.0));
  (void)bench.wait(20);
  const auto texture = ribs(1.2, 0.9);
  const auto still = bench.gel.relief;
  bench.gel.relief = [=](Mm at) { return still(at) + texture(at); };
  const double seen = um(bench.step().motion);
  CHECK_TEXT(seen < 20.0, std::to_string(seen).c_str());
  Bench slips(gel);
  slips.gel.relief = still;
  (void)slips.wait(20);
  slips.gel.relief = [=](Mm at) { return still({at.x - 0.1, at.y}) + texture(at); };
  const double slipped = um(slips.step().motion);
  CHECK_TEXT(slipped > 40.0, std::to_string(slipped).c_str());
}

// Along its waves, if they are short against a patch, a relief moves by its own length.
TEST(Imprint, ShortWavesMoveByTheirLength) {
  const Gel gel;
  DOUBLES_EQUAL(50.0, motion_of(gel, within(4.5, ribs(12.0, 1.0)), within(4.5, ribs(12.0, 1.0, {0.05, 0.0}))), 8.0);
}

TEST(Imprint, WhatMovesWithTheGelDoesNotMove) {
  Gel gel;
  Bench bench(gel);
  const auto held = within(kContact_mm, grain(10.0));
  const auto carried = [&](Mm by) { return [=](Mm at) { return held({at.x - by.x, at.y - by.y}); }; };
  bench.gel.relief = held;
  (void)bench.wait(20);
  for (int k = 1; k <= 20; ++k) {  // up to 1 mm, half of the pitch
    bench.gel.dots = {0.05 * k, -0.03 * k};
    bench.gel.relief = carried(bench.gel.dots);
    const ImprintFeatures seen = bench.step();
    CHECK(seen.patches.raw() > 60);
    CHECK(um(seen.motion) < 15.0);  // interpolation between pixels of 0.127 mm
  }
  // The same relief left behind: as far as the gel goes, less what is put down to its being carried, half of the way.
  Bench slips(gel);
  slips.gel.relief = held;
  (void)slips.wait(20);
  slips.gel.dots = {0.1, 0.0};
  const double moved = motion_of(gel, held, carried({0.1, 0.0}));
  const double expected = std::sqrt(moved * moved - 50.0 * 50.0);
  DOUBLES_EQUAL(expected, um(slips.step().motion), 0.1 * expected);
}

// A relief that goes its own way while the gel goes another: the motion loses the square of half of the gel's way,
// whatever their directions, and there is none when it was shorter.
TEST(Imprint, WhatBeingCarriedExplainsIsNoMotion) {
  const auto held = within(kContact_mm, grain(10.0));
  const auto seen = [&](Mm gel_way, Mm own_way) {
    Bench bench(Gel{});
    bench.gel.relief = held;
    (void)bench.wait(20);
    bench.gel.dots = gel_way;
    const Mm to{gel_way.x + own_way.x, gel_way.y + own_way.y};
    bench.gel.relief = [=](Mm at) { return held({at.x - to.x, at.y - to.y}); };
    return um(bench.step().motion);
  };
  const double alone = seen({}, {0.1, 0.0});
  CHECK(alone > 50.0);
  for (const Mm way : {Mm{0.06, 0.0}, Mm{-0.06, 0.0}, Mm{0.0, 0.06}}) {
    const double expected = std::sqrt(alone * alone - 30.0 * 30.0);
    DOUBLES_EQUAL(expected, seen(way, {0.1, 0.0}), 0.06 * expected);  // interpolation between pixels of 0.127 mm
  }
  CHECK(seen({0.3, 0.0}, {0.1, 0.0}) < 2.0);
}

// Beside a contact the gel bends within a pitch. Patches follow the slope between their dots, so that is no slip; a
// slip on top of it still is.
TEST(Imprint, GelThatBendsBetweenTheDotsIsNoMotion) {
  const auto wave = [](Mm at) { return Mm{0.2 * std::sin(2.0 * std::numbers::pi / 9.0 * at.x), 0.0}; };
  Gel gel;
  const auto seen_after = [&](Mm slip) {
    Bench now(gel);
    now.gel.relief = within(kContact_mm, grain(10.0));
    (void)now.wait(20);
    now.gel.bend = wave;
    now.gel.relief = [=, still = within(kContact_mm, grain(10.0))](Mm at) {
      const Mm own = wave(at);
      return still({at.x - own.x - slip.x, at.y - own.y - slip.y});
    };
    return um(now.step().motion);
  };
  const double stuck = seen_after({});
  const double slipped = seen_after({0.3, 0.0});
  CHECK_TEXT(stuck < 30.0, std::to_string(stuck).c_str());
  CHECK_TEXT(slipped > 100.0, std::to_string(slipped).c_str());
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
    held.gel.relief = [k, relief = within(kContact_mm, grain(10.0))](Mm at) { return relief(at) + 0.5 * k; };
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
      const auto state = state_after({pixels.data(), width, height, width}, rest, rest, gel.pitch());
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
    const auto state = state_after(gel, pixels);
    const imprint::Reduced& reduced = state->picture;
    LONGS_EQUAL(std::clamp(std::lround(std::log2(pitch_px / 16.0)), 0L, 4L), reduced.reduction_log2);
    for (int i = 0; i < reduced.width * reduced.height; ++i) LONGS_EQUAL(16 * 255, reduced.pixels[idx(i)]);
    for (int p = 0; p < 4 * gel.grid.count(); ++p) {
      CHECK(state->in_view[idx(p)]);
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
    const auto state = state_after(gel, pixels);
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
    const auto state = state_after({pixels.data(), gel.width, gel.height, gel.width}, rest, rest, gel.pitch());
    LONGS_EQUAL(side, 1 << state->picture.reduction_log2);
    for (int p = 0; p < 16; ++p) {
      const Marker& dot = rest.markers[idx(p / 4)];
      const auto want = [&](int q8, int towards, int origin) {
        return (q8 / 256.0 + towards * 0.5 * side - (side - 1) / 2.0) / side - origin;
      };
      const imprint::Layout& eight = state->layout[idx(p / imprint::kLanes)];
      const int x_q12 = eight.x.first_q12[idx(p % imprint::kLanes)],
                y_q12 = eight.y.first_q12[idx(p % imprint::kLanes)];
      DOUBLES_EQUAL(want(dot.x.raw(), p % 2 == 0 ? 1 : -1, state->picture.left), x_q12 / 4096.0, 2.0 / 4096);
      DOUBLES_EQUAL(want(dot.y.raw(), p % 4 < 2 ? 1 : -1, state->picture.top), y_q12 / 4096.0, 2.0 / 4096);
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
    const auto state = state_after({pixels.data(), kWidth, kHeight, kWidth}, lattice(dx_q8, dy_q8), lattice(0, 0),
                                   PixelsQ8::from_raw(20 * 256));
    return state->in_view[idx(patch)];
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
    const ImprintFeatures seen = imprint::update(*state, config, {pixels.data(), size, size, size}, lattice, lattice,
                                                 PixelsQ8::from_raw(pitch_q8), time, saturations);
    if (empty) imprint::learn_empty(*state, config);
    return seen;
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
  }
}

// Now and then: a relief of 10 levels is one, one of a third of a level is none.
TEST(Imprint, WithoutReliefNothingMoves) {
  for (const double levels : {0.3, 10.0}) {
    Bench bench(Gel{});
    bench.gel.relief = within(kContact_mm, grain(levels));
    (void)bench.wait(20);
    bench.gel.relief = within(kContact_mm, grain(levels, {0.2, 0.0}));
    CHECK_EQUAL(levels > 1.0, bench.step().motion.raw() > 0);
  }
}

// Whose time stood later.
TEST(Imprint, PicturesOfAnotherStreamDoNotCount) {
  Bench bench(Gel{});
  bench.time += Micros{2'000'000};
  bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4));
  (void)bench.step();
  bench.time -= Micros{180'000};
  bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4, {0.08, 0.0}));
  (void)bench.step();
  bench.fps = 1e6 / 300'000;  // 160 ms after the picture of the other stream
  LONGS_EQUAL(0, bench.step().motion.raw());
}

TEST(Imprint, APictureBesideTheLatticeTellsNothingOfTheEmptyGel) {
  const Gel gel;
  const std::uint8_t pixel = 120;
  const auto state = state_after({&pixel, 1, 1, 1}, gel.field({}), gel.field({}), gel.pitch());
  imprint::learn_empty(*state, {});
  LONGS_EQUAL(0, state->empty.frames);
}

// Two thirds and four thirds of it still count.
TEST(Imprint, APictureCountsWithinAThirdOfItsLag) {
  Bench bench(Gel{});
  const auto moves = [&](std::int64_t age_us) {
    bench.time += Micros{2'000'000};
    bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4));
    (void)bench.step();
    bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4, {0.08, 0.0}));
    bench.fps = 1e6 / static_cast<double>(age_us);
    return bench.step().motion.raw() > 0;
  };
  CHECK(moves(106'667));
  CHECK_FALSE(moves(106'666));
  CHECK(moves(213'333));
  CHECK_FALSE(moves(213'334));
}

TEST(Imprint, PicturesAreKeptEvery35Milliseconds) {
  Gel gel;
  for (const int apart_us : {34'999, 35'000}) {
    Bench bench(gel);
    bench.time += Micros{2'000'000};
    bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4));
    (void)bench.step();
    bench.fps = 1e6 / apart_us;
    (void)bench.step();
    bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4, {0.08, 0.0}));
    bench.fps = 1e6 / 213'000;  // too long after the first of the two
    CHECK_EQUAL(apart_us == 35'000, bench.step().motion.raw() > 0);
  }
}

TEST(Imprint, LagsAreTimesNotFrames) {
  constexpr double kSpeed_mm_s = 0.5;
  for (const double fps : {6.3, 8.33, 9.0, 10.0, 11.2, 12.0, 12.5, 13.3, 15.0, 18.75, 25.0, 27.0, 60.0}) {
    Gel gel;
    Bench bench(gel);
    bench.fps = fps;
    ImprintFeatures seen{};
    for (int k = 0; k < fps; ++k) {
      bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4, {kSpeed_mm_s * k / fps, 0.0}));
      seen = bench.step();
    }
    const double expected = motion_of(gel, within(kContact_mm, ribs(12.0, 2.4)),
                                      within(kContact_mm, ribs(12.0, 2.4, {kSpeed_mm_s * 0.16, 0.0})));
    // The lag itself may be off by a third.
    DOUBLES_EQUAL(expected, um(seen.motion), 0.4 * expected);
  }
}

// Three frames at 25 a second. A stream that has nothing but gaps is not blind for long, nor is one that begins.
TEST(Imprint, IsBlindBehindAGapInTheStream) {
  Bench bench(Gel{});
  for (int k = 0; k < 20; ++k) CHECK_FALSE(bench.step().blind);
  bench.time += Micros{300'000};
  for (int k = 0; k < 20; ++k) CHECK_EQUAL(k < 3, bench.step().blind);
  bench.fps = 1e6 / 60'000;  // a dropped frame is no gap
  CHECK_FALSE(bench.step().blind);
  bench.fps = 4.0;
  for (int k = 0; k < 2 * imprint::kMostBlind; ++k) CHECK_EQUAL(k < imprint::kMostBlind, bench.step().blind);
  bench.fps = 25.0;
  CHECK_FALSE(bench.wait(8).blind);
  imprint::forget(*bench.state);
  CHECK_FALSE(bench.step().blind);
}

TEST(Imprint, NothingToCompareWithIsNoMotion) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = within(kContact_mm, grain(10.0));
  (void)bench.wait(20);
  bench.gel.relief = within(kContact_mm, grain(10.0, {0.1, 0.0}));
  bench.time += Micros{2'000'000};
  LONGS_EQUAL(0, bench.step().motion.raw());
  (void)bench.wait(20);
  bench.time = Micros{1000};  // another stream
  bench.gel.relief = within(kContact_mm, grain(10.0));
  LONGS_EQUAL(0, bench.step().motion.raw());
  imprint::forget(*bench.state);
  LONGS_EQUAL(0, bench.wait(20).patches.raw());  // no empty gel was seen
}

// A lost dot takes the patches with it whose displacement it tells: 4 of its own, 12 of its neighbours.
TEST(Imprint, LostDotsTakeTheirPatchesWithThem) {
  Bench bench(Gel{});
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
// its edge; also where it was guessed right. Where it was guessed far off does not count for what part of the picture
// is looked at.
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
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(gel.width * gel.height), 200);
    MarkerField rest = gel.field({});
    rest.markers[idx(dot)].valid = false;
    const LumaView view{pixels.data(), gel.width, gel.height, gel.width};
    LONGS_EQUAL(4 * 63 - patches, usable(*state_after(view, gel.field({}), rest, gel.pitch())));
  }
}

// A relief that is too weak for a motion now is too weak however strong it was, and the other way round.
TEST(Imprint, BothReliefsMustBeThere) {
  const auto moves = [](double before, double now) {
    Gel gel;
    gel.noise = 0.5;
    Bench bench(gel);
    bench.gel.relief = within(kContact_mm, grain(before));
    (void)bench.wait(8);
    bench.gel.relief = within(kContact_mm, grain(now, {0.1, 0.0}));
    return bench.step().motion.raw() > 0;
  };
  int weak = 0, strong = 0;
  for (double levels = 0.8; levels < 6.0; levels *= 1.2) {
    const bool there = moves(levels, levels);
    CHECK_EQUAL(there, moves(14.0, levels));
    CHECK_EQUAL(there, moves(levels, 14.0));
    (there ? strong : weak) += 1;
  }
  CHECK(weak > 3 && strong > 3);
}

// Nothing is learned of the noise of a gel that is empty, but of which nothing is seen.
TEST(Imprint, AnEmptyGelThatIsNotSeenHasNoNoise) {
  Gel gel;
  gel.noise = 2.0;
  Bench bench(gel);
  for (int k = 0; k < 10; ++k) (void)bench.step(true);
  const auto before = std::make_unique<imprint::Empty>(bench.state->empty);
  CHECK(before->noise_relief > 0);
  for (int i = 0; i < 63; ++i) bench.gel.lost.push_back(i);
  for (int k = 0; k < 2; ++k) (void)bench.step(true);
  CHECK(before->noise_relief == bench.state->empty.noise_relief);
  LONGS_EQUAL(before->frames, bench.state->empty.frames);
}

// A corner marker twenty pitches outside takes the patches that hang on it out of the picture; the slip of all the
// others is still seen.
TEST(Imprint, OneDotThatJumpsDoesNotSilenceTheRest) {
  Gel gel;
  Bench bench(gel);
  bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4));
  (void)bench.wait(20);
  bench.gel.bend = [&gel](Mm at) {
    const Mm corner = gel.rest_of(0);
    return std::hypot(at.x - corner.x, at.y - corner.y) < 0.1 ? Mm{-20.0 * kPitch_mm, 0.0} : Mm{};
  };
  bench.gel.relief = within(kContact_mm, ribs(12.0, 2.4, {0.4, 0.0}));
  const double slipped = um(bench.step().motion);
  CHECK_TEXT(slipped > 200.0, std::to_string(slipped).c_str());
}

// Grains that slip over a gel that stretches, and balls, whose motion is a coarse one, on a gel that is lit unevenly.
// Logarithms are rounded down to 1/256: two of it for a motion, one of them for the pitch's; two of opposite sign for
// growth; another one, with smooth pictures two, for samples rounded to 1/16 level. What rounding decides about ranks
// and thresholds: ImprintReference::kRanks. Of quiet patches it may exchange a few, which moves the base that shading
// is measured from: alike in both pictures, unless one of them is of the empty gel (0.027 of log2).
TEST(Imprint, EqualsTheReferenceInDouble) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  double worst = 0.0, worst_touch = 0.0, worst_growth = 0.0, worst_coarse = 0.0, worst_turnover = 0.0;
  std::vector<double> plain;
  int still = 0, coarse = 0, turned = 0;
  for (int trial = 0; trial < 6; ++trial) {
    Gel gel;
    if (trial % 3 == 1) gel = {.px_per_mm = 14.43, .width = 410, .height = 308};
    const bool smooth = trial >= 4;
    gel.noise = trial % 2 == 0 ? 0.0 : smooth ? 0.7 : 2.0;
    if (smooth) gel.light = [](Mm at) { return 8.0 * std::sin(1.1 * at.x + 0.4) + 6.0 * std::cos(0.9 * at.y); };
    Bench bench(gel, true, trial);
    Mm dots{}, object{};
    const double levels = 4.0 + trial;
    for (int k = 0; k < 20; ++k) {
      if (k > 4) dots = {dots.x + 0.02 * uniform(random), dots.y + 0.02 * uniform(random)};
      object = k < 10 ? dots : Mm{object.x + 0.03 * uniform(random), object.y + (trial == 3 ? 0.06 : 0.02)};
      bench.gel.dots = dots;
      bench.gel.bend = [=](Mm at) { return Mm{0.004 * k * std::sin(at.x + at.y), -0.002 * k * std::cos(at.y)}; };
      const auto fine = [=](Mm at) { return grain(levels, object)(at) + ribs(trial % 2 * levels, 0.5, object)(at); };
      bench.gel.relief = smooth ? dome(30.0 + 3.0 * (k % 3), object) : within(kContact_mm, fine);
      const ImprintFeatures seen = bench.step();
      const test::ImprintReference::Seen& expected = bench.expected;
      CHECK(seen.patches.raw() >= expected.least_patches && seen.patches.raw() <= expected.most_patches);
      double& grown = k < 4 ? worst_touch : worst_growth;
      grown = std::max(grown, std::abs(seen.growth.raw() / 256.0 - expected.growth));
      if (expected.tells_coarse()) {
        CHECK_EQUAL(expected.coarse_um > 1.0, seen.coarse.raw() > 0);
        if (seen.coarse.raw() == 0) ++still;
      }
      if (expected.tells_coarse() && seen.coarse.raw() > 0) {
        // An error of the whole square weighs more in what is left of it.
        const double off = std::abs(seen.coarse.raw() / 256.0 - std::log2(expected.coarse_um));
        worst_coarse = std::max(worst_coarse, expected.coarse_left * off);
        ++coarse;
      }
      if (expected.tells_turnover()) {
        worst_turnover = std::max(worst_turnover, std::abs(seen.turnover.raw() / 1024.0 - expected.turnover));
        turned += expected.turnover > 0.02 ? 1 : 0;
      }
      CHECK(test::ImprintReference::may_move(expected, seen.motion.raw()));
      // Below a tenth of a sample, and with next to no relief, it is rounding that is measured.
      if (smooth || seen.motion.raw() == 0 || expected.motion_um < 10.0) continue;
      worst = std::max(worst, test::ImprintReference::off(expected, seen.motion.raw()));
      plain.push_back(std::abs(seen.motion.raw() / 256.0 - std::log2(expected.motion_um)));
    }
  }
  CHECK(plain.size() > 20);
  CHECK(coarse > 10);
  CHECK(still > 10);
  std::sort(plain.begin(), plain.end());
  std::printf("\nimprint against double: median %.4f of log2 in %zu motions, ", plain[plain.size() / 2], plain.size());
  std::printf(
      "worst %.4f beyond other ranks of the noise; growth worst %.4f, from an empty gel %.4f; coarse worst %.4f of "
      "%d; turnover worst %.4f of %d\n",
      worst, worst_growth, worst_touch, worst_coarse, coarse, worst_turnover, turned);
  CHECK(worst <= 3.0 / 256);
  CHECK(plain[plain.size() / 2] <= 2.0 / 256);
  CHECK(worst_touch <= 0.04);
  CHECK(worst_growth <= 3.0 / 256);
  CHECK(worst_coarse <= 4.0 / 256);
  CHECK(turned > 10);
  CHECK(worst_turnover <= 0.01);
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
                                                   gel.field({}), gel.pitch(), bench.time, bench.saturations);
      CHECK(seen.patches.raw() <= imprint::kMaxPatches);
    }
    // Black and white pixels by turns: the largest differences there are.
    for (std::size_t i = 0; i < flat.size(); ++i) flat[i] = (i / 16 + i / 5120) % 2 == 0 ? 0 : 255;
    for (int k = 0; k < 20; ++k) {
      bench.time += Micros{40'000};
      (void)imprint::update(*bench.state, bench.config, view, gel.field({}), gel.field({}), gel.pitch(), bench.time,
                            bench.saturations);
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
                                                 gel.pitch(), bench.time, bench.saturations);
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
          (void)imprint::update(*state, {}, view, gel.field({0.3 * k, 0.1 * k}), rest, gel.pitch(),
                                Micros{40'000 * (k + 1)}, saturations);
          if (k < 2) imprint::learn_empty(*state, {});
        }
        LONGS_EQUAL(0, saturations.count);
        // A single line tells nothing of what lies beside it.
        if (grid.rows > 1 && grid.cols > 1) continue;
        LONGS_EQUAL(0, usable(*state));
      }
    }
  }
}

TEST_GROUP(ImprintTwins){};

// The darkest and the brightest pixels in every pattern, every fraction of a pixel, and anything.
TEST(ImprintTwins, VectorFormGivesThePlainFormsIntegers) {
  std::mt19937 random(11);
  imprint::Squares squares{};
  imprint::Spots spots{};
  for (int trial = 0; trial < 2000; ++trial) {
    for (std::size_t s = 0; s < squares.size(); ++s) {
      const auto pattern = static_cast<std::uint32_t>(random());
      for (std::size_t k = 0; k < 4; ++k) {
        const auto any = static_cast<std::uint32_t>(random() % 4081);
        squares[s][k] = static_cast<std::uint16_t>(trial % 2 == 0 ? any : (pattern >> k & 1u) * 4080);
      }
      const auto place = [&](bool any, std::uint32_t rim) {
        return static_cast<std::int32_t>(any ? random() >> 8 : rim + 4096 * s);
      };
      spots[s / imprint::kLanes].x_q12[s % imprint::kLanes] = place(trial % 3 == 0, (pattern >> 4 & 1u) * 4095);
      spots[s / imprint::kLanes].y_q12[s % imprint::kLanes] = place(trial % 3 == 1, (pattern >> 5 & 1u) * 4080);
    }
    imprint::Eight<std::int16_t> vector{}, plain{};
    imprint::blend(squares, spots, vector);
    imprint::blend_scalar(squares, spots, plain);
    CHECK(vector == plain);
    // By hand, in double: fractions of 1/256 are exact in it.
    const double fx = (spots[0].x_q12[0] / 16 % 256) / 256.0, fy = (spots[0].y_q12[0] / 16 % 256) / 256.0;
    const double above = squares[0][0] * (1 - fx) + squares[0][1] * fx,
                 below = squares[0][2] * (1 - fx) + squares[0][3] * fx;
    LONGS_EQUAL(static_cast<long>(std::floor(above * (1 - fy) + below * fy + 0.5)), vector[0]);
  }
}
