// SPDX-License-Identifier: Apache-2.0
// Oracles: the sums of the header in double over all 63 markers, weights unfolded by their symmetry; the layer's closed
// form, and its integral over the whole surface; fields whose answers are known. How exact readings are on frictional
// contacts: host/loads_test.cpp.
#include "tactile/load.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

#include "drivers/sim/scene/contact/layer.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

constexpr int kRows = 7, kCols = 9, kCount = 63;

struct Vec {
  double x = 0.0;
  double y = 0.0;
};

Vec place_mm(int i) {
  const int row = i / kCols, col = i % kCols;
  return {(col - 4) * 2.02, (row - 3) * 2.02};
}

void put(DisplacementField& field, int i, Vec um) {
  field.markers[idx(i)] = {Micrometres::from_raw(static_cast<std::int32_t>(std::lround(um.x))),
                           Micrometres::from_raw(static_cast<std::int32_t>(std::lround(um.y))), true};
}

template <typename At>
DisplacementField field_of(At at) {
  DisplacementField field;
  field.grid = {kRows, kCols};
  for (int i = 0; i < kCount; ++i) put(field, i, at(place_mm(i)));
  return field;
}

// Weight of marker i's x (part 0) or y (part 1) of a figure that is odd (-1) or even (1) in either direction.
double weight(const std::array<std::int32_t, load::kFolded>& folded, int part, int odd_x, int odd_y, int i) {
  const int row = i / kCols, col = i % kCols;
  const int r = std::min(row, kRows - 1 - row), c = std::min(col, kCols - 1 - col);
  // The middle is its own mirror image: two places of the fold, one marker.
  double w = folded[idx(part * 20 + r * 5 + c)] / 65536.0;
  if (col == 4) w *= odd_x > 0 ? 2 : 0;
  if (row == 3) w *= odd_y > 0 ? 2 : 0;
  if (odd_x < 0 && col < 4) w = -w;
  if (odd_y < 0 && row < 3) w = -w;
  return w;
}

struct Reference {
  double shear_x = 0, shear_y = 0, normal = 0;
  double across = 0;
};

using Field = std::array<Vec, kCount>;

double figure(const Field& u, const std::array<std::int32_t, load::kFolded>& w, int odd_x, int odd_y) {
  double sum = 0;
  // A figure of x that is odd in x is of y odd in y, and so on: one is the other's mirror at the diagonal.
  for (int i = 0; i < kCount; ++i) {
    sum += weight(w, 0, odd_x, odd_y, i) * u[idx(i)].x + weight(w, 1, -odd_x, -odd_y, i) * u[idx(i)].y;
  }
  return sum;
}

Reference forces(const Field& u, const load::Weights& w) {
  Reference out;
  out.shear_x = figure(u, w.shear_x, 1, 1);
  // Along y the parts are exchanged: x is odd in both directions, y even.
  out.shear_y = figure(u, w.shear_y, -1, -1);
  const double p0 = figure(u, w.normal, -1, 1);
  const double whole = out.shear_x * out.shear_x + out.shear_y * out.shear_y + p0 * p0 / 25 + 100;
  const double c = (out.shear_x * out.shear_x - out.shear_y * out.shear_y) / whole;
  const double s = 2 * out.shear_x * out.shear_y / whole;
  out.normal = p0 + c * figure(u, w.normal_c, -1, 1) + s * figure(u, w.normal_s, 1, -1);
  return out;
}

Reference reference_of(const DisplacementField& field) {
  Field u{};
  for (int i = 0; i < kCount; ++i) {
    Vec sum;
    int n = 0;
    for (int j = 0; j < kCount; ++j) {
      const bool itself = field.markers[idx(i)].valid;
      const bool near = itself ? i == j : std::abs(i % kCols - j % kCols) <= 1 && std::abs(i / kCols - j / kCols) <= 1;
      if (!near || !field.markers[idx(j)].valid) continue;
      sum = {sum.x + field.markers[idx(j)].dx.raw(), sum.y + field.markers[idx(j)].dy.raw()};
      ++n;
    }
    if (n > 0) u[idx(i)] = {sum.x / n, sum.y / n};
  }
  Vec all;
  double energy = 0;
  std::array<Vec, 4> edges{};
  for (int i = 0; i < kCount; ++i) {
    const Vec d = u[idx(i)];
    all = {all.x + d.x, all.y + d.y};
    energy += d.x * d.x + d.y * d.y;
    const std::array<bool, 4> at{i % kCols == 0, i % kCols == 8, i / kCols == 0, i / kCols == 6};
    for (std::size_t k = 0; k < 4; ++k) {
      if (at[k]) edges[k] = {edges[k].x + d.x, edges[k].y + d.y};
    }
  }
  const double whole = all.x * all.x + all.y * all.y + 63 * energy / 8 + 126 * 126;
  const auto mean = [&](std::size_t k) { return (edges[k].x * all.x + edges[k].y * all.y) * (k < 2 ? 9 : 7) / whole; };
  const double both = std::max(std::min(mean(0), mean(1)), std::min(mean(2), mean(3)));
  Reference out;
  out.across = std::clamp((both - 0.4) / 0.25, 0.0, 1.0);
  const Reference a = forces(u, load::kWeights[0]), b = forces(u, load::kWeights[1]);
  const auto mix = [&](double x, double y) { return x + out.across * (y - x); };
  out.shear_x = mix(a.shear_x, b.shear_x);
  out.shear_y = mix(a.shear_y, b.shear_y);
  out.normal = mix(a.normal, b.normal);
  return out;
}

constexpr scene::Gel kGel{.shear_modulus_mpa = 0.035, .poisson = 0.49, .thickness_mm = 4.25};

// A dome of `force_mn` along an angle over a disc, and one of `press_mn` into the gel, around `at`.
DisplacementField domes(const scene::Layer& layer, Vec at, double radius, double force_mn, double angle,
                        double press_mn) {
  const double per_mn = 1e-3 * 1.5 / (std::numbers::pi * radius * radius * radius);
  return field_of([&](Vec g) {
    const double dx = g.x - at.x, dy = g.y - at.y, r = std::hypot(dx, dy);
    const double c = r > 0 ? dx / r : 1, s = r > 0 ? dy / r : 0;
    const scene::Spread shear = layer.dome(radius, r);
    const double cc = c * c - s * s, ss = 2 * c * s, fx = std::cos(angle), fy = std::sin(angle);
    const double out = per_mn * press_mn * layer.press_outward(radius, r);
    const double k = per_mn * force_mn;
    return Vec{1e3 * (k * ((shear.mean + shear.fan * cc) * fx + shear.fan * ss * fy) + out * c),
               1e3 * (k * (shear.fan * ss * fx + (shear.mean - shear.fan * cc) * fy) + out * s)};
  });
}

}  // namespace

TEST_GROUP(Load) {
  load::Config config;
  Saturations saturations;
  std::mt19937 random{11};

  load::Load read(const DisplacementField& field) {
    return load::update(config, field, saturations);
  }
  double drawn(double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(random);
  }
};

// Half a millinewton of rounding in each figure, and a part in 4096 of the direction.
TEST(Load, IsTheWeightedSumsInDouble) {
  for (int round = 0; round < 2000; ++round) {
    const double size = std::pow(10.0, drawn(0.0, 3.0));
    const Vec mean{drawn(-size, size), drawn(-size, size)};
    const bool across = round % 3 == 0;
    DisplacementField field = field_of([&](Vec g) {
      const double near = across ? std::exp(-g.y * g.y / 9) : std::exp(-(g.x * g.x + g.y * g.y) / drawn(8, 20));
      return Vec{near * mean.x + drawn(-size, size) / 10, near * mean.y + drawn(-size, size) / 10};
    });
    for (std::uint_fast32_t k = random() % 9; k > 0; --k) field.markers[random() % kCount] = {};
    const load::Load got = read(field);
    const Reference want = reference_of(field);
    CHECK_TRUE(got.basis == load::Basis::kNominal);
    // The mean of neighbours is a whole number, and the share of the second set a whole 256th.
    DOUBLES_EQUAL(want.shear_x, got.shear_x.raw(), 2.0 + 0.01 * std::abs(want.shear_x) + size * 0.02);
    DOUBLES_EQUAL(want.shear_y, got.shear_y.raw(), 2.0 + 0.01 * std::abs(want.shear_y) + size * 0.02);
    DOUBLES_EQUAL(want.normal, got.normal.raw(), 10.0 + 0.01 * std::abs(want.normal) + size * 0.05);
    if (want.across > 0) CHECK_FALSE(got.within);
  }
}

// The statement that the stage stands on, of the layer alone: the motion summed over the whole surface is the force
// times h / G, and its first moment the normal load times h^2 (4 nu - 1) / (2 (1 - nu) G).
TEST(Load, ClosedFormOfTheLayerHasTheForceInItsSums) {
  const scene::Layer layer(kGel);
  constexpr double kRadius = 3.0, kStep = 0.25, kFar = 60.0;
  double sum = 0, moment = 0;
  for (double r = kStep / 2; r < kFar; r += kStep) {
    const double ring = 2 * std::numbers::pi * r * kStep;
    sum += ring * layer.dome(kRadius, r).mean;
    moment += ring * r * layer.press_outward(kRadius, r);
  }
  const double force = 2.0 / 3.0 * std::numbers::pi * kRadius * kRadius * kRadius;
  DOUBLES_EQUAL(force * 4.25 / 0.035, sum, 0.002 * sum);
  DOUBLES_EQUAL(force * 4.25 * 4.25 * (4 * 0.49 - 1) / (2 * (1 - 0.49) * 0.035), moment, 0.01 * moment);
}

TEST(Load, ReadsDomesOnTheLayer) {
  const scene::Layer layer(kGel);
  for (const double radius : {1.5, 3.0, 4.5}) {
    for (const Vec at : {Vec{0.3, -0.4}, Vec{1.5, 0.5}, Vec{-2.0, -0.8}}) {
      for (const double angle : {0.0, 0.6, 1.5708, 2.4, 4.0}) {
        const load::Load load = read(domes(layer, at, radius, 400.0, angle, 1000.0));
        DOUBLES_EQUAL(400.0 * std::cos(angle), load.shear_x.raw(), 20.0);
        DOUBLES_EQUAL(400.0 * std::sin(angle), load.shear_y.raw(), 20.0);
        DOUBLES_EQUAL(1000.0, load.normal.raw(), 150.0);
        DOUBLES_EQUAL(400.0, load.friction_use.raw(), 70.0);
      }
    }
  }
}

TEST(Load, OfAMirroredFieldIsTheMirroredForce) {
  for (int round = 0; round < 200; ++round) {
    const DisplacementField field = field_of([&](Vec g) {
      return Vec{drawn(-300, 300) + 20 * g.x, drawn(-300, 300) + 20 * g.y};
    });
    DisplacementField left_right = field, turned = field;
    for (int i = 0; i < kCount; ++i) {
      const MarkerDisplacement& d = field.markers[idx(i)];
      put(left_right, i / kCols * kCols + 8 - i % kCols, {-double(d.dx.raw()), double(d.dy.raw())});
      put(turned, kCount - 1 - i, {-double(d.dx.raw()), -double(d.dy.raw())});
    }
    const load::Load a = read(field), b = read(left_right), c = read(turned);
    LONGS_EQUAL(-a.shear_x.raw(), b.shear_x.raw());
    LONGS_EQUAL(a.shear_y.raw(), b.shear_y.raw());
    LONGS_EQUAL(-a.shear_x.raw(), c.shear_x.raw());
    LONGS_EQUAL(-a.shear_y.raw(), c.shear_y.raw());
    LONGS_EQUAL(a.normal.raw(), b.normal.raw());
    LONGS_EQUAL(a.normal.raw(), c.normal.raw());
    CHECK_EQUAL(a.within, b.within);
  }
}

TEST(Load, OfAStillGelIsNothing) {
  const load::Load load = read(field_of([](Vec) { return Vec{}; }));
  CHECK_TRUE(load.basis == load::Basis::kNominal);
  LONGS_EQUAL(0, load.shear_x.raw());
  LONGS_EQUAL(0, load.shear_y.raw());
  LONGS_EQUAL(0, load.normal.raw());
  LONGS_EQUAL(0, load.friction_use.raw());
  CHECK_FALSE(load.within);
}

// 2 um on every marker, the tracker's noise: a few mN of shear, some tens of normal load, and never a friction use.
TEST(Load, OfNoiseIsSmall) {
  std::normal_distribution<double> noise(0.0, 2.0);
  double shear = 0, normal = 0;
  constexpr int kRounds = 2000;
  for (int round = 0; round < kRounds; ++round) {
    const load::Load load = read(field_of([&](Vec) { return Vec{noise(random), noise(random)}; }));
    shear += std::pow(load.shear_x.raw(), 2.0) / kRounds;
    normal += std::pow(load.normal.raw(), 2.0) / kRounds;
    LONGS_EQUAL(0, load.friction_use.raw());
  }
  CHECK_TRUE(std::sqrt(shear) < 4.0);
  CHECK_TRUE(std::sqrt(normal) < 40.0);
}

TEST(Load, AMissingMarkerIsItsNeighboursMean) {
  const scene::Layer layer(kGel);
  const DisplacementField whole = domes(layer, {0.5, 0.2}, 3.0, 900.0, 0.4, 2000.0);
  const load::Load want = read(whole);
  for (int i = 0; i < kCount; ++i) {
    DisplacementField field = whole;
    field.markers[idx(i)] = {Micrometres::from_raw(5000), Micrometres::from_raw(-5000), false};
    const load::Load got = read(field);
    DOUBLES_EQUAL(want.shear_x.raw(), got.shear_x.raw(), 60.0);
    DOUBLES_EQUAL(want.shear_y.raw(), got.shear_y.raw(), 60.0);
  }
}

TEST(Load, AMarkerWithoutNeighboursCountsAsStill) {
  DisplacementField field = field_of([](Vec) { return Vec{100, 0}; });
  for (const int i : {0, 1, 9, 10}) field.markers[idx(i)].valid = false;
  const Reference want = reference_of(field);
  const load::Load got = read(field);
  DOUBLES_EQUAL(want.shear_x, got.shear_x.raw(), 2.0);
  DOUBLES_EQUAL(want.shear_y, got.shear_y.raw(), 2.0);
  // A corner that is believed to have moved as far as the others would read more.
  CHECK_TRUE(got.shear_x.raw() < read(field_of([](Vec) { return Vec{100, 0}; })).shear_x.raw());
}

TEST(Load, SaysNothingWithoutItsLattice) {
  const auto slid = [](Vec) { return Vec{100, 0}; };
  DisplacementField field = field_of(slid);
  for (int k = 0; k < 8; ++k) field.markers[idx(k * 7)].valid = false;
  CHECK_TRUE(read(field).basis == load::Basis::kNominal);
  field.markers[62].valid = false;
  CHECK_TRUE(read(field).basis == load::Basis::kNone);
  LONGS_EQUAL(0, read(field).shear_x.raw());
  for (const GridSize grid : {GridSize{9, 7}, GridSize{8, 10}, GridSize{7, 10}, GridSize{0, 0}, GridSize{1, 63}}) {
    field = field_of(slid);
    field.grid = grid;
    CHECK_TRUE(read(field).basis == load::Basis::kNone);
  }
  field = field_of(slid);
  for (const auto& [pitch_um, known] : {std::pair(1979, false), {1980, true}, {2060, true}, {2061, false}}) {
    config.pitch_um = pitch_um;
    CHECK_EQUAL(known, read(field).basis != load::Basis::kNone);
  }
}

TEST(Load, ScalesAreWhatAWeightMeasured) {
  const scene::Layer layer(kGel);
  const DisplacementField field = domes(layer, {0, 0}, 3.0, 500.0, 0.0, 2000.0);
  const load::Load nominal = read(field);
  const auto with = [&](std::int32_t shear, std::int32_t normal) {
    config.shear_scale_permille = shear;
    config.normal_scale_permille = normal;
    return read(field);
  };
  const load::Load one = with(2000, 0), other = with(0, 2000), two = with(2000, 3000), least = with(1, 0);
  CHECK_TRUE(one.basis == load::Basis::kOneWeight && other.basis == load::Basis::kOneWeight);
  CHECK_TRUE(two.basis == load::Basis::kTwoWeights);
  LONGS_EQUAL(2 * nominal.shear_x.raw(), one.shear_x.raw());
  LONGS_EQUAL(2 * nominal.normal.raw(), one.normal.raw());
  LONGS_EQUAL(one.shear_x.raw(), other.shear_x.raw());
  LONGS_EQUAL(one.normal.raw(), other.normal.raw());
  LONGS_EQUAL(2 * nominal.shear_x.raw(), two.shear_x.raw());
  LONGS_EQUAL(3 * nominal.normal.raw(), two.normal.raw());
  LONGS_EQUAL(1, least.shear_x.raw());
  // The ratio is the stiffness's business only where each has a scale of its own.
  DOUBLES_EQUAL(nominal.friction_use.raw(), one.friction_use.raw(), 2.0);
  DOUBLES_EQUAL(nominal.friction_use.raw() * 2 / 3.0, two.friction_use.raw(), 2.0);
}

TEST(Load, FrictionUseNeedsAPress) {
  const scene::Layer layer(kGel);
  for (double press_mn = 0; press_mn < 500; press_mn += 20) {
    const load::Load load = read(domes(layer, {0, 0}, 3.0, 150.0, 0.3, press_mn));
    CHECK_EQUAL(load.normal.raw() >= 200, load.friction_use.raw() > 0);
  }
}

TEST(Load, StrainBeginsAtAQuarterOfTheThickness) {
  const auto moved = [&](int um) {
    DisplacementField field = field_of([](Vec) { return Vec{}; });
    put(field, 20, {0, static_cast<double>(um)});
    return read(field).strained;
  };
  CHECK_FALSE(moved(1060));
  CHECK_TRUE(moved(1061));
  CHECK_TRUE(moved(-1061));
}

TEST(Load, ABarAcrossTheGelIsNotWithin) {
  const auto bar = [&](bool along_x, double width) {
    return read(field_of([&](Vec g) {
      const double off = along_x ? g.y : g.x;
      return Vec{300 * std::exp(-off * off / (width * width)), 100 * std::exp(-off * off / (width * width))};
    }));
  };
  CHECK_FALSE(bar(true, 3.0).within);
  CHECK_FALSE(bar(false, 3.0).within);
  CHECK_TRUE(read(field_of([](Vec g) {
               const double near = std::exp(-(g.x * g.x + g.y * g.y) / 8.0);
               return Vec{300 * near, 100 * near};
             })).within);
}

TEST(Load, SaturatesAndCountsAtTheLargestFields) {
  config.shear_scale_permille = load::kMostScalePermille;
  const std::array<Vec, 4> corners{{{65535, 65535}, {-65535, 65535}, {65535, -65535}, {-65535, -65535}}};
  for (int round = 0; round < 500; ++round) {
    const load::Load load = read(field_of([&](Vec) { return corners[random() % 4]; }));
    CHECK_TRUE(load.strained);
  }
  saturations = {};
  const load::Load pushed = read(field_of([](Vec) { return Vec{65535, -65535}; }));
  LONGS_EQUAL(32'767, pushed.shear_x.raw());
  LONGS_EQUAL(-32'767, pushed.shear_y.raw());
  CHECK_TRUE(saturations.count >= 2);
}
