// SPDX-License-Identifier: Apache-2.0
// Oracles: closed forms of domes that shift and turn on a symmetric lattice, and the definition in double
// (support/coarse_reference.hpp).
#include "tactile/coarse.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "tests/support/coarse_reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

using coarse::Patch;
using Patches = std::vector<Patch>;

constexpr std::int32_t kStep_q8 = 1787;  // of a pitch of 2.02 mm: log2(2020 um / 16)
constexpr double kStepsPerQuarter = 4.0;

std::int32_t rounded(double value) {
  return static_cast<std::int32_t>(std::lround(value));
}

std::int32_t moved(const Patches& patches, coarse::Carried carried = {}) {
  Saturations saturations;
  const Log2Q8 motion = coarse::motion(patches, carried, kStep_q8, saturations);
  LONGS_EQUAL(0, saturations.count);
  return motion.raw();
}

double steps(std::int32_t motion) {
  return std::exp2((motion - kStep_q8) / 256.0);
}

test::CoarseSeen expected_of(const Patches& patches) {
  std::vector<test::CoarsePatch> in;
  for (const Patch& p : patches) {
    in.push_back({p.change / 400.0, p.shading / 800.0, p.slope_x / 1600.0, p.slope_y / 1600.0, p.empty_x / 800.0,
                  p.empty_y / 800.0, double(p.x), double(p.y)});
  }
  return test::coarse_reference(in);
}

// Both logarithms are rounded to 1/256, and half of their difference is rounded again: 0.5 and 0.5 of it. 0.9 is the
// most that was seen. The products behind them are exact to 2^-46; what the evidence is the difference of can be a
// thousand times as large as itself, below that it is not compared.
constexpr double kRounding = 1.0;  // log2 in Q8
constexpr double kLeastSignal = 0.001;

void equals_reference(const Patches& patches, const char* what) {
  const test::CoarseSeen expected = expected_of(patches);
  const std::int32_t motion = moved(patches);
  if (std::abs(expected.signal) < kLeastSignal) return;
  if (expected.motion_steps == 0.0) {
    CHECK_EQUAL_TEXT(0, motion, what);
    return;
  }
  const double want = std::max(0.0, kStep_q8 + 256.0 * std::log2(expected.motion_steps));
  CHECK_TEXT(std::abs(want - motion) <= kRounding,
             (std::string(what) + ": " + std::to_string(want) + " is " + std::to_string(motion)).c_str());
}

// --- Pictures on a lattice of 7 x 9 dots, symmetric about its middle. Places in steps. ---

struct Level {
  double c = 0.0, dx = 0.0, dy = 0.0;
};

// An even rise of light over the empty gel is a constant slope, which the constant mode has already.
template <typename Picture>
Patches seen(const Picture& then, const Picture& now) {
  Patches out;
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 9; ++col) {
      for (const int sy : {1, -1}) {
        for (const int sx : {1, -1}) {
          Patch p;
          p.x = 4 * col - 16 + sx;
          p.y = 4 * row - 12 + sy;
          const Level a = then(kStepsPerQuarter * p.x, kStepsPerQuarter * p.y);
          const Level b = now(kStepsPerQuarter * p.x, kStepsPerQuarter * p.y);
          p.change = rounded(400.0 * (b.c - a.c));
          p.shading = rounded(400.0 * (b.c + a.c));
          p.slope_x = rounded(800.0 * (b.dx + a.dx));
          p.slope_y = rounded(800.0 * (b.dy + a.dy));
          p.empty_x = 40;
          out.push_back(p);
        }
      }
    }
  }
  return out;
}

// The light on a ball: 40 levels, 24 steps (3 mm) of sigma.
struct Dome {
  double x0 = 0.0, y0 = 0.0;
  static constexpr double kHeight = 40.0, kSigma = 24.0;
  Level operator()(double x, double y) const {
    const double u = x - x0, v = y - y0;
    const double c = kHeight * std::exp(-(u * u + v * v) / (2.0 * kSigma * kSigma));
    return {c, -c * u / (kSigma * kSigma), -c * v / (kSigma * kSigma)};
  }
};

// Long along x: a bar, whose shading falls as a square. Its shifts are a linear change of light, its turns are not.
struct Bar {
  double turn = 0.0;  // rad
  static constexpr double kAlong = 0.002, kAcross = 0.01;
  Level operator()(double x, double y) const {
    const double co = std::cos(turn), si = std::sin(turn);
    const double u = co * x + si * y, v = -si * x + co * y;
    const double du = -2.0 * kAlong * u, dv = -2.0 * kAcross * v;
    return {60.0 - kAlong * u * u - kAcross * v * v, co * du - si * dv, si * du + co * dv};
  }
};

// --- Patches without a picture ---

double within(std::mt19937& random, double most) {
  return std::uniform_real_distribution<double>(-most, most)(random);
}

// Shading, slopes and places that have nothing to do with each other.
Patches any(std::mt19937& random, std::size_t n, double slope = 0.5, double shading = 20.0) {
  Patches out(n);
  for (Patch& p : out) {
    p.shading = rounded(800.0 * within(random, shading));
    p.slope_x = rounded(1600.0 * within(random, slope));
    p.slope_y = rounded(1600.0 * within(random, slope));
    p.empty_x = rounded(800.0 * within(random, 0.1));
    p.empty_y = rounded(800.0 * within(random, 0.1));
    p.x = rounded(within(random, 19.0));
    p.y = rounded(within(random, 15.0));
  }
  return out;
}

// Change of each patch by `levels`, added.
template <typename Levels>
void add(Patches& patches, const Levels& levels) {
  for (Patch& p : patches) p.change += rounded(400.0 * levels(p));
}

void add_shift(Patches& patches, double x_steps, double y_steps) {
  add(patches, [=](const Patch& p) { return (x_steps * p.slope_x + y_steps * p.slope_y) / 1600.0; });
}

// What a sticking contact explains; the largest changes are about 30 levels.
struct Nuisance {
  const char* name;
  double (*levels)(const Patch&);
};
constexpr std::array<Nuisance, 7> kNuisances{{
    {"constant light", [](const Patch&) { return 30.0; }},
    {"light along x", [](const Patch& p) { return 1.5 * p.x; }},
    {"light along y", [](const Patch& p) { return -2.0 * p.y; }},
    {"pressure", [](const Patch& p) { return 1.5 * p.shading / 800.0; }},
    {"dilation", [](const Patch& p) { return 1.5 * (p.x * p.slope_x + p.y * p.slope_y) / 1600.0; }},
    {"movement along x over the empty gel", [](const Patch& p) { return 300.0 * p.empty_x / 800.0; }},
    {"movement along y over the empty gel", [](const Patch& p) { return 300.0 * p.empty_y / 800.0; }},
}};

}  // namespace

TEST_GROUP(Coarse){};

// What is left of slope_x is odd in x and even in y; of the modes that stick only the light along x is so too. So the
// shift explains d^2 (S_x - L_x), with S_x = sum slope_x^2 and L_x = (sum x slope_x)^2 / sum x^2, and along y likewise.
// Rounding as above; the dome bends by 1/1000 of its slope within the shift.
TEST(Coarse, ADomeThatShiftsMovesByItsShareOfTheLength) {
  for (const auto& [dx, dy] : {std::array{0.5, 0.0}, {1.5, 0.0}, {0.0, -1.5}, {1.0, 1.0}, {-2.0, 1.0}}) {
    double s_x = 0, s_y = 0, x_s = 0, y_s = 0, x_x = 0, y_y = 0;
    const Patches patches = seen(Dome{-dx / 2, -dy / 2}, Dome{dx / 2, dy / 2});
    for (const Patch& p : patches) {
      const double x = kStepsPerQuarter * p.x, y = kStepsPerQuarter * p.y;
      const Level at = Dome{}(x, y);
      s_x += at.dx * at.dx;
      s_y += at.dy * at.dy;
      x_s += x * at.dx;
      y_s += y * at.dy;
      x_x += x * x;
      y_y += y * y;
    }
    const double explained = dx * dx * (s_x - x_s * x_s / x_x) + dy * dy * (s_y - y_s * y_s / y_y);
    const double energy = (s_x + s_y) / 2.0 + 0.01 * 252.0;
    const double expected = std::sqrt((explained - 33.0 * 0.02) / energy);
    const double motion = steps(moved(patches));
    DOUBLES_EQUAL(expected, motion, expected * (kRounding / 256.0 * std::log(2.0) + 0.003));
    // And that is about the length, less what linear light could have done.
    const double length = std::hypot(dx, dy);
    CHECK_TEXT(motion > 0.6 * length && motion < 1.1 * length, std::to_string(motion / length).c_str());
  }
}

// c = c0 - a x^2 - b y^2: the turn changes the picture by 2 angle (b - a) x y, which no sticking mode has on a
// symmetric lattice.
TEST(Coarse, ABarThatTurnsMovesByItsAngle) {
  for (const double angle : {0.01, -0.03}) {
    const Patches patches = seen(Bar{-angle / 2}, Bar{angle / 2});
    double turned = 0, energy = 0.01 * 252.0;
    for (const Patch& p : patches) {
      const double x = kStepsPerQuarter * p.x, y = kStepsPerQuarter * p.y;
      turned += std::pow(2.0 * angle * (Bar::kAcross - Bar::kAlong) * x * y, 2);
      energy += (std::pow(2.0 * Bar::kAlong * x, 2) + std::pow(2.0 * Bar::kAcross * y, 2)) / 2.0;
    }
    const double expected = std::sqrt((turned - 33.0 * 0.02) / energy);
    DOUBLES_EQUAL(expected, steps(moved(patches)), expected * (kRounding / 256.0 * std::log(2.0) + 0.003));
  }
}

// A contact that grows brightens and spreads about its own middle, wherever that is on the gel, and no rigid motion
// does that: 0, or what is left is noise.
TEST(Coarse, ADomeThatGrowsDoesNotMove) {
  struct Growing {
    double height, sigma;
    Level operator()(double x, double y) const {
      const double c = height * std::exp(-(x * x + y * y) / (2.0 * sigma * sigma));
      return {c, -c * x / (sigma * sigma), -c * y / (sigma * sigma)};
    }
  };
  LONGS_EQUAL(0, moved(seen(Growing{30.0, 20.0}, Growing{40.0, 24.0})));
  LONGS_EQUAL(0, moved(seen(Growing{40.0, 24.0}, Growing{30.0, 20.0})));
  LONGS_EQUAL(0, moved(seen(Growing{0.0, 20.0}, Growing{40.0, 20.0})));
}

// Slopes along x that are half the nuisance itself: a shift would explain it as well, were it not taken out before.
TEST(Coarse, WhatAStuckContactExplainsIsNoMotion) {
  for (const Nuisance& nuisance : kNuisances) {
    std::mt19937 random(11);
    Patches patches = any(random, 240);
    for (Patch& p : patches) {
      p.x += 25;  // all on one side: dilation shares with the shift
      p.y += 5;
    }
    for (Patch& p : patches) {
      const Patch before = p;
      if (std::string(nuisance.name) != "dilation") p.slope_x += rounded(1600.0 * 0.02 * nuisance.levels(before));
    }
    add(patches, nuisance.levels);
    const std::int32_t alone = moved(patches);
    CHECK_EQUAL_TEXT(0, alone, nuisance.name);
  }
}

// On top of a motion each nuisance takes from it no more than it shares with it, and adds nothing to the noise.
// sqrt(motion^2 - carried^2); 2/256: of two logarithms, rounded.
TEST(Coarse, LosesWhatBeingCarriedExplains) {
  const Patches patches = seen(Dome{}, Dome{2.0, 1.0});
  const double alone = steps(moved(patches));
  CHECK(alone > 0.7);
  for (const double carried : {0.1, 0.3, 0.9}) {
    const auto steps2_q20 = static_cast<std::int64_t>(std::lround(1048576.0 * carried * carried * alone * alone));
    const double exact = alone * std::sqrt(1.0 - carried * carried);
    DOUBLES_EQUAL(std::log2(exact), std::log2(steps(moved(patches, {steps2_q20}))), 3.0 / 256);
  }
  LONGS_EQUAL(0, moved(patches, {static_cast<std::int64_t>(1048576.0 * 1.1 * alone * alone)}));
  LONGS_EQUAL(0, moved(patches, {std::int64_t{1} << 31}));
}

// Against double, over all sizes of energy; 2^-20: of the 30 bits that are kept, and one unit of what is left.
TEST(Coarse, ExplainedEvidenceIsTheEnergysShare) {
  for (int bits = 10; bits < 62; ++bits) {
    for (const std::int64_t carried : {0LL, 1LL, 700LL, 1LL << 20, 1LL << 31}) {
      const std::int64_t energy = (std::int64_t{1} << bits) + 12345;
      const double exact = static_cast<double>(energy) * static_cast<double>(carried) / 1048576.0 * 625.0 / 68.0;
      const double expected = std::min(exact, std::ldexp(1.0, 62));
      DOUBLES_EQUAL(expected, static_cast<double>(coarse::explained({carried}, energy, 625, 68)),
                    std::ldexp(expected, -20) + std::ldexp(10.0, std::max(bits - 29, 0)));
    }
  }
}

TEST(Coarse, NoNuisanceHidesAShift) {
  for (const Nuisance& nuisance : kNuisances) {
    std::mt19937 random(12);
    Patches patches = any(random, 240);
    add_shift(patches, 1.0, -0.5);
    const std::int32_t plain = moved(patches);
    CHECK(plain > kStep_q8 - 128);  // 0.7 steps; what stands along the modes that stick is lost
    add(patches, nuisance.levels);
    CHECK_TEXT(std::abs(moved(patches) - plain) <= 1 + kRounding, nuisance.name);
  }
}

// Chance of 3 motions to reach 11 times the noise: F(3, n - 10) > 11, which is 1e-6 with 240 patches and 2e-3 with the
// fewest. Noise of 2 levels: 200 times the floor.
TEST(Coarse, NoiseAloneDoesNotMove) {
  std::mt19937 random(13);
  std::normal_distribution<double> normal(0.0, 2.0);
  int alarms = 0, few_alarms = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    for (const std::size_t n : {std::size_t{240}, std::size_t{coarse::kLeastPatches}}) {
      Patches patches = any(random, n);
      add(patches, [&](const Patch&) { return normal(random); });
      (n == 240 ? alarms : few_alarms) += moved(patches) > 0 ? 1 : 0;
    }
  }
  LONGS_EQUAL(0, alarms);
  CHECK_TEXT(few_alarms <= 12, std::to_string(few_alarms).c_str());  // 3.5 expected, 12 in one of 7000 seeds
}

// 33 times 0.02 levels^2: a shift that explains 0.6 is none, one that explains 0.75 is one.
TEST(Coarse, AShiftMustExceedTheFloor) {
  for (const auto& [explained, moves] : {std::pair{0.60, false}, {0.75, true}}) {
    std::mt19937 random(14);
    Patches patches = any(random, 240);
    Patches scaled = patches;
    add_shift(scaled, 1.0, 0.0);
    // As much of 1 step as explains so much: motion^2 * energy + 33 noise.
    double energy = 0.01 * 240.0;
    for (const Patch& p : patches) energy += (std::pow(p.slope_x / 1600.0, 2) + std::pow(p.slope_y / 1600.0, 2)) / 2.0;
    const double of_one = std::pow(expected_of(scaled).motion_steps, 2) * energy + 33.0 * 0.02;
    add_shift(patches, std::sqrt(explained / of_one), 0.0);
    CHECK_EQUAL(moves, moved(patches) > 0);
  }
}

// Everything at once, from the fewest patches to the most, from weak slopes to strong ones.
TEST(Coarse, EqualsTheReferenceInDouble) {
  std::mt19937 random(15);
  int moves = 0, still = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const std::size_t n = std::array<std::size_t, 6>{20, 21, 40, 100, 252, 320}[std::size_t(trial) % 6];
    Patches patches = any(random, n, std::exp2(within(random, 5.0)), std::exp2(4.0 + within(random, 4.0)));
    const double x_steps = within(random, 2.0), y_steps = within(random, 2.0), turn = within(random, 0.1);
    add_shift(patches, x_steps, y_steps);
    add(patches, [=](const Patch& p) { return turn * (p.x * p.slope_y - p.y * p.slope_x) / 1600.0; });
    for (const Nuisance& nuisance : kNuisances) {
      const double times = within(random, 0.3);
      add(patches, [&](const Patch& p) { return times * nuisance.levels(p); });
    }
    const double noise = std::exp2(within(random, 5.0) - 2.0);
    add(patches, [&](const Patch&) { return within(random, noise); });
    for (Patch& p : patches) {  // as documented
      const auto keep = [](std::int32_t& value, std::int32_t most) { value = std::clamp(value, -most, most); };
      keep(p.change, (1 << 18) - 1);
      keep(p.shading, (1 << 18) - 1);
      keep(p.slope_x, (1 << 19) - 1);
      keep(p.slope_y, (1 << 19) - 1);
    }
    const test::CoarseSeen expected = expected_of(patches);
    if (expected.signal > kLeastSignal) ++moves;
    if (expected.signal < -kLeastSignal) ++still;
    equals_reference(patches, ("trial " + std::to_string(trial)).c_str());
  }
  CHECK_TEXT(moves > 100 && still > 50, (std::to_string(moves) + " " + std::to_string(still)).c_str());
}

TEST(Coarse, FewerPatchesThanTheLeastSayNothing) {
  std::mt19937 random(16);
  Patches patches = any(random, coarse::kLeastPatches);
  add_shift(patches, 5.0, 0.0);
  CHECK(moved(patches) > 0);
  patches.pop_back();
  LONGS_EQUAL(0, moved(patches));
  LONGS_EQUAL(0, moved({}));
}

// A motion below 1 um is 0, and so is none.
TEST(Coarse, LessThanAMicrometreIsNone) {
  std::mt19937 random(17);
  Patches patches = any(random, 240, 300.0);
  add_shift(patches, 0.006, 0.0);  // 0.76 um
  CHECK(expected_of(patches).motion_steps > 0.0);
  LONGS_EQUAL(0, moved(patches));
}

TEST(Coarse, NothingButZerosIsNone) {
  LONGS_EQUAL(0, moved(Patches(coarse::kLeastPatches)));
  LONGS_EQUAL(0, moved(Patches(coarse::kMostPatches)));
}

// Modes that are zero, or that others have already, are left out; the rest is as the double finds it.
TEST(Coarse, ModesThatAreMissing) {
  struct Case {
    const char* name;
    void (*change)(Patch&);
  };
  constexpr std::array<Case, 9> kCases{{
      {"places on a line along y", [](Patch& p) { p.x = 7; }},
      {"places on a line along x", [](Patch& p) { p.y = 0; }},
      {"places at one point", [](Patch& p) { p.x = p.y = -3; }},
      {"no shading", [](Patch& p) { p.shading = 0; }},
      {"shading everywhere alike", [](Patch& p) { p.shading = 4000; }},
      {"no empty slopes", [](Patch& p) { p.empty_x = p.empty_y = 0; }},
      {"no slope along y", [](Patch& p) { p.slope_y = 0; }},
      {"both slopes alike", [](Patch& p) { p.slope_y = p.slope_x; }},
      {"slopes of the empty gel",
       [](Patch& p) {
         p.slope_x = 2 * p.empty_x;
         p.slope_y = 2 * p.empty_y;
       }},
  }};
  for (const Case& one : kCases) {
    std::mt19937 random(18);
    Patches patches = any(random, 240);
    for (Patch& p : patches) one.change(p);
    add_shift(patches, 2.0, 0.0);
    std::normal_distribution<double> normal(0.0, 0.1);
    add(patches, [&](const Patch&) { return normal(random); });
    equals_reference(patches, one.name);
    const bool told = std::string(one.name) != "slopes of the empty gel";
    CHECK_EQUAL_TEXT(told, moved(patches) > 0, one.name);
  }
  std::mt19937 random(19);
  Patches flat = any(random, 240);
  for (Patch& p : flat) {
    p.slope_x = p.slope_y = 0;
    p.change = rounded(within(random, 4000.0));
  }
  LONGS_EQUAL(0, moved(flat));
}

// Less than 1/32 of its length of its own, and a mode is none: a shift along it is noise then.
TEST(Coarse, AModeCountsFromAThirtySecondthOfItsOwn) {
  for (const auto& [part, told] : {std::pair{10, true}, {25, true}, {40, false}}) {
    std::mt19937 random(21);
    Patches patches = any(random, 240, 4.0);
    for (Patch& p : patches) p.slope_y = p.slope_x + p.slope_y / part;
    add_shift(patches, part, -part);
    equals_reference(patches, std::to_string(part).c_str());
    CHECK_EQUAL_TEXT(told, moved(patches) > 0, std::to_string(part).c_str());
  }
}

// Each mode lies along what the one before has of its own, but for a thirtieth: rounding grows a thousand times from
// one to the next. Nothing wraps (sanitizers see to it), and what three such leave is still as in double.
TEST(Coarse, ModesThatHardlyCountInARow) {
  for (const int chain : {3, 6}) {
    for (unsigned seed = 0; seed < 20; ++seed) {
      std::mt19937 random(seed);
      Patches patches(320);
      for (Patch& p : patches) {
        const auto sign = [&] { return random() % 2 == 0 ? 1 : -1; };
        const int first = 3 * sign(), second = 3 * sign(), third = 3000 * sign(), fourth = 300 * sign();
        p.x = 90 + first;
        p.y = 30 * first + second;
        p.shading = 30'000 * second + third;
        if (chain > 3) {
          p.empty_x = 30 * third + 3 * fourth;
          p.empty_y = 30 * 3 * fourth + 900 * sign();
        }
        p.slope_x = rounded(1600.0 * within(random, 4.0));
      }
      add_shift(patches, 2.0, 0.0);
      add(patches, [](const Patch& p) { return 0.01 * p.shading / 800.0 + 0.1 * p.x; });
      std::normal_distribution<double> normal(0.0, 0.1);
      add(patches, [&](const Patch&) { return normal(random); });
      CHECK(moved(patches) >= 0);
      if (chain == 3) equals_reference(patches, std::to_string(seed).c_str());
    }
  }
}

// Every number at its largest, with random signs: what wrapped would not equal the double (and sanitizers see to it).
TEST(Coarse, ExtremesOfTheRangesDoNotWrap) {
  constexpr std::int32_t kLevel = (1 << 18) - 1, kSlope = (1 << 19) - 1, kPlace = 127;
  for (const std::size_t n : {std::size_t{coarse::kLeastPatches}, std::size_t{coarse::kMostPatches}}) {
    // All alike: one constant, nothing else.
    LONGS_EQUAL(0, moved(Patches(n, {kLevel, kLevel, kSlope, kSlope, kSlope, kSlope, kPlace, kPlace})));
    LONGS_EQUAL(0, moved(Patches(n, {kLevel, kLevel, kSlope, kSlope, kSlope, kSlope, 255, 0})));
    LONGS_EQUAL(0, moved(Patches(n, {-kLevel, -kLevel, -kSlope, -kSlope, -kSlope, -kSlope, -kPlace, -kPlace})));
    int moves = 0;
    for (int trial = 0; trial < 60; ++trial) {
      std::mt19937 random(static_cast<unsigned>(20 + trial));
      Patches patches(n);
      for (std::size_t i = 0; i < n; ++i) {
        // At the largest, or in the upper half of the range: wrapped, those would no longer lie along each other.
        const auto any_of = [&](std::int32_t most) {
          const std::int32_t size =
              trial % 2 == 0 ? most : most - static_cast<std::int32_t>(random() % unsigned(most / 2));
          return random() % 2 == 0 ? size : -size;
        };
        const int by_turns = i % 2 == 0 ? 1 : -1;
        Patch& p = patches[i];
        p.shading = any_of(kLevel);
        p.slope_x = any_of(kSlope);
        p.slope_y = any_of(kSlope);
        p.empty_x = any_of(kSlope);
        p.empty_y = any_of(kSlope);
        p.x = any_of(kPlace);
        p.y = any_of(kPlace);
        if (trial % 3 == 1) p.slope_x = by_turns * kSlope;
        if (trial % 3 == 2) p.x = kPlace;
        // Along a shift, a shift under much dilation, a turn, and none of them.
        const double shift = double(p.slope_x) / kSlope;
        const double dilation = (double(p.x) * p.slope_x + double(p.y) * p.slope_y) / (2.0 * kPlace * kSlope);
        const double turn = (double(p.x) * p.slope_y - double(p.y) * p.slope_x) / (2.0 * kPlace * kSlope);
        const std::array<double, 4> parts{shift, 0.1 * shift + 0.9 * dilation, turn, double(by_turns)};
        p.change = rounded(kLevel * parts[std::size_t(trial) / 3 % 4]);
      }
      equals_reference(patches, ("trial " + std::to_string(trial)).c_str());
      moves += moved(patches) > 0 ? 1 : 0;
    }
    CHECK_TEXT(moves > 16, std::to_string(moves).c_str());
  }
  // The longest motion there is: the largest change over slopes of one unit.
  Patches patches(coarse::kMostPatches);
  for (std::size_t i = 0; i < patches.size(); ++i) {
    patches[i].slope_x = i % 2 == 0 ? 1 : -1;
    patches[i].change = i % 2 == 0 ? kLevel : -kLevel;
  }
  equals_reference(patches, "longest");
  CHECK(moved(patches) > kStep_q8 + 12 * 256);
}
