// SPDX-License-Identifier: Apache-2.0
// The oracle of tactile/imprint.hpp: the same definitions in double, sampled at exact places, one patch after the other
// and with the whole picture smoothed. It keeps every frame it saw.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "tactile/imprint.hpp"

namespace holdfast::test {

class ImprintReference {
 public:
  struct Seen {
    double motion_um[3] = {0, 0, 0};  // 0: not known
    int patches = 0;
    bool close[3] = {false, false, false};  // the bend of the gel is so near to the motion that rounding decides
    double disputed = 0.0;  // largest distance from the threshold, as a share, at which `counted` disagrees
  };

  // Whether a patch takes part in the motion since the frame at then_s. Patches near the threshold may fall on either
  // side; with the other's choice the figures themselves can be compared.
  using Counted = std::function<bool(std::size_t patch, double then_s)>;

  explicit ImprintReference(const imprint::Config& config) : config_(config) {}

  Seen update(const LumaView& picture, const MarkerField& now, const MarkerField& rest, PixelsQ8 pitch, bool empty,
              double t_s, const Counted& counted = {}) {
    reduce(picture, pitch.raw() / 256.0);
    Frame frame;
    frame.t_s = t_s;
    frame.markers = now;
    pitch_px_ = pitch.raw() / 256.0;
    const double floor = kPairs * config_.contact_floor_q8;
    double threshold = 2.0 * floor;
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
            Patch patch{*samples, empty_[key] ? relief(*samples, *empty_[key]) : 0.0, row, col, sx, sy};
            if (empty) learn(key, *samples);
            if (empty_[key] && relief(*empty_[key], Square{}) > kPairs * 8.0 * 256) continue;
            ++patches;
            reliefs += patch.relief;
            if (patch.relief > threshold) ++out.patches;
            frame.patches[key] = patch;
          }
        }
      }
    }
    if (empty && patches > 0 && empty_frames_ > 8) {
      noise_relief_ += (reliefs / patches - noise_relief_) / (empty_frames_ - 8);
    }
    for (int k = 0; k < 3; ++k) out.motion_um[k] = motion(frame, k, empty, threshold, counted, out);
    if (kept_.empty() || t_s - kept_.front().t_s >= 0.035 - 1e-9) kept_.push_front(frame);
    if (kept_.size() > 14) kept_.pop_back();
    return out;
  }

 private:
  static constexpr int kN = 25, kPairs = 17;
  using Square = std::array<double, 64>;  // by b, then a; those that are not free are 0
  struct Patch {
    Square samples{};
    double relief = 0.0;
    int row = 0, col = 0, sx = 1, sy = 1;
  };
  struct Frame {
    double t_s = 0.0;
    MarkerField markers;
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
    double dx = 0, dy = 0;
    const struct {
      int r, c;
      double weight;
    } corners[] = {{row, col, 9}, {row, nc, 3}, {nr, col, 3}, {nr, nc, 1}};
    for (const auto& corner : corners) {
      const Marker &to = marker(now, corner.r, corner.c), &from = marker(rest, corner.r, corner.c);
      if (!to.valid || !from.valid) return std::nullopt;
      dx += corner.weight / 16 * (px(to.x) - px(from.x));
      dy += corner.weight / 16 * (px(to.y) - px(from.y));
    }
    const Marker& own = marker(rest, row, col);
    const Marker& beside = marker(rest, row, right ? col + sx : col - sx);
    const Marker& over = marker(rest, down ? row + sy : row - sy, col);
    if (!beside.valid || !over.valid) return std::nullopt;
    const double sa = right ? 1 : -1, sb = down ? 1 : -1;
    const double ax = sa * (px(beside.x) - px(own.x)) / 16, ay = sa * (px(beside.y) - px(own.y)) / 16;
    const double bx = sb * (px(over.x) - px(own.x)) / 16, by = sb * (px(over.y) - px(own.y)) / 16;
    const auto to_reduced = [&](double x) { return (x - (side_ - 1) / 2.0) / side_; };
    Square square{};
    for (int b = 0; b < 8; ++b) {
      for (int a = 0; a < 8; ++a) {
        const double u = a + 0.5, v = b + 0.5;
        // The patch stands or falls as a whole, at rest as well as now.
        if (!value(to_reduced(px(own.x) + u * ax + v * bx), to_reduced(px(own.y) + u * ay + v * by))) {
          return std::nullopt;
        }
        const auto seen =
            value(to_reduced(px(own.x) + dx + u * ax + v * bx), to_reduced(px(own.y) + dy + u * ay + v * by));
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

  // Variance of the four dots' motion about the patch's own, in samples^2.
  [[nodiscard]] double bend(const MarkerField& now, const MarkerField& then, const Patch& patch) const {
    const int rows = now.grid.rows, cols = now.grid.cols;
    const int nc = patch.col + patch.sx >= 0 && patch.col + patch.sx < cols ? patch.col + patch.sx : patch.col;
    const int nr = patch.row + patch.sy >= 0 && patch.row + patch.sy < rows ? patch.row + patch.sy : patch.row;
    const struct {
      int r, c;
      double weight;
    } corners[] = {
        {patch.row, patch.col, 9.0 / 16}, {patch.row, nc, 3.0 / 16}, {nr, patch.col, 3.0 / 16}, {nr, nc, 1.0 / 16}};
    const auto moved = [&](int r, int c) {
      const auto i = static_cast<std::size_t>(r * cols + c);
      const double step = 256.0 * pitch_px_ / 16.0;
      return std::pair((now.markers[i].x.raw() - then.markers[i].x.raw()) / step,
                       (now.markers[i].y.raw() - then.markers[i].y.raw()) / step);
    };
    double x = 0, y = 0, sum = 0;
    for (const auto& corner : corners) {
      x += corner.weight * moved(corner.r, corner.c).first;
      y += corner.weight * moved(corner.r, corner.c).second;
    }
    for (const auto& corner : corners) {
      const auto [dx, dy] = moved(corner.r, corner.c);
      sum += corner.weight * (std::pow(dx - x, 2) + std::pow(dy - y, 2));
    }
    return std::min(sum, 64.0);
  }

  double motion(const Frame& now, int k, bool empty, double threshold, const Counted& counted, Seen& seen) {
    constexpr double kLags_s[] = {0.12, 0.24, 0.48};
    const Frame* then = nullptr;
    double off = kLags_s[k] / 3 + 1e-9;
    for (const Frame& kept : kept_) {
      const double distance = std::abs(now.t_s - kept.t_s - kLags_s[k]);
      if (distance > off - (then == nullptr ? 0 : 2e-9)) continue;
      off = distance;
      then = &kept;
    }
    if (then == nullptr) return 0;
    double change = 0, relief = 0, bent = 0, all = 0;
    int pressed = 0, both = 0;
    for (std::size_t key = 0; key < now.patches.size(); ++key) {
      if (!now.patches[key] || !then->patches[key]) continue;
      const Patch &patch = *now.patches[key], &before = *then->patches[key];
      double sum = 0, squares = 0;
      for (std::size_t i = 0; i < patch.samples.size(); ++i) {
        const double r = patch.samples[i] - before.samples[i];
        sum += r;
        squares += r * r;
      }
      const double about_mean = kN * squares - sum * sum;
      all += about_mean;
      ++both;
      const double reliefs = patch.relief + before.relief;
      bool in_contact = reliefs > 2 * threshold;
      if (counted && counted(key, then->t_s) != in_contact) {
        in_contact = !in_contact;
        seen.disputed = std::max(seen.disputed, std::abs(reliefs / (2 * threshold) - 1));
      }
      if (!in_contact) continue;
      change += about_mean;
      relief += reliefs;
      bent += reliefs * bend(now.markers, then->markers, patch);
      ++pressed;
    }
    if (empty && both > 0) {
      noise_frames_[k] = std::min(noise_frames_[k] + 1, 64);
      noise_motion_[k] += (all / both - noise_motion_[k]) / noise_frames_[k];
    }
    if (pressed < config_.least_patches) return 0;
    change -= pressed * noise_motion_[k];
    const double told = kN * kN * bent / (2 * kPairs);
    seen.close[k] = told > 0 && std::abs(change / told - 1) < 0.03;
    if (change <= told) return 0;
    // 1.2 levels^2 and 0.12 a patch, in units of 16 levels and of the sum of two reliefs.
    relief += 2 * kPairs * 256 * (1.2 + 0.12 * pressed) - 2 * pressed * noise_relief_;
    if (change <= 0) return 0;
    return std::max(1.0, config_.pitch_um / 16.0 * std::sqrt(change / (kN * kN) / (relief / (2 * kPairs))));
  }

  imprint::Config config_;
  int side_ = 1, width_ = 0, height_ = 0;
  double pitch_px_ = 0;
  std::vector<double> pixels_;
  std::array<std::optional<Square>, 4 * kMaxMarkers> empty_;
  int empty_frames_ = 0;
  double noise_relief_ = 0, noise_motion_[3] = {0, 0, 0};
  int noise_frames_[3] = {0, 0, 0};
  std::deque<Frame> kept_;  // newest first
};

}  // namespace holdfast::test
