// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/tsne.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::learn::tsne {

std::vector<double> neighbour_weights(std::span<const double> squared_distances, double perplexity) {
  std::vector<double> weights(squared_distances.size());
  if (weights.empty()) return weights;
  const double nearest = *std::min_element(squared_distances.begin(), squared_distances.end());
  const double wanted = std::log(perplexity);
  double beta = 1.0;  // 1 / (2 sigma^2)
  double low = 0.0;
  double high = std::numeric_limits<double>::infinity();
  for (int step = 0; step < 200; ++step) {
    double sum = 0.0;
    double spread = 0.0;
    for (std::size_t j = 0; j < weights.size(); ++j) {
      const double beyond = squared_distances[j] - nearest;  // the nearest weighs 1: no sum can vanish
      weights[j] = std::exp(-beta * beyond);
      sum += weights[j];
      spread += weights[j] * beyond;
    }
    const double entropy = std::log(sum) + beta * spread / sum;
    for (double& weight : weights) weight /= sum;
    if (std::abs(entropy - wanted) < 1e-5) break;
    (entropy > wanted ? low : high) = beta;
    beta = std::isinf(high) ? beta * 2.0 : 0.5 * (low + high);
    if (beta > 1e200) break;
  }
  return weights;
}

std::vector<double> affinities(std::span<const double> points, int width, double perplexity) {
  const auto w = static_cast<std::size_t>(width);
  const std::size_t n = points.size() / w;
  std::vector<double> p(n * n, 0.0);
  std::vector<double> distances;
  for (std::size_t i = 0; i < n; ++i) {
    distances.clear();
    for (std::size_t j = 0; j < n; ++j) {
      if (j == i) continue;
      double sum = 0.0;
      for (std::size_t k = 0; k < w; ++k) {
        const double d = points[i * w + k] - points[j * w + k];
        sum += d * d;
      }
      distances.push_back(sum);
    }
    const std::vector<double> weights = neighbour_weights(distances, perplexity);
    for (std::size_t j = 0; j < n; ++j) {
      if (j != i) p[i * n + j] = weights[j < i ? j : j - 1];
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      p[i * n + j] = p[j * n + i] = (p[i * n + j] + p[j * n + i]) / (2.0 * static_cast<double>(n));
    }
  }
  return p;
}

double divergence(std::span<const double> p, std::span<const Point> picture) {
  const std::size_t n = picture.size();
  const auto near = [&](std::size_t i, std::size_t j) {
    const double dx = picture[i].x - picture[j].x;
    const double dy = picture[i].y - picture[j].y;
    return 1.0 / (1.0 + dx * dx + dy * dy);
  };
  double total = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) total += 2.0 * near(i, j);
  }
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (p[i * n + j] > 0.0) sum += 2.0 * p[i * n + j] * std::log(p[i * n + j] * total / near(i, j));
    }
  }
  return sum;
}

// 4 sum_j (p_ij - q_ij) (y_i - y_j) / (1 + |y_i - y_j|^2), with the repulsion summed apart: q's total is known only at
// the end of the sweep.
void gradient(std::span<const double> p, std::span<const Point> picture, double exaggeration, std::vector<Point>& out) {
  const std::size_t n = picture.size();
  std::vector<Point> apart(n);
  out.assign(n, {});
  double total = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double dx = picture[i].x - picture[j].x;
      const double dy = picture[i].y - picture[j].y;
      const double near = 1.0 / (1.0 + dx * dx + dy * dy);
      const double pull = p[i * n + j] * near;
      const double push = near * near;
      total += 2.0 * near;
      out[i].x += pull * dx, out[i].y += pull * dy;
      out[j].x -= pull * dx, out[j].y -= pull * dy;
      apart[i].x += push * dx, apart[i].y += push * dy;
      apart[j].x -= push * dx, apart[j].y -= push * dy;
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    out[i].x = 4.0 * (exaggeration * out[i].x - apart[i].x / total);
    out[i].y = 4.0 * (exaggeration * out[i].y - apart[i].y / total);
  }
}

std::vector<Point> embed(std::span<const double> points, int width, const Config& config,
                         const std::function<bool()>& progress) {
  const std::size_t n = points.size() / static_cast<std::size_t>(width);
  if (n < 2) return std::vector<Point>(n);
  const double most = std::max(1.0, (static_cast<double>(n) - 1.0) / 3.0);
  const std::vector<double> p = affinities(points, width, std::min(config.perplexity, most));
  scene::Random random(config.seed);
  std::vector<Point> picture(n);
  for (Point& point : picture) point = {1e-4 * random.normal(), 1e-4 * random.normal()};
  std::vector<Point> velocity(n);
  std::vector<Point> gain(n, {1.0, 1.0});
  std::vector<Point> slope;
  const int early = config.iterations / 4;
  const double rate =
      config.learning_rate > 0.0 ? config.learning_rate : std::max(50.0, static_cast<double>(n) / config.exaggeration);
  for (int step = 0; step < config.iterations; ++step) {
    gradient(p, picture, step < early ? config.exaggeration : 1.0, slope);
    const double momentum = step < early ? 0.5 : 0.8;
    // A gain grows while the slope keeps its sign against the motion, and shrinks when it turns.
    const auto move = [&](double& at, double& speed, double& factor, double along) {
      factor = std::max(0.01, (along > 0.0) != (speed > 0.0) ? factor + 0.2 : factor * 0.8);
      speed = momentum * speed - rate * factor * along;
      at += speed;
    };
    Point centre;
    for (std::size_t i = 0; i < n; ++i) {
      move(picture[i].x, velocity[i].x, gain[i].x, slope[i].x);
      move(picture[i].y, velocity[i].y, gain[i].y, slope[i].y);
      centre.x += picture[i].x / static_cast<double>(n);
      centre.y += picture[i].y / static_cast<double>(n);
    }
    for (Point& point : picture) point = {point.x - centre.x, point.y - centre.y};
    if (progress && !progress()) return {};
  }
  return picture;
}

}  // namespace holdfast::learn::tsne
