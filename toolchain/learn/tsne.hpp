// SPDX-License-Identifier: Apache-2.0
// t-SNE, exact: points of many dimensions laid out on a plane so that neighbours stay neighbours.
// van der Maaten & Hinton, JMLR 9 (2008); gains as in their reference code.
//
// Only nearness means something in the result: distances between clusters, their sizes and the axes do not. Cost: n^2
// per iteration, n^2 doubles of memory (2000 points, 500 iterations: about 5 s). Same points, same seed: same picture
// on one machine; elsewhere rounding may turn it. Range: 2 <= n, perplexity below n; points that coincide are fine.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace holdfast::learn::tsne {

struct Config {
  double perplexity = 30.0;  // neighbours that count; at most a third of the points
  int iterations = 500;
  double learning_rate = 0.0;  // 0: a twelfth of n, at least 50 (Belkina et al., Nature Communications 10, 2019)
  double exaggeration = 12.0;  // of the attraction, in the first quarter of the iterations
  std::uint64_t seed = 1;
};

struct Point {
  double x = 0.0;
  double y = 0.0;
};

// Gaussian weights of one point's neighbours, sum 1, whose entropy is ln(perplexity) to 1e-5 nat. With more than
// `perplexity` neighbours at the least distance that entropy cannot be had: they share the weight evenly.
[[nodiscard]] std::vector<double> neighbour_weights(std::span<const double> squared_distances, double perplexity);

// p_ij = (p_j|i + p_i|j) / 2n of points with `width` numbers each; n * n, sum 1, diagonal 0.
[[nodiscard]] std::vector<double> affinities(std::span<const double> points, int width, double perplexity);

// Kullback-Leibler divergence of the picture from p, in nat, and its slope.
[[nodiscard]] double divergence(std::span<const double> p, std::span<const Point> picture);
void gradient(std::span<const double> p, std::span<const Point> picture, double exaggeration, std::vector<Point>& out);

// `progress` after each iteration: false stops and returns nothing.
[[nodiscard]] std::vector<Point> embed(std::span<const double> points, int width, const Config& config,
                                       const std::function<bool()>& progress = {});

}  // namespace holdfast::learn::tsne
