// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/sim/scene/contact/layer.hpp"
#include "drivers/sim/scene/math/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// Two doubles that every machine multiplies and adds in the same order.
using Pair = double __attribute__((vector_size(16)));
using Field = std::vector<double>;

constexpr int kMostSteps = 64;           // of one call
constexpr double kStepTravel = 1.0;      // of a step, in cells
constexpr int kMostPasses = 4;           // of one step
constexpr double kPlaceAccuracy = 0.02;  // of a cell
constexpr int kMostPressRounds = 40;
constexpr int kMostShearRounds = 40;
constexpr int kMostRoundProducts = 40;
constexpr int kMostLetGo = 24;  // rounds in which cells fall from static to kinetic friction
constexpr double kRoundReduction = 0.1;
constexpr double kSafety = 1.5;  // the middle cell's row of influences may not be the largest
constexpr double kPointOnLimit = 1.0 - 1e-9;
// Where the solver stops a cell that slides may be a little below its limit. Within 1e-4 of it no frame of a cylinder's
// steady slide is below half on the default grid, where the tolerance is 1e-4 of the motion; ten times that leaves room
// for other bodies.
constexpr double kTimesTolerance = 10.0;
constexpr double kFarHeight_mm = 1e5;  // the cliff beyond a flat's rim never touches
constexpr double kMostLength_mm = 1e9;
constexpr double kMostPad_mm = 1e4;
constexpr double kMostLoad = 1e12;  // force over shear modulus, mm^2
constexpr int kBlock = 4;           // cells of a row that the products do at once
constexpr int kBorder = 2;          // cells around the grid, so that stencils need no edges

double cross(Vec2 a, Vec2 b) {
  return a.x * b.y - a.y * b.x;
}

struct Turn {
  explicit Turn(double angle_rad) : c(portable::cos(angle_rad)), s(portable::sin(angle_rad)) {}
  [[nodiscard]] Vec2 operator()(Vec2 v) const { return {c * v.x - s * v.y, s * v.x + c * v.y}; }
  double c, s;
};

// Motion of a point of the surface under a unit of traction on a cell, G = 1: by shear along x and y, by pressure
// into the depth and along the surface.
struct Influence {
  double xx = 0.0, xy = 0.0, yy = 0.0, zz = 0.0, px = 0.0, py = 0.0;
};

double asinh(double x) {
  const double most = std::abs(x);
  return std::copysign(portable::log(most + std::sqrt(most * most + 1.0)), x);
}

// Antiderivatives of 1/r-like kernels at a corner of the cell.
struct Corner {
  double xx, yy, xy, px, py;
  Corner(double x, double y) {
    const double r = std::sqrt(x * x + y * y);
    xx = y != 0.0 ? y * asinh(x / std::abs(y)) : 0.0;
    yy = x != 0.0 ? x * asinh(y / std::abs(x)) : 0.0;
    xy = -r;
    const double log_r = r > 0.0 ? portable::log(r) : 0.0;
    px = y * log_r + (x != 0.0 ? x * portable::atan2(y * std::copysign(1.0, x), std::abs(x)) : 0.0);
    py = x * log_r + (y != 0.0 ? y * portable::atan2(x * std::copysign(1.0, y), std::abs(y)) : 0.0);
  }
};

// Johnson 3.2: point forces on the half-space, integrated over a square of side `cell` around 0.
Influence half_space(double nu, double cell, Vec2 at) {
  const double h = 0.5 * cell;
  const Corner a(at.x + h, at.y + h);
  const Corner b(at.x - h, at.y + h);
  const Corner c(at.x + h, at.y - h);
  const Corner d(at.x - h, at.y - h);
  const auto sum = [&](double Corner::*part) { return (a.*part - b.*part) - (c.*part - d.*part); };
  const double xx = sum(&Corner::xx);
  const double yy = sum(&Corner::yy);
  const double both = xx + yy;
  const double scale = 0.5 / pi;
  Influence k;
  k.xx = scale * ((1.0 - nu) * both + nu * xx);
  k.yy = scale * ((1.0 - nu) * both + nu * yy);
  k.xy = scale * nu * sum(&Corner::xy);
  k.zz = scale * (1.0 - nu) * both;
  k.px = -0.5 * scale * (1.0 - 2.0 * nu) * sum(&Corner::px);
  k.py = -0.5 * scale * (1.0 - 2.0 * nu) * sum(&Corner::py);
  return k;
}

struct Row {
  int lo = 0;
  int hi = 0;  // lo >= hi: empty
};
using Rows = std::vector<Row>;

std::size_t idx(int i) {
  return static_cast<std::size_t>(i);
}

void widen(Row& row, int lo, int hi) {
  if (row.lo >= row.hi) {
    row = {lo, hi};
  } else {
    row = {std::min(row.lo, lo), std::max(row.hi, hi)};
  }
}

Pair load(const double* from) {
  Pair pair;
  std::memcpy(&pair, from, sizeof pair);
  return pair;
}
void store(double* to, Pair pair) {
  std::memcpy(to, &pair, sizeof pair);
}

// A square of side `cell` around 0, seen from `at`: half-space in closed form, the smooth rest by 2 x 2 Gauss points a
// panel, panels no wider than the layer is thick.
Influence influence(const Layer& layer, double cell, Vec2 at) {
  const Gel& gel = layer.gel();
  Influence k = half_space(gel.poisson, cell, at);
  if (!(gel.thickness_mm < std::numeric_limits<double>::infinity())) return k;
  constexpr double kNode = 0.2886751345948129;  // sqrt(1/12) of the panel from its middle
  const int panels = static_cast<int>(std::clamp(std::ceil(cell / gel.thickness_mm), 1.0, 16.0));
  const double side = cell / panels;
  const double area = 0.25 * side * side;
  const auto place = [&](int node) {
    const int panel = node / 2;
    return side * (panel + 0.5 + (node % 2 == 0 ? -kNode : kNode));
  };
  for (int j = 0; j < 2 * panels; ++j) {
    for (int i = 0; i < 2 * panels; ++i) {
      const double x = at.x + 0.5 * cell - place(i);
      const double y = at.y + 0.5 * cell - place(j);
      const double r = std::sqrt(x * x + y * y);
      const LayerPoint rest = layer.point(r);
      const double cx = r > 0.0 ? x / r : 1.0;
      const double cy = r > 0.0 ? y / r : 0.0;
      const double fan = rest.fan * (cx * cx - cy * cy);
      k.xx += area * (rest.mean + fan);
      k.yy += area * (rest.mean - fan);
      k.xy += area * rest.fan * 2.0 * cx * cy;
      k.zz += area * rest.sink;
      if (r > 0.0) {
        k.px += area * rest.outward * cx;
        k.py += area * rest.outward * cy;
      }
    }
  }
  return k;
}

}  // namespace

// All tractions are in units of the shear modulus, so stresses here have no unit and forces are mm^2.
class GridContact::Solver {
 public:
  Solver(const GridSetup& setup, std::span<const Vec2> markers_mm);

  const ContactState& go(std::optional<double> force_n, double depth_mm, Vec2 at_mm, double twist_rad);
  void scale_friction(double factor) { friction_scale_ = std::max(factor, 0.0); }
  void field(std::span<Vec2> motion_mm) const;
  [[nodiscard]] const GridStats& stats() const { return stats_; }
  [[nodiscard]] Traction traction_at(Vec2 gel_mm) const;

 private:
  using Stencil = std::array<double, 9>;
  struct Cell {
    std::size_t i;
    int x, y;
  };
  // What a step starts from.
  struct Memory {
    Field p, qx, qy;
    Field anchor_x, anchor_y;  // where friction holds the gel under a cell in contact, from its rest
    std::vector<char> slips;
    std::vector<Cell> cells;  // in contact; the rest of the fields is 0 or of no meaning elsewhere
    Vec2 at;
    double twist = 0.0;
    Vec2 place;         // of the object's origin over the gel
    double turn = 0.0;  // of the object against the gel
    double gel_turn = 0.0;
  };

  [[nodiscard]] std::size_t at(int x, int y) const { return idx(y + kBorder) * idx(pitch_) + idx(x + kBorder); }
  [[nodiscard]] Vec2 center(int x, int y) const {
    return {(x - 0.5 * (nx_ - 1)) * cell_, (y - 0.5 * (ny_ - 1)) * cell_};
  }
  [[nodiscard]] const double* kernel(const Field& table, int dx, int dy) const {
    return table.data() + static_cast<std::ptrdiff_t>((dy + ny_ - 1) * table_pitch_ + dx + nx_ - 1);
  }
  template <typename Do>
  void each_cell(Do what) const {
    for (int y = 0; y < ny_; ++y) {
      for (int x = 0; x < nx_; ++x) what(at(x, y));
    }
  }
  [[nodiscard]] Stencil inverse_near(const Field& table) const;
  [[nodiscard]] double around(const Stencil& stencil, const Field& f, std::size_t i) const;

  void press_product(const Field& p, const Rows& from, Field& w, const Rows& to);
  void shear_product(const Field& qx, const Field& qy, const Rows& from, Field& ux, Field& uy, const Rows& to);
  void bulge(const Field& p, const Rows& from, Field& ux, Field& uy, const Rows& to);
  [[nodiscard]] Vec2 start_gel_at(int x, int y) const;

  void see_shape(Vec2 place, double turn);
  void guess_press(double load);
  bool solve_press(std::optional<double> load, double depth);
  void descend_press(bool keep_sum, const Rows& rows, double enough);
  void solve_shear();
  void descend_shear();
  void newton_shear(double self, double enough);
  // The gel's motion under a cell by a unit of its own traction.
  [[nodiscard]] double self_motion() const { return 0.5 * (*kernel(xx_, 0, 0) + *kernel(yy_, 0, 0)); }
  [[nodiscard]] bool on_limit(std::size_t i, double near) const;
  [[nodiscard]] bool is_driven_over(std::size_t i) const;

  void step(std::optional<double> load, double depth, Vec2 at_mm, double twist_rad);
  void anchor(Vec2 at_mm, double twist_rad);
  void find_gel();
  void settle();
  void lift();
  void summarize();

  // --- the grid ---
  Gel gel_;
  Shape shape_;
  double static_friction_;
  double kinetic_friction_;
  double friction_scale_ = 1.0;
  double tolerance_;
  double cell_ = 1.0;
  int nx_ = 0, ny_ = 0;
  int pitch_ = 0, table_pitch_ = 0;
  Field xx_, xy_, yy_, zz_, px_, py_;
  Stencil near_x_{}, near_y_{}, near_z_{};
  std::size_t markers_ = 0;
  Field marker_;  // per cell: xx, xy, yy, px, py of all markers

  // --- the contact ---
  Memory now_, start_;
  Field height_;
  Vec2 height_place_;
  double height_turn_ = 0.0;
  bool height_known_ = false;
  double depth_ = 0.0;
  double load_ = 0.0;
  Rows rows_;                 // that span the cells in contact
  std::vector<Cell> cells_;   // in contact, or in work
  double slide_share_ = 0.0;  // of the last step's travel that was slip: the next step's first guess
  double turn_share_ = 0.0;
  Vec2 touch_place_;
  double touch_turn_ = 0.0;
  Vec2 middle_;      // of the pressure, on the gel
  Vec2 gel_motion_;  // there
  bool unsettled_ = false;

  // --- scratch ---
  Field w_, d_, e_, z_, r_;
  Field ux_, uy_, vx_, vy_, bx_, by_, rx_, ry_, dx_, dy_, ex_, ey_, zx_, zy_, lambda_, bound_, keep_x_, keep_y_;
  Field twice_;

  ContactState state_;
  GridStats stats_;
};

GridContact::Solver::Solver(const GridSetup& setup, std::span<const Vec2> markers_mm)
    : gel_{setup.gel},
      shape_{setup.shape},
      static_friction_(setup.bonded ? std::numeric_limits<double>::infinity() : std::max(setup.static_friction, 0.0)),
      kinetic_friction_(setup.bonded ? static_friction_ : std::clamp(setup.kinetic_friction, 0.0, static_friction_)),
      tolerance_(std::clamp(setup.tolerance, 1e-12, 1e-1)),
      markers_(markers_mm.size()) {
  gel_.poisson = std::clamp(gel_.poisson, 0.0, 0.5);
  const Vec2 pad{std::clamp(setup.pad_mm.x, 0.01, kMostPad_mm), std::clamp(setup.pad_mm.y, 0.01, kMostPad_mm)};
  cell_ = std::max({setup.cell_mm, std::sqrt(pad.x * pad.y / kMostCells), std::max(pad.x, pad.y) / 1000.0});
  nx_ = std::max(static_cast<int>(std::ceil(pad.x / cell_ - 1e-9)), 1);
  ny_ = std::max(static_cast<int>(std::ceil(pad.y / cell_ - 1e-9)), 1);
  pitch_ = nx_ + 2 * kBorder + kBlock;
  table_pitch_ = 2 * nx_ + kBlock;

  const Layer layer({1.0, gel_.poisson, gel_.thickness_mm});
  const auto table_size = idx(table_pitch_) * idx(2 * ny_ - 1);
  for (Field* table : {&xx_, &xy_, &yy_, &zz_, &px_, &py_}) table->assign(table_size, 0.0);
  for (int dy = 0; dy < ny_; ++dy) {
    for (int dx = 0; dx <= nx_ + kBlock; ++dx) {
      const Influence k = influence(layer, cell_, {dx * cell_, dy * cell_});
      for (const int sy : {1, -1}) {
        for (const int sx : {1, -1}) {
          const int column = sx * dx + nx_ - 1;
          if (column < 0 || column >= table_pitch_) continue;
          const auto i = idx(sy * dy + ny_ - 1) * idx(table_pitch_) + idx(column);
          xx_[i] = k.xx;
          yy_[i] = k.yy;
          zz_[i] = k.zz;
          xy_[i] = sx * sy * k.xy;
          px_[i] = setup.coupled ? sx * k.px : 0.0;
          py_[i] = setup.coupled ? sy * k.py : 0.0;
        }
      }
    }
  }
  near_x_ = inverse_near(xx_);
  near_y_ = inverse_near(yy_);
  near_z_ = inverse_near(zz_);

  marker_.resize(5 * markers_ * idx(nx_) * idx(ny_));
  double* column = marker_.data();
  for (int y = 0; y < ny_; ++y) {
    for (int x = 0; x < nx_; ++x, column += 5 * markers_) {
      for (std::size_t m = 0; m < markers_; ++m) {
        const Influence k = influence(layer, cell_, markers_mm[m] - center(x, y));
        column[m] = k.xx;
        column[markers_ + m] = k.xy;
        column[2 * markers_ + m] = k.yy;
        column[3 * markers_ + m] = setup.coupled ? k.px : 0.0;
        column[4 * markers_ + m] = setup.coupled ? k.py : 0.0;
      }
    }
  }

  const auto size = idx(pitch_) * idx(ny_ + 2 * kBorder);
  for (Field* f : {&now_.p, &now_.qx, &now_.qy, &now_.anchor_x, &now_.anchor_y, &height_, &w_,     &d_,  &e_,  &z_,
                   &r_,     &ux_,     &uy_,     &rx_,           &ry_,           &dx_,     &dy_,    &ex_, &ey_, &bx_,
                   &by_,    &vx_,     &vy_,     &lambda_,       &keep_x_,       &keep_y_, &bound_, &zx_, &zy_}) {
    f->assign(size, 0.0);
  }
  now_.slips.assign(size, 0);
  rows_.assign(idx(ny_), Row{});
}

// What undoes the influence of a cell and its neighbours on each other: the middle row of the inverse of their 9 x 9
// matrix. As a stencil it does most of the conjugate gradients' work on short waves.
GridContact::Solver::Stencil GridContact::Solver::inverse_near(const Field& table) const {
  constexpr std::size_t kN = 9;
  std::array<std::array<double, kN + 1>, kN> m{};
  for (std::size_t i = 0; i < kN; ++i) {
    for (std::size_t j = 0; j < kN; ++j) {
      const int dx = static_cast<int>(i % 3) - static_cast<int>(j % 3);
      const int dy = static_cast<int>(i / 3) - static_cast<int>(j / 3);
      m[i][j] = nx_ > 2 && ny_ > 2 ? *kernel(table, dx, dy) : (i == j ? *kernel(table, 0, 0) : 0.0);
    }
    m[i][kN] = i == kN / 2 ? 1.0 : 0.0;
  }
  for (std::size_t k = 0; k < kN; ++k) {  // positive definite: no pivoting
    for (std::size_t i = 0; i < kN; ++i) {
      if (i == k) continue;
      const double share = m[i][k] / m[k][k];
      for (std::size_t j = k; j <= kN; ++j) m[i][j] -= share * m[k][j];
    }
  }
  Stencil near{};
  for (std::size_t i = 0; i < kN; ++i) near[i] = m[i][kN] / m[i][i];
  return near;
}

// --- products with the influence matrix: four cells of a row at once, held in registers over all sources ---

void GridContact::Solver::press_product(const Field& p, const Rows& from, Field& w, const Rows& to) {
  ++stats_.press_products;
  twice_.clear();
  for (int sy = 0; sy < ny_; ++sy) {
    for (int sx = from[idx(sy)].lo; sx < from[idx(sy)].hi; ++sx) twice_.insert(twice_.end(), 2, p[at(sx, sy)]);
  }
  for (int y = 0; y < ny_; ++y) {
    for (int x = to[idx(y)].lo; x < to[idx(y)].hi; x += kBlock) {
      Pair a{};
      Pair b{};
      const double* source = twice_.data();
      for (int sy = 0; sy < ny_; ++sy) {
        const Row row = from[idx(sy)];
        const double* k = kernel(zz_, x - row.lo, y - sy);
        for (int sx = row.lo; sx < row.hi; ++sx, --k, source += 2) {
          const Pair s = load(source);
          a += s * load(k);
          b += s * load(k + 2);
        }
      }
      store(&w[at(x, y)], a);
      store(&w[at(x + 2, y)], b);
    }
  }
}

void GridContact::Solver::shear_product(const Field& qx, const Field& qy, const Rows& from, Field& ux, Field& uy,
                                        const Rows& to) {
  ++stats_.shear_products;
  twice_.clear();
  for (int sy = 0; sy < ny_; ++sy) {
    for (int sx = from[idx(sy)].lo; sx < from[idx(sy)].hi; ++sx) {
      twice_.insert(twice_.end(), 2, qx[at(sx, sy)]);
      twice_.insert(twice_.end(), 2, qy[at(sx, sy)]);
    }
  }
  const std::ptrdiff_t to_xy = xy_.data() - xx_.data();
  const std::ptrdiff_t to_yy = yy_.data() - xx_.data();
  for (int y = 0; y < ny_; ++y) {
    for (int x = to[idx(y)].lo; x < to[idx(y)].hi; x += kBlock) {
      Pair xa{};
      Pair xb{};
      Pair ya{};
      Pair yb{};
      const double* source = twice_.data();
      for (int sy = 0; sy < ny_; ++sy) {
        const Row row = from[idx(sy)];
        const double* k = kernel(xx_, x - row.lo, y - sy);
        for (int sx = row.lo; sx < row.hi; ++sx, --k, source += 4) {
          const Pair sxx = load(source);
          const Pair syy = load(source + 2);
          const Pair xy_a = load(k + to_xy);
          const Pair xy_b = load(k + to_xy + 2);
          xa += sxx * load(k) + syy * xy_a;
          xb += sxx * load(k + 2) + syy * xy_b;
          ya += sxx * xy_a + syy * load(k + to_yy);
          yb += sxx * xy_b + syy * load(k + to_yy + 2);
        }
      }
      store(&ux[at(x, y)], xa);
      store(&ux[at(x + 2, y)], xb);
      store(&uy[at(x, y)], ya);
      store(&uy[at(x + 2, y)], yb);
    }
  }
}

void GridContact::Solver::bulge(const Field& p, const Rows& from, Field& ux, Field& uy, const Rows& to) {
  ++stats_.press_products;
  twice_.clear();
  for (int sy = 0; sy < ny_; ++sy) {
    for (int sx = from[idx(sy)].lo; sx < from[idx(sy)].hi; ++sx) twice_.insert(twice_.end(), 2, p[at(sx, sy)]);
  }
  const std::ptrdiff_t to_py = py_.data() - px_.data();
  for (int y = 0; y < ny_; ++y) {
    for (int x = to[idx(y)].lo; x < to[idx(y)].hi; x += kBlock) {
      Pair xa{};
      Pair xb{};
      Pair ya{};
      Pair yb{};
      const double* source = twice_.data();
      for (int sy = 0; sy < ny_; ++sy) {
        const Row row = from[idx(sy)];
        const double* k = kernel(px_, x - row.lo, y - sy);
        for (int sx = row.lo; sx < row.hi; ++sx, --k, source += 2) {
          const Pair s = load(source);
          xa += s * load(k);
          xb += s * load(k + 2);
          ya += s * load(k + to_py);
          yb += s * load(k + to_py + 2);
        }
      }
      store(&ux[at(x, y)], xa);
      store(&ux[at(x + 2, y)], xb);
      store(&uy[at(x, y)], ya);
      store(&uy[at(x + 2, y)], yb);
    }
  }
}

// The gel's motion at one cell when the step began.
Vec2 GridContact::Solver::start_gel_at(int x, int y) const {
  Vec2 u;
  for (const Cell& c : start_.cells) {
    const int dx = x - c.x;
    const int dy = y - c.y;
    const double qx = start_.qx[c.i];
    const double qy = start_.qy[c.i];
    const double xy = *kernel(xy_, dx, dy);
    u.x += *kernel(xx_, dx, dy) * qx + xy * qy + *kernel(px_, dx, dy) * start_.p[c.i];
    u.y += xy * qx + *kernel(yy_, dx, dy) * qy + *kernel(py_, dx, dy) * start_.p[c.i];
  }
  return u;
}

double GridContact::Solver::around(const Stencil& stencil, const Field& f, std::size_t i) const {
  const double* m = &f[i];
  const std::ptrdiff_t down = pitch_;
  // The inverse of an even kernel is even.
  return stencil[4] * m[0] + stencil[3] * (m[-1] + m[1]) + stencil[1] * (m[-down] + m[down]) +
         stencil[0] * ((m[-down - 1] + m[down + 1]) + (m[-down + 1] + m[down - 1]));
}

// --- pressure ---

void GridContact::Solver::see_shape(Vec2 place, double turn) {
  if (height_known_ && place == height_place_ && turn == height_turn_) return;
  const Turn back(-turn);
  for (int y = 0; y < ny_; ++y) {
    for (int x = 0; x < nx_; ++x) height_[at(x, y)] = height_mm(shape_, back(center(x, y) - place));
  }
  height_place_ = place;
  height_turn_ = turn;
  height_known_ = true;
}

// Pressure as of springs that stand alone, to start from.
void GridContact::Solver::guess_press(double load) {
  double low = std::numeric_limits<double>::infinity();
  each_cell([&](std::size_t i) { low = std::min(low, height_[i]); });
  const double area = cell_ * cell_;
  double high = low + load / area;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    double carried = 0.0;
    each_cell([&](std::size_t i) { carried += area * std::max(middle - height_[i], 0.0); });
    (carried < load ? low : high) = middle;
  }
  each_cell([&](std::size_t i) { now_.p[i] = std::max(high - height_[i], 0.0); });
  depth_ = high;
}

// Pressure of `load` (depth follows) or at `depth`. False: no contact.
bool GridContact::Solver::solve_press(std::optional<double> load, double depth) {
  Field& p = now_.p;
  const double area = cell_ * cell_;
  bool any = false;
  double sum = 0.0;
  each_cell([&](std::size_t i) {
    if (height_[i] >= kFarHeight_mm) p[i] = 0.0;
    any = any || height_[i] < (load ? kFarHeight_mm : depth);
    sum += p[i];
  });
  any = any && (!load || *load > 0.0) && gel_.shear_modulus_mpa > 0.0 && gel_.thickness_mm > 0.0;
  if (!any) return false;
  if (!load) {
    depth_ = depth;
  } else if (sum > 0.0) {
    each_cell([&](std::size_t i) { p[i] *= *load / (area * sum); });
  } else {
    guess_press(*load);
  }

  Rows from(idx(ny_)), to(idx(ny_));
  for (int round = 0; round < kMostPressRounds; ++round) {
    std::fill(from.begin(), from.end(), Row{});
    std::fill(to.begin(), to.end(), Row{});
    for (int y = 0; y < ny_; ++y) {
      for (int x = 0; x < nx_; ++x) {
        const std::size_t i = at(x, y);
        if (p[i] > 0.0) {
          widen(from[idx(y)], x, x + 1);
          for (int v = std::max(y - 1, 0); v <= std::min(y + 1, ny_ - 1); ++v) {
            widen(to[idx(v)], std::max(x - 1, 0), std::min(x + 2, nx_));
          }
        } else if (height_[i] < depth_) {
          widen(to[idx(y)], x, x + 1);
        }
      }
    }
    press_product(p, from, w_, to);
    const double seen_depth = depth_;
    if (load) {
      double level = 0.0;
      double count = 0.0;
      each_cell([&](std::size_t i) {
        if (p[i] > 0.0) {
          level += height_[i] + w_[i];
          count += 1.0;
        }
      });
      depth_ = level / count;
    }
    // What presses through the object, and what hangs on it.
    cells_.clear();
    std::fill(from.begin(), from.end(), Row{});
    double worst = 0.0;
    double most = 0.0;
    for (int y = 0; y < ny_; ++y) {
      for (int x = to[idx(y)].lo; x < to[idx(y)].hi; ++x) {
        const std::size_t i = at(x, y);
        const double r = depth_ - height_[i] - w_[i];
        r_[i] = 0.0;
        d_[i] = 0.0;
        if (!(p[i] > 0.0 || r > 0.0) || height_[i] >= kFarHeight_mm) continue;
        worst = std::max(worst, std::abs(r));
        most = std::max(most, std::abs(w_[i]));
        r_[i] = r;
        cells_.push_back({i, x, y});
        widen(from[idx(y)], x, x + 1);
      }
    }
    const double scale = std::max(most, std::abs(depth_));
    stats_.press_residual = scale > 0.0 ? worst / scale : 0.0;
    if (stats_.press_residual <= tolerance_ && std::abs(depth_ - seen_depth) <= 1e-2 * scale) break;
    descend_press(load.has_value(), from, 0.3 * tolerance_ * scale);
    for (const Cell& c : cells_) {
      p[c.i] = std::max(p[c.i], 0.0);
      r_[c.i] = d_[c.i] = 0.0;
    }
    if (load) {
      sum = 0.0;
      for (const Cell& c : cells_) sum += p[c.i];
      if (sum > 0.0) {
        for (const Cell& c : cells_) p[c.i] *= *load / (area * sum);
      } else {
        guess_press(*load);
      }
    }
  }
  for (const Cell& c : cells_) r_[c.i] = d_[c.i] = 0.0;
  unsettled_ = unsettled_ || stats_.press_residual > tolerance_;

  cells_.clear();
  std::fill(rows_.begin(), rows_.end(), Row{});
  for (int y = 0; y < ny_; ++y) {
    for (int x = 0; x < nx_; ++x) {
      if (!(p[at(x, y)] > 0.0)) continue;
      cells_.push_back({at(x, y), x, y});
      widen(rows_[idx(y)], x, x + 1);
    }
  }
  return !cells_.empty();
}

// Conjugate gradients on cells_ from the residual r_; with a load, among pressures of the same sum.
void GridContact::Solver::descend_press(bool keep_sum, const Rows& rows, double enough) {
  const double count = static_cast<double>(cells_.size());
  const auto level = [&](Field& f) {
    if (!keep_sum) return;
    double mean = 0.0;
    for (const Cell& c : cells_) mean += f[c.i];
    mean /= count;
    for (const Cell& c : cells_) f[c.i] -= mean;
  };
  level(r_);
  double before = 0.0;
  double first = 0.0;
  for (int k = 0; k < kMostRoundProducts; ++k) {
    double square = 0.0;
    for (const Cell& c : cells_) square += r_[c.i] * r_[c.i];
    if (k == 0) first = square;
    if (k > 0 && square <= std::max(kRoundReduction * kRoundReduction * first, enough * enough)) break;
    for (const Cell& c : cells_) z_[c.i] = around(near_z_, r_, c.i);
    level(z_);
    double rz = 0.0;
    for (const Cell& c : cells_) rz += r_[c.i] * z_[c.i];
    const double share = k > 0 ? rz / before : 0.0;
    for (const Cell& c : cells_) d_[c.i] = z_[c.i] + share * d_[c.i];
    before = rz;
    press_product(d_, rows, e_, rows);
    double curve = 0.0;
    for (const Cell& c : cells_) curve += d_[c.i] * e_[c.i];
    if (!(curve > 0.0) || !(rz > 0.0)) break;
    const double way = rz / curve;
    for (const Cell& c : cells_) {
      now_.p[c.i] += way * d_[c.i];
      r_[c.i] -= way * e_[c.i];
    }
    level(r_);
  }
}

// --- shear ---

// The least of q A q / 2 - b q over |q| <= bound_ of every cell.
void GridContact::Solver::descend_shear() {
  Field& qx = now_.qx;
  Field& qy = now_.qy;
  const double self = self_motion();
  const double count = static_cast<double>(cells_.size());
  const auto hold = [&](std::size_t i) {
    const double size = std::sqrt(qx[i] * qx[i] + qy[i] * qy[i]);
    if (!(size > bound_[i])) return false;
    qx[i] *= bound_[i] / size;
    qy[i] *= bound_[i] / size;
    return true;
  };
  double wanted = 0.0;
  double held = 0.0;
  for (const Cell& c : cells_) {
    hold(c.i);
    wanted += bx_[c.i] * bx_[c.i] + by_[c.i] * by_[c.i];
    held += std::min(bound_[c.i] * bound_[c.i], 1e300);
  }
  wanted = std::sqrt(wanted / count);
  held = self * std::sqrt(held / count);

  double last = std::numeric_limits<double>::infinity();
  for (int round = 0; round < kMostShearRounds; ++round) {
    shear_product(qx, qy, rows_, ux_, uy_, rows_);
    double energy = 0.0;
    double moved = 0.0;
    for (const Cell& c : cells_) {
      const std::size_t i = c.i;
      energy += qx[i] * (0.5 * ux_[i] - bx_[i]) + qy[i] * (0.5 * uy_[i] - by_[i]);
      moved += ux_[i] * ux_[i] + uy_[i] * uy_[i];
    }
    if (energy > last + 1e-13 * std::abs(last)) {
      // Newton went too far round the discs. On the straight way there (discs are convex) the energy is a parabola: to
      // its lowest point, and on by a step along the residual that is short enough to descend for certain.
      double slope = 0.0;
      double curve = 0.0;
      double steepest = 0.0;
      const Cell& middle = cells_[cells_.size() / 2];
      for (const Cell& c : cells_) {
        const std::size_t i = c.i;
        const Vec2 way{qx[i] - keep_x_[i], qy[i] - keep_y_[i]};
        slope += way.x * rx_[i] + way.y * ry_[i];
        curve += way.x * (ux_[i] - bx_[i] + rx_[i]) + way.y * (uy_[i] - by_[i] + ry_[i]);
        const int dx = middle.x - c.x;
        const int dy = middle.y - c.y;
        steepest +=
            std::max(std::abs(*kernel(xx_, dx, dy)), std::abs(*kernel(yy_, dx, dy))) + std::abs(*kernel(xy_, dx, dy));
      }
      const double share = curve > 0.0 ? std::clamp(slope / curve, 0.0, 1.0) : 0.0;
      const double reach = 1.0 / (kSafety * steepest);
      for (const Cell& c : cells_) {
        const std::size_t i = c.i;
        const double rest_x = (1.0 - share) * rx_[i] + share * (bx_[i] - ux_[i]);
        const double rest_y = (1.0 - share) * ry_[i] + share * (by_[i] - uy_[i]);
        qx[i] = keep_x_[i] + share * (qx[i] - keep_x_[i]) + reach * rest_x;
        qy[i] = keep_y_[i] + share * (qy[i] - keep_y_[i]) + reach * rest_y;
        hold(i);
      }
      last = std::numeric_limits<double>::infinity();
      continue;
    }
    last = energy;
    const double scale = std::max(std::sqrt(moved / count), std::min(wanted, held));
    double worst = 0.0;
    for (const Cell& c : cells_) {
      const std::size_t i = c.i;
      rx_[i] = bx_[i] - ux_[i];
      ry_[i] = by_[i] - uy_[i];
      keep_x_[i] = qx[i];
      keep_y_[i] = qy[i];
      const double along = rx_[i] * qx[i] + ry_[i] * qy[i];
      const double size2 = qx[i] * qx[i] + qy[i] * qy[i];
      lambda_[i] = -1.0;  // sticks: free to both sides
      if (size2 >= kPointOnLimit * kPointOnLimit * bound_[i] * bound_[i] && (along > 0.0 || size2 == 0.0)) {
        lambda_[i] = size2 > 0.0 ? along / size2 : 0.0;
      }
      // How far a step along the residual would take it, back on the disc.
      double nx = qx[i] + rx_[i] / self;
      double ny = qy[i] + ry_[i] / self;
      const double size = std::sqrt(nx * nx + ny * ny);
      if (size > bound_[i]) {
        nx *= bound_[i] / size;
        ny *= bound_[i] / size;
      }
      nx -= qx[i];
      ny -= qy[i];
      worst = std::max(worst, nx * nx + ny * ny);
    }
    stats_.shear_residual = scale > 0.0 ? self * std::sqrt(worst) / scale : 0.0;
    if (stats_.shear_residual <= tolerance_) break;
    newton_shear(self, 0.3 * tolerance_ * scale);
    for (const Cell& c : cells_) {
      const std::size_t i = c.i;
      if (!hold(i) && lambda_[i] >= 0.0 && bound_[i] > 0.0) {
        const double size = std::sqrt(qx[i] * qx[i] + qy[i] * qy[i]);
        qx[i] *= bound_[i] / size;
        qy[i] *= bound_[i] / size;
      }
    }
  }
}

// One step of Newton's from the residual rx_, ry_: stick cells move both ways, slip cells (lambda_ >= 0) along their
// disc, which bends the energy by lambda_.
void GridContact::Solver::newton_shear(double self, double enough) {
  Field& qx = now_.qx;
  Field& qy = now_.qy;
  const auto allow = [&](Field& x, Field& y, std::size_t i) {
    if (lambda_[i] < 0.0) return;
    const double size2 = keep_x_[i] * keep_x_[i] + keep_y_[i] * keep_y_[i];
    const double across = size2 > 0.0 ? (keep_x_[i] * y[i] - keep_y_[i] * x[i]) / size2 : 0.0;
    x[i] = -across * keep_y_[i];
    y[i] = across * keep_x_[i];
  };
  for (const Cell& c : cells_) {
    allow(rx_, ry_, c.i);
    dx_[c.i] = dy_[c.i] = 0.0;
  }
  double before = 0.0;
  double first = 0.0;
  for (int k = 0; k < kMostRoundProducts; ++k) {
    double square = 0.0;
    for (const Cell& c : cells_) square += rx_[c.i] * rx_[c.i] + ry_[c.i] * ry_[c.i];
    if (k == 0) first = square;
    if (k > 0 && square <= std::max(kRoundReduction * kRoundReduction * first, enough * enough)) break;
    for (const Cell& c : cells_) {
      const double soft = lambda_[c.i] > 0.0 ? std::sqrt(self / (self + lambda_[c.i])) : 1.0;
      zx_[c.i] = soft * rx_[c.i];
      zy_[c.i] = soft * ry_[c.i];
    }
    double rz = 0.0;
    for (const Cell& c : cells_) {
      const double soft = lambda_[c.i] > 0.0 ? std::sqrt(self / (self + lambda_[c.i])) : 1.0;
      ex_[c.i] = soft * around(near_x_, zx_, c.i);
      ey_[c.i] = soft * around(near_y_, zy_, c.i);
      allow(ex_, ey_, c.i);
      rz += rx_[c.i] * ex_[c.i] + ry_[c.i] * ey_[c.i];
    }
    const double share = k > 0 ? rz / before : 0.0;
    before = rz;
    for (const Cell& c : cells_) {
      dx_[c.i] = ex_[c.i] + share * dx_[c.i];
      dy_[c.i] = ey_[c.i] + share * dy_[c.i];
    }
    shear_product(dx_, dy_, rows_, ex_, ey_, rows_);
    double curve = 0.0;
    for (const Cell& c : cells_) {
      const std::size_t i = c.i;
      if (lambda_[i] > 0.0) {
        ex_[i] += lambda_[i] * dx_[i];
        ey_[i] += lambda_[i] * dy_[i];
      }
      allow(ex_, ey_, i);
      curve += dx_[i] * ex_[i] + dy_[i] * ey_[i];
    }
    if (!(curve > 0.0) || !(rz > 0.0)) break;
    const double way = rz / curve;
    for (const Cell& c : cells_) {
      const std::size_t i = c.i;
      qx[i] += way * dx_[i];
      qy[i] += way * dy_[i];
      rx_[i] -= way * ex_[i];
      ry_[i] -= way * ey_[i];
    }
  }
  for (const Cell& c : cells_) {
    rx_[c.i] = bx_[c.i] - ux_[c.i];
    ry_[c.i] = by_[c.i] - uy_[c.i];
    dx_[c.i] = dy_[c.i] = zx_[c.i] = zy_[c.i] = 0.0;
  }
}

void GridContact::Solver::solve_shear() {
  const bool drops = kinetic_friction_ < static_friction_;
  for (int round = 0; round < kMostLetGo; ++round) {
    for (const Cell& c : cells_) {
      bound_[c.i] =
          friction_scale_ * (drops && now_.slips[c.i] != 0 ? kinetic_friction_ : static_friction_) * now_.p[c.i];
    }
    descend_shear();
    unsettled_ = unsettled_ || stats_.shear_residual > tolerance_;
    bool any = false;
    if (drops) {
      for (const Cell& c : cells_) {
        if (now_.slips[c.i] != 0 || !on_limit(c.i, kPointOnLimit)) continue;
        now_.slips[c.i] = 1;
        any = true;
      }
    }
    if (!any) break;
  }
  for (const Cell& c : cells_) now_.slips[c.i] = on_limit(c.i, kPointOnLimit) || is_driven_over(c.i) ? 1 : 0;
}

bool GridContact::Solver::on_limit(std::size_t i, double near) const {
  const double size2 = now_.qx[i] * now_.qx[i] + now_.qy[i] * now_.qy[i];
  return size2 >= near * near * bound_[i] * bound_[i];
}

// Near its limit, and the object would drive it past. Of static friction it lets go in the next step.
bool GridContact::Solver::is_driven_over(std::size_t i) const {
  if (!on_limit(i, 1.0 - kTimesTolerance * tolerance_)) return false;
  const double self = self_motion();
  const double x = now_.qx[i] + (bx_[i] - ux_[i]) / self;
  const double y = now_.qy[i] + (by_[i] - uy_[i]) / self;
  return x * x + y * y > bound_[i] * bound_[i];
}

// --- one step ---

// Where friction wants the gel under each cell: carried along by the object. What enters the contact was free before.
void GridContact::Solver::anchor(Vec2 at_mm, double twist_rad) {
  const Turn gel(start_.gel_turn);
  const Turn turn(twist_rad - start_.twist);
  each_cell([&](std::size_t i) {
    if (now_.p[i] > 0.0 && start_.p[i] > 0.0) return;
    now_.qx[i] = now_.qy[i] = 0.0;
    now_.slips[i] = 0;
  });
  for (const Cell& c : cells_) {
    Vec2 to;
    if (!start_.cells.empty()) {
      const Vec2 arm = gel(center(c.x, c.y) - start_.place);
      to = start_.p[c.i] > 0.0 ? Vec2{start_.anchor_x[c.i], start_.anchor_y[c.i]} : start_gel_at(c.x, c.y);
      to = to + (at_mm - start_.at) + (turn(arm) - arm);
    }
    now_.anchor_x[c.i] = to.x;
    now_.anchor_y[c.i] = to.y;
    bx_[c.i] = to.x - vx_[c.i];
    by_[c.i] = to.y - vy_[c.i];
    now_.slips[c.i] = start_.slips[c.i];
  }
}

// The rigid motion nearest to the gel's under the middle of the contact.
void GridContact::Solver::find_gel() {
  double sum = 0.0;
  Vec2 first;
  for (const Cell& c : cells_) {
    sum += now_.p[c.i];
    first = first + now_.p[c.i] * center(c.x, c.y);
  }
  middle_ = (1.0 / sum) * first;
  const double radius = cell_ * std::sqrt(static_cast<double>(cells_.size()) / pi);
  const double reach = std::max(2.5 * cell_, radius / 3.0);
  double weights = 0.0;
  Vec2 arm, motion;
  const auto each = [&](auto what) {
    for (int y = 0; y < ny_; ++y) {
      for (int x = rows_[idx(y)].lo; x < rows_[idx(y)].hi; ++x) {
        const Vec2 d = center(x, y) - middle_;
        const double weight = 1.0 - dot(d, d) / (reach * reach);
        if (weight > 0.0) what(weight, d, Vec2{ux_[at(x, y)] + vx_[at(x, y)], uy_[at(x, y)] + vy_[at(x, y)]});
      }
    }
  };
  each([&](double weight, Vec2 d, Vec2 u) {
    weights += weight;
    arm = arm + weight * d;
    motion = motion + weight * u;
  });
  if (!(weights > 0.0)) return;
  arm = (1.0 / weights) * arm;
  motion = (1.0 / weights) * motion;
  double c = 0.0;
  double s = 0.0;
  each([&](double weight, Vec2 d, Vec2 u) {
    const Vec2 from = d - arm;
    const Vec2 to = from + (u - motion);
    c += weight * dot(from, to);
    s += weight * cross(from, to);
  });
  now_.gel_turn = c != 0.0 || s != 0.0 ? portable::atan2(s, c) : 0.0;
  gel_motion_ = motion - (Turn(now_.gel_turn)(arm) - arm);
}

void GridContact::Solver::step(std::optional<double> load, double depth, Vec2 at_mm, double twist_rad) {
  ++stats_.steps;
  unsettled_ = false;
  start_ = now_;
  const bool fresh = start_.cells.empty();
  const Vec2 travel = at_mm - start_.at;
  const double turned = twist_rad - start_.twist;
  now_.at = at_mm;
  now_.twist = twist_rad;
  now_.place = fresh ? at_mm : start_.place + slide_share_ * travel;
  now_.turn = fresh ? twist_rad : start_.turn + turn_share_ * turned;
  for (int pass = 0; pass < kMostPasses; ++pass) {
    ++stats_.passes;
    see_shape(now_.place, now_.turn);
    if (!solve_press(load, depth)) return lift();
    bulge(now_.p, rows_, vx_, vy_, rows_);
    anchor(at_mm, twist_rad);
    solve_shear();
    find_gel();
    const Vec2 arm = now_.place - middle_;
    const Vec2 place = at_mm - gel_motion_ - (Turn(now_.gel_turn)(arm) - arm);
    const double turn = twist_rad - now_.gel_turn;
    const double radius = cell_ * std::sqrt(static_cast<double>(cells_.size()));
    const double off = length(place - now_.place) + radius * std::abs(turn - now_.turn);
    now_.place = place;
    now_.turn = turn;
    if (off <= kPlaceAccuracy * cell_) break;
  }
  settle();
  if (fresh) {
    touch_place_ = now_.place;
    touch_turn_ = now_.turn;
    slide_share_ = turn_share_ = 0.0;
  } else {
    const double way = dot(travel, travel);
    if (way > 0.0) slide_share_ = std::clamp(dot(now_.place - start_.place, travel) / way, 0.0, 1.0);
    if (turned != 0.0) turn_share_ = std::clamp((now_.turn - start_.turn) / turned, 0.0, 1.0);
  }
}

// What slipped is held where it came to rest; what left the contact is forgotten.
void GridContact::Solver::settle() {
  const double area = cell_ * cell_ * gel_.shear_modulus_mpa;
  for (const Cell& c : cells_) {
    const std::size_t i = c.i;
    if (now_.slips[i] == 0) continue;
    const Vec2 slip{bx_[i] - ux_[i], by_[i] - uy_[i]};
    stats_.dissipated_mj += std::max(area * (now_.qx[i] * slip.x + now_.qy[i] * slip.y), 0.0);
    now_.anchor_x[i] = ux_[i] + vx_[i];
    now_.anchor_y[i] = uy_[i] + vy_[i];
  }
  now_.cells = cells_;
  if (unsettled_) ++stats_.unsettled;
}

void GridContact::Solver::lift() {
  for (Field* f : {&now_.p, &now_.qx, &now_.qy}) std::fill(f->begin(), f->end(), 0.0);
  std::fill(now_.slips.begin(), now_.slips.end(), char{0});
  cells_.clear();
  now_.cells.clear();
  now_.gel_turn = 0.0;
  depth_ = 0.0;
}

const ContactState& GridContact::Solver::go(std::optional<double> force_n, double depth_mm, Vec2 at_mm,
                                            double twist_rad) {
  const auto bounded = [](double v) { return std::clamp(v, -kMostLength_mm, kMostLength_mm); };
  const Vec2 to{bounded(at_mm.x), bounded(at_mm.y)};
  const double twist = bounded(twist_rad);
  std::optional<double> load;
  if (force_n) load = *force_n > 0.0 ? std::min(*force_n / gel_.shear_modulus_mpa, kMostLoad) : 0.0;
  stats_.passes = stats_.press_products = stats_.shear_products = 0;

  int steps = 1;
  const Vec2 at_from = now_.at;
  const double twist_from = now_.twist;
  const double depth_from = depth_;
  const double load_from = load_;
  if (!now_.cells.empty()) {
    const double radius = cell_ * std::sqrt(static_cast<double>(now_.cells.size()) / pi);
    const double travel = std::max(length(to - at_from), radius * std::abs(twist - twist_from));
    steps =
        static_cast<int>(std::clamp(std::ceil(travel / (kStepTravel * cell_)), 1.0, static_cast<double>(kMostSteps)));
  }
  for (int k = 1; k <= steps; ++k) {
    const double share = static_cast<double>(k) / steps;
    const auto between = [&](double a, double b) { return k == steps ? b : a + share * (b - a); };
    const Vec2 here{between(at_from.x, to.x), between(at_from.y, to.y)};
    step(load ? std::optional(between(load_from, *load)) : std::nullopt, between(depth_from, bounded(depth_mm)), here,
         between(twist_from, twist));
  }
  summarize();
  return state_;
}

void GridContact::Solver::summarize() {
  state_ = {};
  stats_.contact_cells = static_cast<int>(cells_.size());
  load_ = 0.0;
  if (cells_.empty()) return;
  const double area = cell_ * cell_;
  const Turn gel(now_.gel_turn);
  int slipping = 0;
  double moment = 0.0;
  Vec2 shear;
  for (const Cell& c : cells_) {
    const Vec2 q{now_.qx[c.i], now_.qy[c.i]};
    load_ += area * now_.p[c.i];
    shear = shear + area * q;
    moment += area * cross(gel(center(c.x, c.y) - middle_), q);
    if (now_.slips[c.i] != 0) ++slipping;
  }
  const double g = gel_.shear_modulus_mpa;
  const double cells = static_cast<double>(cells_.size());
  state_.depth_mm = depth_;
  state_.normal_n = g * load_;
  state_.contact_radius_mm = cell_ * std::sqrt(cells / pi);
  state_.stick_radius_mm = cell_ * std::sqrt((cells - slipping) / pi);
  state_.slip_fraction = slipping / cells;
  state_.gross = slipping == stats_.contact_cells;
  state_.shear_n = g * shear;
  state_.moment_nmm = g * moment;
  state_.slid_mm = now_.place - touch_place_;
  state_.slid_rad = now_.turn - touch_turn_;
  state_.center_mm = middle_ + gel_motion_;
}

void GridContact::Solver::field(std::span<Vec2> motion_mm) const {
  Field x(markers_, 0.0);
  Field y(markers_, 0.0);
  for (const Cell& c : cells_) {
    const double* k = marker_.data() + 5 * markers_ * (idx(c.y) * idx(nx_) + idx(c.x));
    const double qx = now_.qx[c.i];
    const double qy = now_.qy[c.i];
    const double p = now_.p[c.i];
    for (std::size_t m = 0; m < markers_; ++m) {
      x[m] += k[m] * qx + k[markers_ + m] * qy + k[3 * markers_ + m] * p;
      y[m] += k[markers_ + m] * qx + k[2 * markers_ + m] * qy + k[4 * markers_ + m] * p;
    }
  }
  for (std::size_t m = 0; m < markers_; ++m) motion_mm[m] = {x[m], y[m]};
}

GridContact::Traction GridContact::Solver::traction_at(Vec2 gel_mm) const {
  const double x = std::floor(gel_mm.x / cell_ + 0.5 * nx_);
  const double y = std::floor(gel_mm.y / cell_ + 0.5 * ny_);
  if (!(x >= 0.0 && x < nx_ && y >= 0.0 && y < ny_)) return {};
  const std::size_t i = at(static_cast<int>(x), static_cast<int>(y));
  const double g = gel_.shear_modulus_mpa;
  return {g * now_.p[i], {g * now_.qx[i], g * now_.qy[i]}};
}

GridContact::GridContact(const GridSetup& setup, std::span<const Vec2> markers_mm)
    : solver_(std::make_unique<Solver>(setup, markers_mm)) {}
GridContact::~GridContact() = default;

const ContactState& GridContact::move_to(const ObjectPose& pose) {
  return solver_->go(std::nullopt, pose.depth_mm, pose.at_mm, pose.twist_rad);
}
const ContactState& GridContact::press_to(double force_n, Vec2 at_mm, double twist_rad) {
  return solver_->go(force_n, 0.0, at_mm, twist_rad);
}
void GridContact::scale_friction(double factor) {
  solver_->scale_friction(factor);
}
void GridContact::field(std::span<Vec2> motion_mm) {
  solver_->field(motion_mm);
}
const GridStats& GridContact::stats() const {
  return solver_->stats();
}
GridContact::Traction GridContact::traction_at(Vec2 gel_mm) const {
  return solver_->traction_at(gel_mm);
}

}  // namespace holdfast::scene
