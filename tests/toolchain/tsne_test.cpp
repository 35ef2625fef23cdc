// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/tsne.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "drivers/sim/scene/math/random.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

double entropy(const std::vector<double>& weights) {
  double sum = 0.0;
  for (const double w : weights) sum -= w > 0.0 ? w * std::log(w) : 0.0;
  return sum;
}

// `count` points about each of three corners of a triangle with sides of 20 sigma, in five dimensions.
std::vector<double> three_clusters(int count) {
  scene::Random random(7);
  std::vector<double> points;
  for (int cluster = 0; cluster < 3; ++cluster) {
    for (int i = 0; i < count; ++i) {
      for (int k = 0; k < 5; ++k) points.push_back(random.normal() + (k == cluster ? 20.0 : 0.0));
    }
  }
  return points;
}

double distance(const tsne::Point& a, const tsne::Point& b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}

}  // namespace

TEST_GROUP(Tsne){};

TEST(Tsne, NeighbourWeightsHaveTheAskedPerplexity) {
  scene::Random random(3);
  for (const double scale : {1e-6, 1.0, 1e9}) {
    std::vector<double> squares(200);
    for (double& square : squares) square = scale * std::pow(random.uniform() + 0.01, 2);
    for (const double perplexity : {2.0, 30.0, 150.0}) {
      const std::vector<double> weights = tsne::neighbour_weights(squares, perplexity);
      DOUBLES_EQUAL(1.0, std::accumulate(weights.begin(), weights.end(), 0.0), 1e-12);
      // 2e-5 nat: the search's own 1e-5 and this sum's rounding.
      DOUBLES_EQUAL(std::log(perplexity), entropy(weights), 2e-5);
    }
  }
}

TEST(Tsne, PointsThatCoincideShareTheWeightEvenly) {
  std::vector<double> squares(60, 0.0);
  squares.back() = 4.0;  // 59 twins: an entropy of ln 10 cannot be had
  const std::vector<double> weights = tsne::neighbour_weights(squares, 10.0);
  DOUBLES_EQUAL(1.0 / 59.0, weights.front(), 1e-9);
  DOUBLES_EQUAL(0.0, weights.back(), 1e-9);
}

TEST(Tsne, AffinitiesAreSymmetricAndSumToOne) {
  const std::vector<double> p = tsne::affinities(three_clusters(10), 5, 5.0);
  LONGS_EQUAL(900, p.size());
  DOUBLES_EQUAL(1.0, std::accumulate(p.begin(), p.end(), 0.0), 1e-12);
  for (std::size_t i = 0; i < 30; ++i) {
    DOUBLES_EQUAL(0.0, p[i * 30 + i], 0.0);
    for (std::size_t j = 0; j < i; ++j) DOUBLES_EQUAL(p[i * 30 + j], p[j * 30 + i], 0.0);
  }
}

TEST(Tsne, GradientIsTheSlopeOfTheDivergence) {
  const std::vector<double> p = tsne::affinities(three_clusters(8), 5, 5.0);
  scene::Random random(11);
  std::vector<tsne::Point> picture(24);
  for (tsne::Point& point : picture) point = {random.normal(), random.normal()};
  std::vector<tsne::Point> slope;
  tsne::gradient(p, picture, 1.0, slope);
  constexpr double kStep = 1e-5;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    for (double tsne::Point::*axis : {&tsne::Point::x, &tsne::Point::y}) {
      std::vector<tsne::Point> moved = picture;
      moved[i].*axis = picture[i].*axis + kStep;
      const double up = tsne::divergence(p, moved);
      moved[i].*axis = picture[i].*axis - kStep;
      const double down = tsne::divergence(p, moved);
      // Central difference: its error is of the order of kStep^2, its rounding of 1e-16 / kStep.
      DOUBLES_EQUAL((up - down) / (2.0 * kStep), slope[i].*axis, 1e-8);
    }
  }
}

TEST(Tsne, SeparatedClustersStaySeparated) {
  constexpr int kCount = 40;
  const std::vector<double> points = three_clusters(kCount);
  const std::vector<tsne::Point> picture = tsne::embed(points, 5, {.perplexity = 10.0, .iterations = 400});
  LONGS_EQUAL(3 * kCount, picture.size());
  int strays = 0;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    std::size_t nearest = i == 0 ? 1 : 0;
    for (std::size_t j = 0; j < picture.size(); ++j) {
      if (j != i && distance(picture[i], picture[j]) < distance(picture[i], picture[nearest])) nearest = j;
    }
    strays += nearest / kCount != i / kCount ? 1 : 0;
  }
  LONGS_EQUAL(0, strays);
  // Not only the nearest: the clusters are islands. Largest distance inside below the least one between.
  double inside = 0.0;
  double between = 1e9;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double d = distance(picture[i], picture[j]);
      if (i / kCount == j / kCount) inside = std::max(inside, d);
      if (i / kCount != j / kCount) between = std::min(between, d);
    }
  }
  CHECK(inside < between);
}

TEST(Tsne, OptimisingLowersTheDivergence) {
  const std::vector<double> points = three_clusters(20);
  const std::vector<double> p = tsne::affinities(points, 5, 10.0);
  const auto start = tsne::embed(points, 5, {.perplexity = 10.0, .iterations = 0});
  const auto end = tsne::embed(points, 5, {.perplexity = 10.0, .iterations = 300});
  CHECK(tsne::divergence(p, end) < 0.5 * tsne::divergence(p, start));
}

TEST(Tsne, TheSameSeedGivesTheSameBytes) {
  const std::vector<double> points = three_clusters(15);
  const auto draw = [&](std::uint64_t seed) { return tsne::embed(points, 5, {.iterations = 60, .seed = seed}); };
  const auto first = draw(4);
  const auto second = draw(4);
  CHECK(std::memcmp(first.data(), second.data(), first.size() * sizeof(tsne::Point)) == 0);
  const auto other = draw(5);
  CHECK(std::memcmp(first.data(), other.data(), first.size() * sizeof(tsne::Point)) != 0);
}

TEST(Tsne, FewPointsAndTwinsComeOutFinite) {
  LONGS_EQUAL(0, tsne::embed({}, 2, {}).size());
  LONGS_EQUAL(1, tsne::embed(std::vector<double>{1.0, 2.0}, 2, {}).size());
  const std::vector<double> twins(2 * 50, 3.0);
  for (const tsne::Point& point : tsne::embed(twins, 2, {.iterations = 50})) {
    CHECK(std::isfinite(point.x) && std::isfinite(point.y));
  }
  LONGS_EQUAL(2, tsne::embed(std::vector<double>{0.0, 1.0}, 1, {.iterations = 20}).size());
}

TEST(Tsne, StopsWhenTold) {
  int calls = 0;
  const auto picture = tsne::embed(three_clusters(10), 5, {}, [&] { return ++calls < 3; });
  LONGS_EQUAL(3, calls);
  LONGS_EQUAL(0, picture.size());
}
