// SPDX-License-Identifier: Apache-2.0
#include "toolchain/generate/load_weights.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "drivers/sim/scene/contact/layer.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "tactile/load.hpp"

namespace holdfast::load_weights {
namespace {

using scene::Vec2;

constexpr scene::Gel kGel{.shear_modulus_mpa = 0.035, .poisson = 0.49, .thickness_mm = 4.25};
constexpr double kPitch_mm = load::kPitch_um * 1e-3;
constexpr Vec2 kHalfPad{12.6, 10.35};
constexpr Vec2 kHalfSeen{0.5 * load::kCols * kPitch_mm, 0.5 * load::kRows* kPitch_mm};
constexpr double kCell_mm = 0.9;
constexpr std::size_t kMostCells = 260;
constexpr int kContacts = 2000;
constexpr int kDraws = 4;
constexpr double kNoise_um = 4.0;
constexpr double kForce_mn = 1000.0;

// A dome of 1 N that covers a cell, by distance: the layer's motion, in um.
class Kernel {
 public:
  Kernel() {
    const scene::Layer layer(kGel);
    constexpr double kRadius = 0.6 * kCell_mm;
    constexpr double kPerNewton = 1.5 / (std::numbers::pi * kRadius * kRadius * kRadius);
    for (int i = 0; i < kSteps; ++i) {
      const double r = i * kStep_mm;
      const scene::Spread shear = layer.dome(kRadius, r);
      rows_[static_cast<std::size_t>(i)] = {1e3 * kPerNewton * shear.mean, 1e3 * kPerNewton * shear.fan,
                                            1e3 * kPerNewton * layer.press_outward(kRadius, r)};
    }
  }

  // Motion at `away` from the dome: of a force along +x (xx, xy), along +y (xy, yy), and into the gel (x, y).
  struct Motion {
    double xx = 0, xy = 0, yy = 0, x = 0, y = 0;
  };
  [[nodiscard]] Motion at(Vec2 away) const {
    const double r = std::hypot(away.x, away.y);
    const double place = std::min(r / kStep_mm, kSteps - 1.001);
    const auto i = static_cast<std::size_t>(place);
    const double t = place - static_cast<double>(i);
    const auto value = [&](std::size_t k) { return (1.0 - t) * rows_[i][k] + t * rows_[i + 1][k]; };
    const double c = r > 0.0 ? away.x / r : 1.0, s = r > 0.0 ? away.y / r : 0.0;
    const double fan_c = value(1) * (c * c - s * s), fan_s = value(1) * 2.0 * c * s;
    return {value(0) + fan_c, fan_s, value(0) - fan_c, value(2) * c, value(2) * s};
  }

 private:
  static constexpr double kStep_mm = 0.02;
  static constexpr int kSteps = 2001;
  std::array<std::array<double, 3>, kSteps> rows_{};
};

struct Sample {
  load::detail::Folded folded;
  double shear_x_mn = 0, shear_y_mn = 0;
  double outside = 0;  // share of the normal load outside the lattice
  bool across = false;
};

class Contacts {
 public:
  [[nodiscard]] std::vector<Sample> draw() {
    std::vector<Sample> all;
    for (int i = 0; i < kContacts;) i += draw_one(all) ? 1 : 0;
    return all;
  }

 private:
  double in(double least, double most) { return least + (most - least) * random_.uniform(); }

  // false: too small or too large for the cells.
  bool draw_one(std::vector<Sample>& all) {
    const int kind = random_.below(3);
    double a = in(1.2, 7.0), b = kind == 0 ? a : in(1.2, 7.0);
    if (kind == 2) {
      a = 3.0 * std::exp(in(0.0, std::log(100.0 / 3.0)));
      b = in(0.8, 3.5);
    }
    const double turn = in(0.0, std::numbers::pi);
    const Vec2 centre{in(-6.0, 6.0), in(-4.5, 4.5)};
    const Vec2 shift{in(-0.5, 0.5) * kCell_mm, in(-0.5, 0.5) * kCell_mm};
    const bool dome = random_.below(2) == 0;
    cells_.clear();
    pressure_.clear();
    double sum = 0;
    for (double y = -kHalfPad.y + kCell_mm / 2; y < kHalfPad.y; y += kCell_mm) {
      for (double x = -kHalfPad.x + kCell_mm / 2; x < kHalfPad.x; x += kCell_mm) {
        const Vec2 at{x + shift.x, y + shift.y};
        const double dx = at.x - centre.x, dy = at.y - centre.y;
        const double u = (dx * std::cos(turn) + dy * std::sin(turn)) / a;
        const double v = (dy * std::cos(turn) - dx * std::sin(turn)) / b;
        const double left = 1.0 - u * u - v * v;
        if (left <= 0.0) continue;
        cells_.push_back(at);
        pressure_.push_back(dome ? std::sqrt(left) : 1.0);
        sum += pressure_.back();
      }
    }
    if (cells_.size() < 4 || cells_.size() > kMostCells) return false;
    for (double& p : pressure_) p /= sum;
    hold_back();
    for (int k = 0; k < kDraws; ++k) all.push_back(loaded());
    return true;
  }

  // Tractions that keep every cell where it was: twice as many equations as cells.
  void hold_back() {
    const auto n = static_cast<int>(cells_.size());
    cv::Mat matrix(2 * n, 2 * n, CV_64F), flow(2 * n, 1, CV_64F, cv::Scalar(0.0));
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        const Vec2 to = cells_[idx(i)], from = cells_[idx(j)];
        const Kernel::Motion motion = kernel_.at({to.x - from.x, to.y - from.y});
        matrix.at<double>(2 * i, 2 * j) = motion.xx;
        matrix.at<double>(2 * i, 2 * j + 1) = matrix.at<double>(2 * i + 1, 2 * j) = motion.xy;
        matrix.at<double>(2 * i + 1, 2 * j + 1) = motion.yy;
        flow.at<double>(2 * i) -= motion.x * pressure_[idx(j)];
        flow.at<double>(2 * i + 1) -= motion.y * pressure_[idx(j)];
      }
    }
    cv::solve(matrix, flow, held_, cv::DECOMP_CHOLESKY);
  }

  Sample loaded() {
    const double held = in(0.0, 1.1), force = in(0.0, 1.0), even = in(0.0, 1.0);
    const double angle = in(0.0, 2.0 * std::numbers::pi);
    const bool twisted = random_.below(10) < 3;
    const double twist = in(-0.5, 0.5) * (twisted ? 1.0 : 0.0);
    Vec2 middle;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      middle.x += pressure_[i] * cells_[i].x;
      middle.y += pressure_[i] * cells_[i].y;
    }
    double arm = 0;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      arm += pressure_[i] * std::hypot(cells_[i].x - middle.x, cells_[i].y - middle.y);
    }
    Sample out;
    std::array<double, load::kMarkers> x{}, y{};
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      const double share = (1.0 - even) * pressure_[i] + even / static_cast<double>(cells_.size());
      const double turning = twist * pressure_[i] / arm;
      const auto k = static_cast<int>(2 * i);
      const Vec2 shear{
          held * held_.at<double>(k) + force * share * std::cos(angle) - turning * (cells_[i].y - middle.y),
          held * held_.at<double>(k + 1) + force * share * std::sin(angle) + turning * (cells_[i].x - middle.x)};
      out.shear_x_mn += kForce_mn * shear.x;
      out.shear_y_mn += kForce_mn * shear.y;
      const bool seen = std::abs(cells_[i].x) <= kHalfSeen.x && std::abs(cells_[i].y) <= kHalfSeen.y;
      out.outside += seen ? 0.0 : pressure_[i];
      for (int m = 0; m < load::kMarkers; ++m) {
        const int row = m / load::kCols, col = m % load::kCols;
        const Vec2 marker{(col - 0.5 * (load::kCols - 1)) * kPitch_mm, (row - 0.5 * (load::kRows - 1)) * kPitch_mm};
        const Kernel::Motion motion = kernel_.at({marker.x - cells_[i].x, marker.y - cells_[i].y});
        x[idx(m)] += motion.xx * shear.x + motion.xy * shear.y + motion.x * pressure_[i];
        y[idx(m)] += motion.xy * shear.x + motion.yy * shear.y + motion.y * pressure_[i];
      }
    }
    load::detail::Field field;
    for (std::size_t m = 0; m < x.size(); ++m) {
      field.x[m] = static_cast<std::int32_t>(std::lround(x[m]));
      field.y[m] = static_cast<std::int32_t>(std::lround(y[m]));
    }
    out.folded = load::detail::fold(field);
    out.across = load::detail::reach_of(field).across_q8 > 128 && out.outside > 0.02 && force > 0.1;
    return out;
  }

  Kernel kernel_;
  scene::Random random_{20261126};
  std::vector<Vec2> cells_;
  std::vector<double> pressure_;
  cv::Mat held_;
};

using Row = std::vector<double>;

// Least squares with the noise of folded markers on the diagonal.
Row fitted(const std::vector<Row>& rows, const std::vector<double>& wanted) {
  const auto n = static_cast<int>(rows.front().size());
  cv::Mat normal(n, n, CV_64F, cv::Scalar(0.0)), right(n, 1, CV_64F, cv::Scalar(0.0)), solution;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const cv::Mat row(n, 1, CV_64F, const_cast<double*>(rows[k].data()));
    normal += row * row.t();
    right += wanted[k] * row;
  }
  normal += 4.0 * kNoise_um * kNoise_um * static_cast<double>(rows.size()) * cv::Mat::eye(n, n, CV_64F);
  cv::solve(normal, right, solution, cv::DECOMP_CHOLESKY);
  return {solution.begin<double>(), solution.end<double>()};
}

double product(const double* weights, const std::array<std::int32_t, load::kFolded>& folded) {
  double sum = 0;
  for (std::size_t i = 0; i < folded.size(); ++i) sum += weights[i] * folded[i];
  return sum;
}

void append(Row& row, const std::array<std::int32_t, load::kFolded>& folded, double factor) {
  for (const std::int32_t value : folded) row.push_back(factor * value);
}

std::string weights_of(const std::vector<const Sample*>& samples) {
  const auto solve = [&](const auto& row_of, const auto& wanted_of) {
    std::vector<Row> rows;
    std::vector<double> wanted;
    for (const Sample* sample : samples) {
      rows.push_back(row_of(*sample));
      wanted.push_back(wanted_of(*sample));
    }
    return fitted(rows, wanted);
  };
  const auto row_of = [](auto part) {
    return [part](const Sample& s) {
      Row row;
      append(row, s.folded.*part, 1.0);
      return row;
    };
  };
  using load::detail::Folded;
  const Row shear_x = solve(row_of(&Folded::shear_x), [](const Sample& s) { return s.shear_x_mn; });
  const Row shear_y = solve(row_of(&Folded::shear_y), [](const Sample& s) { return s.shear_y_mn; });
  const auto pressed = [](const Sample&) { return kForce_mn; };
  Row normal = solve(row_of(&Folded::normal), pressed);
  for (int round = 0; round < 2; ++round) {
    const Row before = normal;
    const auto directed = [&](const Sample& s) {
      const load::detail::Direction along =
          load::detail::direction_of({std::lround(product(shear_x.data(), s.folded.shear_x)),
                                      std::lround(product(shear_y.data(), s.folded.shear_y)),
                                      std::lround(product(before.data(), s.folded.normal))});
      Row row;
      append(row, s.folded.normal, 1.0);
      append(row, s.folded.normal, along.c_q12 / 4096.0);
      append(row, s.folded.diagonal, along.s_q12 / 4096.0);
      return row;
    };
    normal = solve(directed, pressed);
  }
  std::string out = "    {\n";
  const auto add = [&](const double* weights) {
    out += "        {";
    for (std::size_t i = 0; i < load::kFolded; ++i) {
      out += fmt::format("{}{}", i == 0 ? "" : i % 20 == 0 ? ",\n         " : ", ", std::lround(weights[i] * 65536.0));
    }
    out += "},\n";
  };
  add(shear_x.data());
  add(shear_y.data());
  for (std::size_t part = 0; part < 3; ++part) add(normal.data() + part * load::kFolded);
  return out + "    },\n";
}

}  // namespace

std::string header() {
  const std::vector<Sample> all = Contacts().draw();
  std::vector<const Sample*> within, across;
  for (const Sample& sample : all) {
    if (sample.outside < 0.05) within.push_back(&sample);
    if (sample.across) across.push_back(&sample);
  }
  return fmt::format(R"(// SPDX-License-Identifier: Apache-2.0
// Written by load_weights (toolchain/generate/load_weights.hpp); do not edit. Build target: load_weights_header.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace holdfast::load {{

inline constexpr std::int32_t kRows = 7, kCols = 9, kMarkers = kRows * kCols;
inline constexpr std::int32_t kHalfRows = (kRows + 1) / 2, kHalfCols = (kCols + 1) / 2;
inline constexpr std::size_t kQuarter = kHalfRows * kHalfCols, kFolded = 2 * kQuarter;

// Of folded displacements (load.hpp), mN/um, 1/65536.
struct Weights {{
  std::array<std::int32_t, kFolded> shear_x, shear_y, normal, normal_c, normal_s;
}};

// clang-format off
inline constexpr std::array<Weights, 2> kWeights{{{{
{}{}}}}};
// clang-format on

}}  // namespace holdfast::load
)",
                     weights_of(within), weights_of(across));
}

}  // namespace holdfast::load_weights
