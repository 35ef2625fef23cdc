// SPDX-License-Identifier: Apache-2.0
#include "tests/support/reference.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace holdfast::reference_model {

Displacements displacement_um(const Positions& now, const Positions& rest, double pitch_px, double pitch_um) {
  Displacements out(now.size());
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (!now[i] || !rest[i]) continue;
    out[i] = Point{(now[i]->x - rest[i]->x) * pitch_um / pitch_px, (now[i]->y - rest[i]->y) * pitch_um / pitch_px};
  }
  return out;
}

Histogram histogram_of(const Displacements& displacements, double range_um) {
  Histogram histogram{};
  for (const auto& d : displacements) {
    if (!d) continue;
    const double bin = std::floor(std::hypot(d->x, d->y) * kBins / range_um);
    ++histogram[static_cast<std::size_t>(std::min(bin, kBins - 1.0))];
  }
  return histogram;
}

long double entropy_long_double(std::span<const int> counts) {
  long double n = 0.0L;
  for (const int k : counts) n += static_cast<long double>(k);
  std::vector<long double> terms;
  for (const int k : counts) {
    if (k == 0) continue;
    const long double p = static_cast<long double>(k) / n;
    terms.push_back(-p * std::log(p));
  }
  std::sort(terms.begin(), terms.end());
  long double sum = 0.0L;
  for (const long double term : terms) sum += term;
  return sum;
}

Features Model::update(const Displacements& displacements, std::int64_t timestamp_us) {
  Features out;
  out.histogram = histogram_of(displacements, config_.range_um);
  out.entropy_nat = static_cast<double>(entropy_long_double(out.histogram));
  for (const auto& d : displacements) out.markers += d ? 1 : 0;

  const double dt_s = static_cast<double>(timestamp_us - last_us_) * 1e-6;
  if (known_ && dt_s >= config_.min_step_s && dt_s <= config_.max_gap_s) {
    int common = 0;
    double sum_x = 0.0;
    double sum_y = 0.0;
    for (std::size_t i = 0; i < displacements.size(); ++i) {
      if (!displacements[i] || !last_[i]) continue;
      sum_x += displacements[i]->x - last_[i]->x;
      sum_y += displacements[i]->y - last_[i]->y;
      ++common;
    }
    if (common > 0) {
      out.rates_valid = true;
      out.vx_um_s = sum_x / common / dt_s;
      out.vy_um_s = sum_y / common / dt_s;
      out.entropy_rate_nat_s = (out.entropy_nat - last_entropy_nat_) / dt_s;
    }
  }
  known_ = true;
  last_us_ = timestamp_us;
  last_entropy_nat_ = out.entropy_nat;
  last_ = displacements;
  return out;
}

Features Model::update(const Positions& now, const Positions& rest, double pitch_px, std::int64_t timestamp_us) {
  return update(displacement_um(now, rest, pitch_px, config_.pitch_um), timestamp_us);
}

WindowSums window_sums(const LumaView& luma, int left, int top, int size,
                       const std::function<int(int x, int y)>& threshold, int cap) {
  WindowSums out;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const double dark = threshold(x, y) - static_cast<double>(luma.row(top + y)[left + x]);
      const double weight = std::min(std::max(dark, 0.0), static_cast<double>(cap));
      out.mass += weight;
      out.x += weight * x;
      out.y += weight * y;
    }
  }
  return out;
}

std::vector<Point> lattice_px(const Grid& grid, const scene::PictureConfig& config, const Warp& warp) {
  std::vector<Point> dots;
  for (int row = 0; row < grid.rows; ++row) {
    for (int col = 0; col < grid.cols; ++col) {
      const scene::Vec2 rest{(col - 0.5 * (grid.cols - 1)) * grid.pitch_mm,
                             (row - 0.5 * (grid.rows - 1)) * grid.pitch_mm};
      dots.push_back(scene::to_px(config, warp ? warp(rest) : rest));
    }
  }
  return dots;
}

Picture picture_of(const scene::PictureConfig& config, std::span<const Point> dots, std::uint64_t seed) {
  Picture picture{config.width, config.height, {}};
  scene::render_luma(config, dots, nullptr, seed, picture.pixels);
  return picture;
}

void draw_disc(Picture& picture, Point centre, double radius_px, std::uint8_t level) {
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      if (distance(centre, {static_cast<double>(x), static_cast<double>(y)}) > radius_px) continue;
      picture.pixels[static_cast<std::size_t>(y * picture.width + x)] = level;
    }
  }
}

Picture flat(int width, int height, std::uint8_t level) {
  return {width, height,
          std::vector<std::uint8_t>(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), level)};
}

Warp shifted(double dx_mm, double dy_mm) {
  return [=](scene::Vec2 p) { return scene::Vec2{p.x + dx_mm, p.y + dy_mm}; };
}

Warp rotated(double degrees) {
  const double c = std::cos(degrees * std::numbers::pi / 180.0);
  const double s = std::sin(degrees * std::numbers::pi / 180.0);
  return [=](scene::Vec2 p) { return scene::Vec2{c * p.x - s * p.y, s * p.x + c * p.y}; };
}

Warp sheared(double shear_x, double shear_y) {
  return [=](scene::Vec2 p) { return scene::Vec2{p.x + shear_x * p.y, p.y + shear_y * p.x}; };
}

Warp gaussian(scene::Vec2 centre, double sigma_mm, double dx_mm, double dy_mm) {
  return [=](scene::Vec2 p) {
    const double r = std::hypot(p.x - centre.x, p.y - centre.y) / sigma_mm;
    const double share = std::exp(-0.5 * r * r);
    return scene::Vec2{p.x + share * dx_mm, p.y + share * dy_mm};
  };
}

Warp bulged(double strength, double sigma_mm) {
  return [=](scene::Vec2 p) {
    const double r = std::hypot(p.x, p.y) / sigma_mm;
    const double scale = 1.0 + strength * std::exp(-0.5 * r * r);
    return scene::Vec2{p.x * scale, p.y * scale};
  };
}

Warp chained(Warp first, Warp second) {
  return [first = std::move(first), second = std::move(second)](scene::Vec2 p) { return second(first(p)); };
}

double distance(Point a, Point b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}

}  // namespace holdfast::reference_model
