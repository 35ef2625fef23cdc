// SPDX-License-Identifier: Apache-2.0
// The oracle of the firmware's stages: pictures of known truth, and the features in plain floating point.
//
// Written from DESIGN.md (features) and the paper's section III, with no line shared with firmware/: double
// where the firmware has Q formats, roots and logarithms where it has tables. Slow and allocating on purpose.
//
// Units: px of the picture (centre of the top-left pixel = (0, 0), +x right, +y down), um on the gel, s, nat.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "vision/luma.hpp"

namespace holdfast::reference_model {

using Point = scene::PointPx;

// --- Features ---

inline constexpr int kBins = 15;
using Histogram = std::array<int, kBins>;

struct Config {
  double pitch_um = 2020.0;  // printed spacing
  double range_um = 1900.0;  // R: upper end of the histogram
  double min_step_s = 0.001;
  double max_gap_s = 0.250;  // a longer step has no rates
};

// A lost marker is an empty optional: it lowers n and never counts as a zero.
using Positions = std::vector<std::optional<Point>>;      // px
using Displacements = std::vector<std::optional<Point>>;  // um

struct Features {
  double vx_um_s = 0.0;
  double vy_um_s = 0.0;
  double entropy_nat = 0.0;
  double entropy_rate_nat_s = 0.0;
  int markers = 0;
  bool rates_valid = false;
  Histogram histogram{};
};

// D = (now - rest) * pitch_um / pitch_px, per marker seen in both. Shapes equal.
[[nodiscard]] Displacements displacement_um(const Positions& now, const Positions& rest, double pitch_px,
                                            double pitch_um);
// abs(D) over [0, range_um); what lies beyond falls in the last bin.
[[nodiscard]] Histogram histogram_of(const Displacements& displacements, double range_um);
// -sum p ln p, smallest terms first; 0 of an empty histogram.
[[nodiscard]] long double entropy_long_double(std::span<const int> counts);

// The features frame by frame. Rates need a frame before, min_step_s <= dt <= max_gap_s, and a marker common to both.
class Model {
 public:
  explicit Model(const Config& config = {}) : config_(config) {}
  Features update(const Displacements& displacements, std::int64_t timestamp_us);
  // From positions: displacement_um() first.
  Features update(const Positions& now, const Positions& rest, double pitch_px, std::int64_t timestamp_us);

 private:
  Config config_;
  bool known_ = false;
  std::int64_t last_us_ = 0;
  double last_entropy_nat_ = 0.0;
  Displacements last_;
};

// --- Window sums ---

struct WindowSums {
  double mass = 0.0;
  double x = 0.0;
  double y = 0.0;
};

// weight(x, y) = clamp(threshold(x, y) - luma, 0, cap) over size x size pixels from (left, top).
[[nodiscard]] WindowSums window_sums(const LumaView& luma, int left, int top, int size,
                                     const std::function<int(int x, int y)>& threshold, int cap);

// --- Pictures of known truth ---

struct Picture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> pixels;
  [[nodiscard]] LumaView view() const { return {pixels.data(), width, height, width}; }
};

struct Grid {
  int rows = 7;
  int cols = 9;
  double pitch_mm = 2.02;
};

// From a place on the resting gel (mm, 0 = centre of the grid) to where it is now (mm).
using Warp = std::function<scene::Vec2(scene::Vec2)>;

// Index = row * cols + col, row 0 at the top.
[[nodiscard]] std::vector<Point> lattice_px(const Grid& grid, const scene::PictureConfig& config,
                                            const Warp& warp = {});
[[nodiscard]] Picture picture_of(const scene::PictureConfig& config, std::span<const Point> dots, std::uint64_t seed);
// A disc of any size and light over the picture, with a hard edge.
void draw_disc(Picture& picture, Point centre, double radius_px, std::uint8_t level);
// All pixels alike.
[[nodiscard]] Picture flat(int width, int height, std::uint8_t level);

[[nodiscard]] Warp shifted(double dx_mm, double dy_mm);
[[nodiscard]] Warp rotated(double degrees);
// x + shear_x y, y + shear_y x.
[[nodiscard]] Warp sheared(double shear_x, double shear_y);
// Moves by (dx, dy) exp(-r^2 / (2 sigma^2)) around a centre: what a small object does to the gel.
[[nodiscard]] Warp gaussian(scene::Vec2 centre, double sigma_mm, double dx_mm, double dy_mm);
// Radial r (1 + strength exp(-r^2 / (2 sigma^2))): the gel pressed outwards (or sucked inwards).
[[nodiscard]] Warp bulged(double strength, double sigma_mm);
// `first`, then `second`.
[[nodiscard]] Warp chained(Warp first, Warp second);

[[nodiscard]] double distance(Point a, Point b);

}  // namespace holdfast::reference_model
