// SPDX-License-Identifier: Apache-2.0
// The oracle of tactile/imprint.hpp: the same definitions in double, sampled at exact places, one patch after the other
// and with the whole picture smoothed. It keeps every frame it saw.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "tactile/imprint.hpp"
#include "tests/support/coarse_reference.hpp"

namespace holdfast::test {

class ImprintReference {
 public:
  // What rounding decides. The firmware's pixels, samples and empty gel are rounded to 1/16 level each, which is 0.03
  // levels RMS a sample: 3 % RMS of the relief of a patch at the threshold of contact, and as much of a weak change. So
  //   a patch whose relief is near the threshold may count on one side only: up to 6 % off it on the recordings;
  //   the noise q is one patch's change, out of a hundred quiet ones. Patches that are near the 40 % may be quiet on
  //   one side only, and near q they change places: up to 6 ranks on the recordings, where a codec leaves 3 to 10 %
  //   from rank to rank.
  // Measured on 3240 frames (2026-11-24): with samples of this class rounded in the same way, patches no longer count
  // one more in the firmware, and the motions of imprint_test are within 0.002 instead of 0.03 of log2.
  static constexpr double kContactRounding = 0.07;
  static constexpr std::ptrdiff_t kRanks = 6;
  // Rounding adds 1 to 2 % to the noise of the empty gel, and so to the relief that a motion needs.
  static constexpr double kFloorRounding = 0.03;

  // 0.03 levels over a slope of 1 level a step.
  static constexpr double kRounding_um = 4.0;

  static constexpr double kMostReliefForCoarse = 0.35;  // levels^2
  static constexpr double kLeastVariance = 0.2;         // levels^2

  struct Seen {
    double motion_um = 0.0;   // 0: none that stands out
    double least_um = 0.0;    // with the noise kRanks up, and whatever the floor
    double most_um = 0.0;     // with the noise kRanks down
    double over_floor = 0.0;  // energy of the relief over what a motion needs; it is there above 1
    double growth = 0.0;      // log2
    double covering =
        0.0;  // mean g of the quiet patches over what makes a contact: from 1 on all of the gel is covered
    double coarse_um = 0.0;  // 0: likewise, or too much relief
    int patches = 0;
    int least_patches = 0, most_patches = 0;  // with the threshold kContactRounding up and down
    double coarse_signal = 0.0;               // as CoarseSeen::signal; 0 where there is too much relief
    double coarse_left = 1.0;                 // share of its square that being carried does not explain
    double relief = 0.0;                      // mean of g, levels^2
    double turnover = 0.0;                    // 0: likewise
    double variance = 0.0;                    // mean of sqrt(V V'), levels^2

    double over_half = 0.0;  // as over_floor, of half of the floor's part that is no noise

    // A turnover needs both.
    [[nodiscard]] bool shows_relief() const { return variance > kLeastVariance && over_half >= 1.0; }
    // Rounding does not decide it: that changes the variance of a patch by up to 0.01 levels^2, and its G by 0.004.
    [[nodiscard]] bool tells_turnover() const {
      return std::abs(variance - kLeastVariance) > 0.02 && std::abs(over_half - 1.0) > 0.1;
    }

    // Rounding does not decide whether there is a coarse motion: evidence that is over a twentieth of what it is the
    // difference of, and relief further from what is too much than rounding adds, 0.004 levels^2.
    [[nodiscard]] bool tells_coarse() const {
      return std::abs(coarse_signal) > 0.05 && std::abs(relief - kMostReliefForCoarse) > 0.01;
    }
  };

  explicit ImprintReference(const imprint::Config& config) : config_(config) {}

  Seen update(const LumaView& picture, const MarkerField& now, const MarkerField& rest, PixelsQ8 pitch, bool empty,
              double t_s) {
    reduce(picture, pitch.raw() / 256.0);
    Frame frame;
    frame.t_s = t_s;
    const double floor = kPairs * config_.contact_floor_q8;
    double& threshold = threshold_;
    threshold = 2.0 * floor;
    if (empty_frames_ > 8) threshold = std::max(floor, noise_relief_ * config_.contact_over_noise_q4 / 16.0);
    if (empty) empty_frames_ = std::min(empty_frames_ + 1, 64);
    Seen out;
    double reliefs = 0;
    int patches = 0;
    for (int row = 0; row < rest.grid.rows; ++row) {
      for (int col = 0; col < rest.grid.cols; ++col) {
        for (const int sx : {1, -1}) {
          for (const int sy : {1, -1}) {
            const auto key =
                static_cast<std::size_t>(4 * (row * rest.grid.cols + col) + (sx < 0 ? 1 : 0) + (sy < 0 ? 2 : 0));
            const auto samples = sample(now, rest, row, col, sx, sy);
            if (!samples) continue;
            if (empty_[key] && relief(*empty_[key], Square{}) <= kPairs * 8.0 * 256) {
              const Patch patch{*samples, *empty_[key], relief(*samples, *empty_[key])};
              ++patches;
              reliefs += patch.relief;
              if (patch.relief > threshold) ++out.patches;
              if (patch.relief > threshold * (1.0 + kContactRounding)) ++out.least_patches;
              if (patch.relief > threshold * (1.0 - kContactRounding)) ++out.most_patches;
              frame.patches[key] = patch;
            }
            if (empty) learn(key, *samples);
          }
        }
      }
    }
    if (empty && patches > 0 && empty_frames_ > 8) {
      noise_relief_ += (reliefs / patches - noise_relief_) / (empty_frames_ - 8);
    }
    carry(now, rest, config_.pitch_um / (pitch.raw() / 256.0), frame);
    compare(frame, rest.grid, out);
    if (kept_.empty() || t_s - kept_.front().t_s >= 0.035 - 1e-9) kept_.push_front(frame);
    if (kept_.size() > 7) kept_.pop_back();
    return out;
  }

  // Whether a motion may be there, log2 of um in Q8, where double sees this.
  [[nodiscard]] static bool may_move(const Seen& seen, std::int32_t motion_q8) {
    if (motion_q8 > 0) return seen.over_floor > 1.0 - kFloorRounding && seen.most_um > 0.0;
    return seen.over_floor < 1.0 + kFloorRounding || seen.least_um <= kRounding_um;
  }

  // By how much of log2 a motion is further from double than other ranks of the noise explain.
  [[nodiscard]] static double off(const Seen& seen, std::int32_t motion_q8) {
    const auto log_of = [](double um) { return std::log2(std::max(1.0, um)); };
    return std::max({0.0, log_of(seen.least_um) - motion_q8 / 256.0, motion_q8 / 256.0 - log_of(seen.most_um)});
  }

 private:
  static constexpr int kN = 25, kPairs = 17;
  using Square = std::array<double, 64>;  // by b, then a; those that are not free are 0
  struct Patch {
    Square samples{};
    Square empty{};  // as it was known then
    double relief = 0.0;
  };
  struct Frame {
    double t_s = 0.0;
    double x_um = 0.0, y_um = 0.0;                              // mean displacement of the markers
    std::array<std::optional<Patch>, 4 * kMaxMarkers> patches;  // four to a dot
  };

  static std::size_t at(int a, int b) { return static_cast<std::size_t>(b * 8 + a); }
  static bool free(int a, int b) { return std::hypot(a + 0.5, b + 0.5) >= 7.0; }

  // 16 x luma: mean of boxes, then 1-2-1 both ways.
  void reduce(const LumaView& picture, double pitch_px) {
    side_ = 1;
    while (side_ < 16 && pitch_px / (2 * side_) >= 2896.0 / 256.0) side_ *= 2;
    width_ = picture.width / side_;
    height_ = picture.height / side_;
    std::vector<double> boxes(static_cast<std::size_t>(width_ * height_));
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        double sum = 0;
        for (int v = 0; v < side_; ++v) {
          for (int u = 0; u < side_; ++u) sum += picture.row(y * side_ + v)[x * side_ + u];
        }
        boxes[static_cast<std::size_t>(y * width_ + x)] = 16.0 * sum / (side_ * side_);
      }
    }
    const auto box = [&](int x, int y) {
      return boxes[static_cast<std::size_t>(std::clamp(y, 0, height_ - 1) * width_ + std::clamp(x, 0, width_ - 1))];
    };
    pixels_.resize(boxes.size());
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        double sum = 0;
        for (int v = -1; v <= 1; ++v) {
          for (int u = -1; u <= 1; ++u) sum += (2 - std::abs(u)) * (2 - std::abs(v)) * box(x + u, y + v);
        }
        pixels_[static_cast<std::size_t>(y * width_ + x)] = sum / 16.0;
      }
    }
  }

  [[nodiscard]] std::optional<double> value(double x, double y) const {
    if (x < 0 || y < 0 || x >= width_ - 1 || y >= height_ - 1) return std::nullopt;
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const double fx = x - x0, fy = y - y0;
    const double* const from = &pixels_[static_cast<std::size_t>(y0 * width_ + x0)];
    return (1 - fy) * ((1 - fx) * from[0] + fx * from[1]) + fy * ((1 - fx) * from[width_] + fx * from[width_ + 1]);
  }

  [[nodiscard]] std::optional<Square> sample(const MarkerField& now, const MarkerField& rest, int row, int col, int sx,
                                             int sy) const {
    const int rows = rest.grid.rows, cols = rest.grid.cols;
    const auto marker = [&](const MarkerField& field, int r, int c) -> const Marker& {
      return field.markers[static_cast<std::size_t>(r * cols + c)];
    };
    const auto px = [](PixelsQ8 v) { return v.raw() / 256.0; };
    const bool right = col + sx >= 0 && col + sx < cols, down = row + sy >= 0 && row + sy < rows;
    const int nc = right ? col + sx : col, nr = down ? row + sy : row;
    // Displacement of the four dots: own, beside, over, across.
    std::array<double, 4> dx{}, dy{};
    std::size_t corner_index = 0;
    for (const auto& [r, c] : {std::pair(row, col), std::pair(row, nc), std::pair(nr, col), std::pair(nr, nc)}) {
      const Marker &to = marker(now, r, c), &from = marker(rest, r, c);
      if (!to.valid || !from.valid) return std::nullopt;
      dx[corner_index] = px(to.x) - px(from.x);
      dy[corner_index++] = px(to.y) - px(from.y);
    }
    const Marker& own = marker(rest, row, col);
    const Marker& beside = marker(rest, row, right ? col + sx : col - sx);
    const Marker& over = marker(rest, down ? row + sy : row - sy, col);
    if (!beside.valid || !over.valid) return std::nullopt;
    const double sa = right ? 1 : -1, sb = down ? 1 : -1;
    const double ax = sa * (px(beside.x) - px(own.x)) / 16, ay = sa * (px(beside.y) - px(own.y)) / 16;
    const double bx = sb * (px(over.x) - px(own.x)) / 16, by = sb * (px(over.y) - px(own.y)) / 16;
    const auto to_reduced = [&](double x) { return (x - (side_ - 1) / 2.0) / side_; };
    // The bilinear displacement between the dots, cut off behind its first order about the patch's middle, (1/4, 1/4).
    const auto moved = [](const std::array<double, 4>& d, double u, double v) {
      const double along = 0.75 * (d[1] - d[0]) + 0.25 * (d[3] - d[2]);
      const double across = 0.75 * (d[2] - d[0]) + 0.25 * (d[3] - d[1]);
      return (9 * d[0] + 3 * d[1] + 3 * d[2] + d[3]) / 16 + along * (u / 16 - 0.25) + across * (v / 16 - 0.25);
    };
    Square square{};
    for (int b = 0; b < 8; ++b) {
      for (int a = 0; a < 8; ++a) {
        const double u = a + 0.5, v = b + 0.5;
        // The patch stands or falls as a whole, at rest as well as now.
        if (!value(to_reduced(px(own.x) + u * ax + v * bx), to_reduced(px(own.y) + u * ay + v * by))) {
          return std::nullopt;
        }
        const auto seen = value(to_reduced(px(own.x) + moved(dx, u, v) + u * ax + v * bx),
                                to_reduced(px(own.y) + moved(dy, u, v) + u * ay + v * by));
        if (!seen) return std::nullopt;
        if (free(a, b)) square[at(a, b)] = *seen;
      }
    }
    return square;
  }

  // Sum over neighbours that are both free, along a and along b.
  [[nodiscard]] static double relief(const Square& samples, const Square& empty) {
    double sum = 0;
    const auto c = [&](int a, int b) { return samples[at(a, b)] - empty[at(a, b)]; };
    for (int b = 0; b < 8; ++b) {
      for (int a = 0; a < 8; ++a) {
        if (!free(a, b)) continue;
        if (a < 7 && free(a + 1, b)) sum += std::pow(c(a + 1, b) - c(a, b), 2);
        if (b < 7 && free(a, b + 1)) sum += std::pow(c(a, b + 1) - c(a, b), 2);
      }
    }
    return sum;
  }

  void learn(std::size_t key, const Square& now) {
    if (!empty_[key]) empty_[key] = now;
    Square& mean = *empty_[key];
    for (std::size_t i = 0; i < now.size(); ++i) mean[i] += (now[i] - mean[i]) / empty_frames_;
  }

  // Level: of `samples` over `empty`.
  [[nodiscard]] static double shading(const Square& samples, const Square& empty) {
    double sum = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) sum += samples[i] - empty[i];
    return sum / kN / 16;
  }

  // Mean about the means of what lies on the empty gel, now times then; levels^2.
  [[nodiscard]] static double covariance(const Patch& now, const Patch& then) {
    double sum_now = 0, sum_then = 0, products = 0;
    for (std::size_t i = 0; i < now.samples.size(); ++i) {
      const double a = now.samples[i] - now.empty[i], b = then.samples[i] - then.empty[i];
      sum_now += a;
      sum_then += b;
      products += a * b;
    }
    return (products / kN - sum_now * sum_then / kN / kN) / 256;
  }

  // Levels a step, along a and along b: mean of central differences, one-sided where only one neighbour is free.
  [[nodiscard]] static std::array<double, 2> slope(const Square& samples) {
    std::array<double, 2> sums{};
    for (int b = 0; b < 8; ++b) {
      for (int a = 0; a < 8; ++a) {
        if (!free(a, b)) continue;
        for (const int axis : {0, 1}) {
          const auto neighbour = [&](int by) {
            const int u = axis == 0 ? a + by : a, v = axis == 0 ? b : b + by;
            return u >= 0 && v >= 0 && u < 8 && v < 8 && free(u, v) ? std::optional(samples[at(u, v)]) : std::nullopt;
          };
          const auto before = neighbour(-1), after = neighbour(1);
          const double here = samples[at(a, b)];
          double rise = 0;
          if (before && after) rise = (*after - *before) / 2;
          if (before && !after) rise = here - *before;
          if (!before && after) rise = *after - here;
          sums[static_cast<std::size_t>(axis)] += rise / kN / 16;
        }
      }
    }
    return sums;
  }

  [[nodiscard]] static CoarsePatch coarse_patch(const Patch& now, const Patch& then, GridSize grid, int key) {
    const int dot = key / 4;
    const int sx = key % 2 == 0 ? 1 : -1, sy = key % 4 < 2 ? 1 : -1;
    const auto [now_a, now_b] = slope(now.samples);
    const auto [then_a, then_b] = slope(then.samples);
    const auto [empty_a, empty_b] = slope(now.empty);
    CoarsePatch out;
    out.change = shading(now.samples, now.empty) - shading(then.samples, then.empty);
    out.shading = (shading(now.samples, now.empty) + shading(then.samples, then.empty)) / 2;
    out.slope_x = sx * ((now_a + then_a) / 2 - empty_a);
    out.slope_y = sy * ((now_b + then_b) / 2 - empty_b);
    out.empty_x = sx * empty_a;
    out.empty_y = sy * empty_b;
    // Pitches from the lattice's middle.
    const int row = dot / grid.cols, col = dot % grid.cols;
    out.x = col - (grid.cols - 1) / 2.0 + sx / 4.0;
    out.y = row - (grid.rows - 1) / 2.0 + sy / 4.0;
    return out;
  }

  static void carry(const MarkerField& now, const MarkerField& rest, double um_per_px, Frame& frame) {
    int n = 0;
    for (int i = 0; i < rest.grid.count(); ++i) {
      const Marker &to = now.markers[idx(i)], &from = rest.markers[idx(i)];
      if (!to.valid || !from.valid) continue;
      frame.x_um += (to.x.raw() - from.x.raw()) / 256.0 * um_per_px;
      frame.y_um += (to.y.raw() - from.y.raw()) / 256.0 * um_per_px;
      ++n;
    }
    frame.x_um /= std::max(n, 1);
    frame.y_um /= std::max(n, 1);
  }

  struct Both {
    double now, then, g, change;                     // levels^2
    double shading_now, shading_then;                // levels
    double variance_now, variance_then, covariance;  // levels^2
  };

  static double variance_noise(std::vector<Both> least) {
    const auto sum = [](const Both& one) { return one.variance_now + one.variance_then; };
    std::sort(least.begin(), least.end(), [&](const Both& a, const Both& b) { return sum(a) < sum(b); });
    return sum(least[least.size() / 2]) / 2;
  }

  // What fading in place explains of each patch's change: nothing where as much grows as fades.
  static std::vector<double> faded(const std::vector<Both>& both, double noise) {
    double net = 0, all = 0;
    for (const Both& one : both) {
      net += one.g * (one.variance_then - one.variance_now);
      all += one.g * std::abs(one.variance_then - one.variance_now);
    }
    const double fading = all > 0.0 ? std::max(net, 0.0) / all : 0.0;
    std::vector<double> out;
    out.reserve(both.size());
    for (const Both& one : both) {
      const double now = std::sqrt(std::max(one.variance_now - noise, 0.0));
      const double then = std::sqrt(std::max(one.variance_then - noise, 0.0));
      out.push_back(one.variance_then > one.variance_now ? 0.75 * fading * (then - now) * (then - now) : 0.0);
    }
    return out;
  }

  static void turn_over(const std::vector<Both>& both, double noise, double way_um, Seen& out) {
    double weights = 0, common = 0, whole = 0;
    for (const Both& one : both) {
      const double weight = std::min(one.now, one.then);
      weights += weight;
      common += weight * one.covariance;
      whole += weight * std::sqrt(std::max(one.variance_now - noise, 0.0) * std::max(one.variance_then - noise, 0.0));
    }
    out.variance = weights > 0.0 ? whole / weights : 0.0;
    if (out.variance <= kLeastVariance) return;
    out.turnover = std::max(1.0 - std::max(common, 0.0) / whole - 0.5e-3 * way_um, 0.0);
  }

  void compare(const Frame& now, GridSize grid, Seen& out) const {
    constexpr double kLag_s = 0.16, kLevels2 = 256.0;
    const Frame* then = nullptr;
    double off = kLag_s / 3 + 1e-9;
    for (const Frame& kept : kept_) {
      const double distance = std::abs(now.t_s - kept.t_s - kLag_s);
      if (distance > off + 1e-9) continue;  // of two that are as far off, the older
      off = distance;
      then = &kept;
    }
    if (then == nullptr) return;
    std::vector<Both> both;
    std::vector<CoarsePatch> coarse;
    for (std::size_t key = 0; key < now.patches.size(); ++key) {
      if (!now.patches[key] || !then->patches[key]) continue;
      const Patch &patch = *now.patches[key], &before = *then->patches[key];
      double sum = 0, squares = 0;
      for (std::size_t i = 0; i < patch.samples.size(); ++i) {
        const double r = patch.samples[i] - before.samples[i];
        sum += r;
        squares += r * r;
      }
      const double a = patch.relief / kPairs / kLevels2, b = before.relief / kPairs / kLevels2;
      both.push_back({a, b, (a + b) / 2, (squares / kN - sum * sum / kN / kN) / kLevels2,
                      shading(patch.samples, patch.empty), shading(before.samples, before.empty),
                      covariance(patch, patch), covariance(before, before), covariance(patch, before)});
      coarse.push_back(coarse_patch(patch, before, grid, static_cast<int>(key)));
      out.relief += both.back().g;
    }
    if (!both.empty()) out.relief /= static_cast<double>(both.size());
    if (both.size() < 20) return;
    std::vector<Both> least = both;
    std::sort(least.begin(), least.end(), [](const Both& a, const Both& b) { return a.g < b.g; });
    least.resize(least.size() * 2 / 5);
    double base_now = 0, base_then = 0;
    for (const Both& one : least) {
      base_now += one.shading_now / static_cast<double>(least.size());
      base_then += one.shading_then / static_cast<double>(least.size());
    }
    double covering = 0;
    for (const Both& one : least) covering += one.g / static_cast<double>(least.size());
    out.covering = covering / (threshold_ / kPairs / kLevels2);
    const bool covered = empty_frames_ > 8 && out.covering >= 1.0;
    const double empty = noise_relief_ / kPairs / kLevels2;
    const double most_noise = covered ? 2.0 * empty : std::numeric_limits<double>::infinity();
    const double of_variances = std::min(variance_noise(least), most_noise / 2.0);
    const std::vector<double> fades = faded(both, of_variances);
    turn_over(both, of_variances, std::hypot(now.x_um - then->x_um, now.y_um - then->y_um), out);
    std::sort(least.begin(), least.end(), [](const Both& a, const Both& b) { return a.change < b.change; });
    const auto n = static_cast<double>(both.size());
    double energy = 0.2 * n, energy_now = 0, energy_then = 0;
    double shading_now = n, shading_then = n;
    for (const Both& one : both) {
      energy += one.g * one.g;
      energy_now += one.now * one.now;
      energy_then += one.then * one.then;
      shading_now += std::pow(one.shading_now - base_now, 2);
      shading_then += std::pow(one.shading_then - base_then, 2);
    }
    const double carried_um = 0.5 * std::hypot(now.x_um - then->x_um, now.y_um - then->y_um);
    const auto less_carried = [carried_um](double um) {
      return std::sqrt(std::max(0.0, um * um - carried_um * carried_um));
    };
    const auto motion_um = [&](std::ptrdiff_t ranks) {
      const auto rank = static_cast<std::ptrdiff_t>((least.size() - 1) * 3 / 4) + ranks;
      const auto last = static_cast<std::ptrdiff_t>(least.size()) - 1;
      const double noise =
          std::min(least[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(rank, 0, last))].change, most_noise);
      double evidence = 0;
      for (std::size_t i = 0; i < both.size(); ++i) {
        const double change = both[i].change - noise;
        evidence += both[i].g * (change > 0.0 ? std::max(change - fades[i], 0.0) : change);
      }
      return less_carried(config_.pitch_um / 16.0 * std::sqrt(std::max(0.0, evidence) / energy));
    };
    out.least_um = motion_um(kRanks);
    out.most_um = motion_um(-kRanks);
    out.growth = covered ? std::log2((energy_now + 0.2 * n) / (energy_then + 0.2 * n)) / 2.0
                         : std::log2(shading_now / shading_then);
    if (out.relief <= kMostReliefForCoarse) {
      const CoarseSeen seen = coarse_reference(coarse);
      const double um = config_.pitch_um / 16.0 * seen.motion_steps;
      out.coarse_um = less_carried(um);
      out.coarse_signal = seen.signal;
      if (um > 0.0) out.coarse_left = 1.0 - std::pow(carried_um / um, 2);
      out.coarse_signal = seen.signal * out.coarse_left;
    }
    const double floor = n * (0.1 + std::pow(empty, 2));
    out.over_floor = std::min(energy_now, energy_then) / floor;
    out.over_half = std::min(energy_now, energy_then) / (floor - 0.05 * n);
    if (out.over_half < 1.0) out.turnover = 0.0;
    if (out.over_floor >= 1.0 && motion_um(0) > 0) out.motion_um = std::max(1.0, motion_um(0));
  }

  imprint::Config config_;
  int side_ = 1, width_ = 0, height_ = 0;
  std::vector<double> pixels_;
  std::array<std::optional<Square>, 4 * kMaxMarkers> empty_;
  int empty_frames_ = 0;
  double noise_relief_ = 0;
  double threshold_ = 0;    // of the G of a patch in contact, kPairs times
  std::deque<Frame> kept_;  // newest first
};

}  // namespace holdfast::test
