// SPDX-License-Identifier: Apache-2.0
#include "vision/grid.hpp"

#include <algorithm>
#include <cstdlib>

#include "base/math.hpp"

namespace holdfast::grid {
namespace {

using Vector = State::Vector;

constexpr int kMinDots = 9;  // a 3x3 patch is the least that shows two axes with support

Vector between(const dots::Dot& from, const dots::Dot& to) {
  return {to.x.raw() - from.x.raw(), to.y.raw() - from.y.raw()};
}

// Range: components below 2^21, squares below 2^42.
std::int64_t length2(Vector v) {
  return square(v.x_px_q8) + square(v.y_px_q8);
}

Vector plus(Vector a, Vector b) {
  return {a.x_px_q8 + b.x_px_q8, a.y_px_q8 + b.y_px_q8};
}
Vector minus(Vector a, Vector b) {
  return {a.x_px_q8 - b.x_px_q8, a.y_px_q8 - b.y_px_q8};
}
Vector mean(Vector a, Vector b) {
  return {(a.x_px_q8 + b.x_px_q8) / 2, (a.y_px_q8 + b.y_px_q8) / 2};
}
Vector times(Vector v, std::int32_t k) {
  return {v.x_px_q8 * k, v.y_px_q8 * k};
}

struct Basis {
  Vector along_row;  // mostly +x
  Vector along_col;  // mostly +y
  std::int32_t pitch_px_q8 = 0;
};

// The four nearest neighbours of dot i, nearest first; fewer when there are fewer dots.
int nearest_four(const dots::Dots& dots, int i, std::array<Vector, 4>& out) {
  std::array<std::int64_t, 4> best{};
  int count = 0;
  for (int j = 0; j < dots.count; ++j) {
    if (j == i) continue;
    const Vector v = between(dots.dots[idx(i)], dots.dots[idx(j)]);
    const std::int64_t d2 = length2(v);
    int at = count < 4 ? count++ : 4;
    while (at > 0 && best[idx(at - 1)] > d2) {
      if (at < 4) {
        best[idx(at)] = best[idx(at - 1)];
        out[idx(at)] = out[idx(at - 1)];
      }
      --at;
    }
    if (at < 4) {
      best[idx(at)] = d2;
      out[idx(at)] = v;
    }
  }
  return count;
}

// Pitch: median distance to the four nearest neighbours (in a lattice most of them are one pitch away, and the
// median does not care about strays). Axes: component-wise medians of those neighbour vectors, folded into the
// quarter around +x and the quarter around +y.
bool find_basis(State& state, const dots::Dots& dots, Basis& basis) {
  int count = 0;
  std::array<Vector, 4> near{};
  for (int i = 0; i < dots.count; ++i) {
    const int n = nearest_four(dots, i, near);
    for (int k = 0; k < n; ++k) {
      state.scratch[idx(count++)] = static_cast<std::int32_t>(isqrt(static_cast<std::uint64_t>(length2(near[idx(k)]))));
    }
  }
  basis.pitch_px_q8 = median_of_few(state.scratch.data(), count);
  if (basis.pitch_px_q8 < 4 * 256) return false;

  const auto fits = [&](Vector v) {
    const std::int64_t d2 = length2(v) * 16;
    return d2 > square(basis.pitch_px_q8) * 9 && d2 < square(basis.pitch_px_q8) * 25;  // 0.75..1.25 pitch
  };
  const auto median_axis = [&](bool horizontal, Vector& axis) {
    // One component at a time, so that `scratch` holds one list.
    for (std::int32_t Vector::*component : {&Vector::x_px_q8, &Vector::y_px_q8}) {
      int n = 0;
      for (int i = 0; i < dots.count; ++i) {
        const int found = nearest_four(dots, i, near);
        for (int k = 0; k < found; ++k) {
          Vector v = near[idx(k)];
          if (!fits(v) || (std::abs(v.x_px_q8) >= std::abs(v.y_px_q8)) != horizontal) continue;
          if ((horizontal ? v.x_px_q8 : v.y_px_q8) < 0) v = times(v, -1);
          state.scratch[idx(n++)] = v.*component;
        }
      }
      if (n < kMinDots) return false;
      axis.*component = median_of_few(state.scratch.data(), n);
    }
    return true;
  };
  return median_axis(true, basis.along_row) && median_axis(false, basis.along_col);
}

// The dot nearest to `from` + `step`, within `reach`; -1 when there is none.
int dot_at(const dots::Dots& dots, const dots::Dot& from, Vector step, std::int64_t reach_px_q8) {
  int best = -1;
  std::int64_t best2 = square(reach_px_q8);
  for (int j = 0; j < dots.count; ++j) {
    const std::int64_t d2 = length2(minus(between(from, dots.dots[idx(j)]), step));
    if (d2 < best2) {
      best2 = d2;
      best = j;
    }
  }
  return best;
}

struct Direction {
  std::int8_t row, col;
};
constexpr std::array<Direction, 4> kDirections{{{0, 1}, {0, -1}, {1, 0}, {-1, 0}}};

Vector step_of(const State::Node& node, Direction d) {
  return plus(times(node.along_row, d.col), times(node.along_col, d.row));
}

// A dot well inside the lattice: all four neighbours where the basis says, as central as possible.
int find_seed(const dots::Dots& dots, const Basis& basis) {
  std::int64_t sum_x = 0, sum_y = 0;
  for (int i = 0; i < dots.count; ++i) {
    sum_x += dots.dots[idx(i)].x.raw();
    sum_y += dots.dots[idx(i)].y.raw();
  }
  const auto centre_x = static_cast<std::int32_t>(sum_x / dots.count);
  const auto centre_y = static_cast<std::int32_t>(sum_y / dots.count);
  const std::int64_t reach = basis.pitch_px_q8 * 3 / 10;
  int seed = -1;
  std::int64_t best = 0;
  for (int i = 0; i < dots.count; ++i) {
    const dots::Dot& dot = dots.dots[idx(i)];
    bool supported = true;
    for (const std::int32_t sign : {1, -1}) {
      supported = supported && dot_at(dots, dot, times(basis.along_row, sign), reach) >= 0 &&
                  dot_at(dots, dot, times(basis.along_col, sign), reach) >= 0;
    }
    const std::int64_t off = square(dot.x.raw() - centre_x) + square(dot.y.raw() - centre_y);
    if (supported && (seed < 0 || off < best)) {
      seed = i;
      best = off;
    }
  }
  return seed;
}

// Names dots from neighbour to neighbour, breadth first. Each dot is named once and each cell taken once, so the
// queue is bounded by the number of dots.
void walk(State& state, const dots::Dots& dots, const Basis& basis, int seed) {
  for (auto& row : state.cells) row.fill(-1);
  for (int i = 0; i < dots.count; ++i) state.nodes[idx(i)] = {};
  int head = 0;
  int tail = 0;
  const auto name = [&](int dot, int row, int col, Vector along_row, Vector along_col) {
    state.nodes[idx(dot)] = {static_cast<std::int8_t>(row), static_cast<std::int8_t>(col), true, along_row, along_col};
    state.cells[idx(row + kReach)][idx(col + kReach)] = static_cast<std::int16_t>(dot);
    state.queue[idx(tail++)] = static_cast<std::int16_t>(dot);
  };
  // Steps of one pitch first; then steps of two, to get across a missing dot.
  const auto visit = [&](int dot, int stride) {
    const State::Node node = state.nodes[idx(dot)];
    for (const Direction d : kDirections) {
      const int row = node.row + d.row * stride;
      const int col = node.col + d.col * stride;
      if (std::abs(row) > kReach || std::abs(col) > kReach) continue;
      if (state.cells[idx(row + kReach)][idx(col + kReach)] >= 0) continue;
      const Vector step = times(step_of(node, d), stride);
      const int next = dot_at(dots, dots.dots[idx(dot)], step, basis.pitch_px_q8 * 2 / 5);
      if (next < 0 || state.nodes[idx(next)].named) continue;
      // The local basis follows the deformation, half a step at a time.
      const Vector seen = between(dots.dots[idx(dot)], dots.dots[idx(next)]);
      Vector along_row = node.along_row;
      Vector along_col = node.along_col;
      if (stride == 1 && d.col != 0) along_row = mean(along_row, times(seen, d.col));
      if (stride == 1 && d.row != 0) along_col = mean(along_col, times(seen, d.row));
      name(next, row, col, along_row, along_col);
    }
  };
  name(seed, 0, 0, basis.along_row, basis.along_col);
  for (int named = -1; named != tail;) {
    named = tail;
    while (head < tail) visit(state.queue[idx(head++)], 1);
    for (int i = 0; i < named; ++i) visit(state.queue[idx(i)], 2);
  }
}

struct Window {
  int row = 0, col = 0;  // first cell
  int dots = 0;
  bool unique = false;  // no other place covers nearly as many dots
};

// Range: the window lies within the cells, here and below.
int count_cells(const State& state, int row, int col, GridSize size) {
  int n = 0;
  for (int r = row; r < row + size.rows; ++r) {
    for (int c = col; c < col + size.cols; ++c) {
      n += state.cells[idx(r + kReach)][idx(c + kReach)] >= 0 ? 1 : 0;
    }
  }
  return n;
}

// Mean of squared distances to where the markers were, for a window laid at (row, col), in which there is a dot.
std::int64_t distance_to_prior(const State& state, const dots::Dots& dots, const MarkerField& prior, int row, int col) {
  std::int64_t sum = 0;
  std::int64_t n = 0;
  for (int r = 0; r < prior.grid.rows; ++r) {
    for (int c = 0; c < prior.grid.cols; ++c) {
      const int dot = state.cells[idx(row + r + kReach)][idx(col + c + kReach)];
      if (dot < 0) continue;
      const Marker& was = prior.markers[idx(r * prior.grid.cols + c)];
      sum += square(dots.dots[idx(dot)].x.raw() - was.x.raw()) + square(dots.dots[idx(dot)].y.raw() - was.y.raw());
      ++n;
    }
  }
  return sum / n;
}

// Lays rows x cols over the dots. Places that cover within half a line of the most dots are alike: a stray or a hidden
// dot must not move the grid by a line. Among them the nearest to the earlier field wins; without one, the fullest.
Window place(const State& state, const dots::Dots& dots, GridSize size, const MarkerField* prior) {
  const int alike = prior != nullptr ? std::min(size.rows, size.cols) / 2 : 0;
  const auto each_place = [&](auto&& visit) {
    for (int row = -kReach; row <= kReach - size.rows + 1; ++row) {
      for (int col = -kReach; col <= kReach - size.cols + 1; ++col) {
        const int n = count_cells(state, row, col, size);
        if (n > 0) visit(row, col, n);
      }
    }
  };
  int most = 0;
  each_place([&](int, int, int n) { most = std::max(most, n); });
  Window best{};
  std::int64_t best_distance = 0;
  int candidates = 0;
  each_place([&](int row, int col, int n) {
    if (n < most - alike) return;
    const std::int64_t distance = prior != nullptr ? distance_to_prior(state, dots, *prior, row, col) : 0;
    if (candidates++ > 0 && distance >= best_distance) return;
    best = {row, col, n, true};
    best_distance = distance;
  });
  best.unique = candidates == 1;
  return best;
}

// Rows and columns that hold at least half as many dots as the fullest one: strays on the outside do not count.
struct Extent {
  int first_row = 0, first_col = 0;
  GridSize size;
};
Extent extent_of(const State& state) {
  std::array<std::int32_t, kCells> rows{};
  std::array<std::int32_t, kCells> cols{};
  for (int r = 0; r < kCells; ++r) {
    for (int c = 0; c < kCells; ++c) {
      if (state.cells[idx(r)][idx(c)] < 0) continue;
      ++rows[idx(r)];
      ++cols[idx(c)];
    }
  }
  const auto span = [](const std::array<std::int32_t, kCells>& lines, int& first) {
    const std::int32_t most = *std::max_element(lines.begin(), lines.end());
    int last = -1;
    first = 0;
    for (int i = 0; i < kCells; ++i) {
      if (lines[idx(i)] * 2 < most) continue;
      if (last < 0) first = i;
      last = i;
    }
    return static_cast<std::uint8_t>(last - first + 1);
  };
  Extent extent{};
  extent.size.rows = span(rows, extent.first_row);
  extent.size.cols = span(cols, extent.first_col);
  extent.first_row -= kReach;
  extent.first_col -= kReach;
  return extent;
}

// Position of a marker without a dot: the mean of what its named neighbours and their local basis say.
void predict_missing(const State& state, const dots::Dots& dots, const Window& window, MarkerField& field) {
  for (int r = 0; r < field.grid.rows; ++r) {
    for (int c = 0; c < field.grid.cols; ++c) {
      if (state.cells[idx(window.row + r + kReach)][idx(window.col + c + kReach)] >= 0) continue;
      std::int64_t x = 0, y = 0;
      std::int32_t n = 0;
      for (int distance = 1; distance <= kReach && n == 0; ++distance) {
        for (const Direction d : kDirections) {
          const int rr = r + d.row * distance;
          const int cc = c + d.col * distance;
          if (rr < 0 || rr >= field.grid.rows || cc < 0 || cc >= field.grid.cols) continue;
          const int dot = state.cells[idx(window.row + rr + kReach)][idx(window.col + cc + kReach)];
          if (dot < 0) continue;
          const Vector back = times(step_of(state.nodes[idx(dot)], d), -distance);
          x += dots.dots[idx(dot)].x.raw() + back.x_px_q8;
          y += dots.dots[idx(dot)].y.raw() + back.y_px_q8;
          ++n;
        }
      }
      Saturations ignored{};
      Marker& marker = field.markers[idx(r * field.grid.cols + c)];
      marker.x = PixelsQ8::saturate(n > 0 ? x / n : 0, ignored);
      marker.y = PixelsQ8::saturate(n > 0 ? y / n : 0, ignored);
      marker.valid = false;
    }
  }
}

// Leaves out the outer rows and columns that lie too near to the picture's edge. At least three of each stay.
Cut leave_out_cut_lines(const dots::Dots& dots, std::int64_t margin_px_q8, MarkerField& field) {
  const GridSize seen = field.grid;
  // Distances to the edge that runs along the line.
  const auto is_cut = [&](std::int32_t first, std::int32_t step, std::int32_t count, auto&& distance) {
    std::int32_t near = 0;
    for (std::int32_t k = 0; k < count; ++k) near += distance(field.markers[idx(first + k * step)]) < margin_px_q8;
    return near * 3 >= count;
  };
  const std::int32_t right = (dots.width - 1) << 8;
  const std::int32_t bottom = (dots.height - 1) << 8;
  const auto row_is_cut = [&](std::int32_t r, auto&& distance) {
    return is_cut(r * seen.cols, 1, seen.cols, distance);
  };
  const auto col_is_cut = [&](std::int32_t c, auto&& distance) { return is_cut(c, seen.cols, seen.rows, distance); };
  Cut cut{};
  const auto rows_left = [&] { return seen.rows - cut.top - cut.bottom; };
  const auto cols_left = [&] { return seen.cols - cut.left - cut.right; };
  while (rows_left() > 3 && row_is_cut(cut.top, [](const Marker& m) { return m.y.raw(); })) ++cut.top;
  while (rows_left() > 3 && row_is_cut(seen.rows - 1 - cut.bottom, [&](const Marker& m) { return bottom - m.y.raw(); }))
    ++cut.bottom;
  while (cols_left() > 3 && col_is_cut(cut.left, [](const Marker& m) { return m.x.raw(); })) ++cut.left;
  while (cols_left() > 3 && col_is_cut(seen.cols - 1 - cut.right, [&](const Marker& m) { return right - m.x.raw(); }))
    ++cut.right;
  if (cut.lines() == 0) return cut;
  const MarkerField all = field;
  field = {};
  field.grid = {static_cast<std::uint8_t>(rows_left()), static_cast<std::uint8_t>(cols_left())};
  for (std::int32_t r = 0; r < field.grid.rows; ++r) {
    for (std::int32_t c = 0; c < field.grid.cols; ++c) {
      field.markers[idx(r * field.grid.cols + c)] = all.markers[idx((r + cut.top) * seen.cols + c + cut.left)];
    }
  }
  return cut;
}

}  // namespace

Status register_dots(State& state, const Config& config, const dots::Dots& dots, const MarkerField* prior,
                     Lattice& out) {
  out = {};
  if (dots.count < kMinDots) return {Reason::kTooFewDots};
  Basis basis{};
  if (!find_basis(state, dots, basis)) return {Reason::kNoLattice};
  const int seed = find_seed(dots, basis);
  if (seed < 0) return {Reason::kNoLattice};
  walk(state, dots, basis, seed);

  const Extent extent = extent_of(state);
  out.found = extent.size;
  const bool sane = extent.size.rows >= 3 && extent.size.cols >= 3 && extent.size.count() <= kMaxMarkers;
  if (!sane) return {Reason::kNoLattice};
  const GridSize size = config.auto_size && prior == nullptr ? extent.size
                        : prior != nullptr                   ? prior->grid
                                                             : config.size;
  if (prior == nullptr && (extent.size.rows > size.rows || extent.size.cols > size.cols)) {
    return {Reason::kGridAmbiguous};
  }
  const Window window = place(state, dots, size, prior);
  const int missing = size.count() - window.dots;
  const std::int32_t allowed =
      prior != nullptr && window.unique ? config.missing_sixteenths_sure : config.missing_sixteenths;
  if (missing * 16 > size.count() * allowed || (prior == nullptr && !window.unique)) return {Reason::kGridMismatch};

  out.field.grid = size;
  out.pitch = PixelsQ8::from_raw(basis.pitch_px_q8);
  out.strays = dots.count - window.dots;
  for (int r = 0; r < size.rows; ++r) {
    for (int c = 0; c < size.cols; ++c) {
      const int dot = state.cells[idx(window.row + r + kReach)][idx(window.col + c + kReach)];
      if (dot < 0) continue;
      const dots::Dot& seen = dots.dots[idx(dot)];
      out.field.markers[idx(r * size.cols + c)] = {seen.x, seen.y, !seen.cut};
    }
  }
  predict_missing(state, dots, window, out.field);
  if (prior == nullptr) {
    out.cut = leave_out_cut_lines(dots, std::int64_t{out.pitch.raw()} * config.edge_pct / 100, out.field);
  }
  return kOkStatus;
}

}  // namespace holdfast::grid
