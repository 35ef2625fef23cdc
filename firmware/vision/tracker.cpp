// SPDX-License-Identifier: Apache-2.0
#include "vision/tracker.hpp"

#include <algorithm>
#include <cstdlib>

#include "base/math.hpp"

namespace holdfast::tracker {
namespace {

// Grey levels below which a dot cannot be told from noise (sigma 2.5 at 18 ms exposure, 3/16 of contrast as margin).
constexpr std::int32_t kLeastContrast = 10;

struct Cell {
  std::int32_t row, col;
};

struct Offset {
  std::int32_t x_px_q8 = 0, y_px_q8 = 0;
};

// Displacement of marker i from home.
Offset offset_of(const State& state, std::int32_t i) {
  const Marker& marker = state.field.markers[idx(i)];
  return {marker.x.raw() - state.home.x[idx(i)].raw(), marker.y.raw() - state.home.y[idx(i)].raw()};
}

// Component-wise median displacement of the valid markers within `reach` cells, without (row, col) itself.
// false when there is none. Range: at most 5 * 5 - 1 neighbours.
bool neighbours_say(const State& state, Cell cell, std::int32_t reach, Offset& out) {
  std::array<std::int32_t, 24> xs{};
  std::array<std::int32_t, 24> ys{};
  int n = 0;
  const GridSize grid = state.field.grid;
  for (std::int32_t r = std::max(0, cell.row - reach); r <= std::min(grid.rows - 1, cell.row + reach); ++r) {
    for (std::int32_t c = std::max(0, cell.col - reach); c <= std::min(grid.cols - 1, cell.col + reach); ++c) {
      const std::int32_t i = r * grid.cols + c;
      if ((r == cell.row && c == cell.col) || !state.field.markers[idx(i)].valid) continue;
      const Offset offset = offset_of(state, i);
      xs[idx(n)] = offset.x_px_q8;
      ys[idx(n)] = offset.y_px_q8;
      ++n;
    }
  }
  if (n == 0) return false;
  out = {median_of_few(xs.data(), n), median_of_few(ys.data(), n)};
  return true;
}

bool looks_like_its_dot(const Model& model, const window::Dot& dot) {
  return dot.contrast >= kLeastContrast && dot.contrast * 3 >= model.contrast && dot.area * 2 >= model.area &&
         dot.area * 5 <= model.area * 8;
}

// The shadow of a contact's rim grows together with a dot, which then looks larger and pulls the centre along: beside a
// step of 0.75 of a dot's contrast by 1.3 px of 32 at 1.06 times the area, by 2.6 to 3.1 at 1.3 to 1.4 times. Pressure
// enlarges dots as well, without moving them against their neighbours: see lose_dragged().
using Swollen = std::array<bool, kMaxMarkers>;
bool is_swollen(const Model& model, const window::Dot& dot) {
  return dot.area * 4 > model.area * 5;
}

// A dot that reaches over the picture's edge has its visible part's centre, not its own: up to half a radius off.
// Range: a place that was measured, within the picture; distances below 2^19 in Q8, squares times 355 below 2^47.
bool reaches_over_edge(const LumaView& luma, const window::Dot& dot, std::int32_t area) {
  const std::int64_t nearest = std::min(
      {dot.x.raw(), dot.y.raw(), ((luma.width - 1) << 8) - dot.x.raw(), ((luma.height - 1) << 8) - dot.y.raw()});
  return square(nearest) * 355 < (std::int64_t{area} << 16) * 113;  // distance < sqrt(area / pi)
}

// Looks for marker i at its present position; updates it or declares it lost.
void look(State& state, const Config& config, const LumaView& luma, std::int32_t i, Swollen& swollen) {
  Marker& marker = state.field.markers[idx(i)];
  Model& model = state.models[idx(i)];
  window::Dot dot{marker.x, marker.y, model.contrast, model.area};
  marker.valid = window::measure(luma, state.window_size, config.passes, dot) && looks_like_its_dot(model, dot) &&
                 !reaches_over_edge(luma, dot, model.area);
  if (!marker.valid) return;
  marker.x = dot.x;
  marker.y = dot.y;
  model.contrast = dot.contrast;
  swollen[idx(i)] = is_swollen(model, dot);
}

// Squared distance by which a marker disagrees with its neighbours. Range: one of them at least is valid.
std::int64_t disagreement(const State& state, Cell cell) {
  Offset expected{};
  (void)neighbours_say(state, cell, 1, expected);
  const Offset is = offset_of(state, cell.row * state.field.grid.cols + cell.col);
  return square(is.x_px_q8 - expected.x_px_q8) + square(is.y_px_q8 - expected.y_px_q8);
}

// Two markers side by side must keep their order and some distance: between 0.35 and 1.75 pitches apart along the
// line that joined them at home. Of two that do not, the one that disagrees more with its neighbours is lost.
// (Largest strain seen on real clips is about 0.3; 0.35 is where two dots of 0.52 pitch diameter would merge.)
void keep_order(State& state) {
  const GridSize grid = state.field.grid;
  const std::int64_t pitch = state.pitch.raw();
  const auto check = [&](Cell a, Cell b) {
    const std::int32_t i = a.row * grid.cols + a.col;
    const std::int32_t j = b.row * grid.cols + b.col;
    Marker& first = state.field.markers[idx(i)];
    Marker& second = state.field.markers[idx(j)];
    if (!first.valid || !second.valid) return;
    const std::int64_t home_x = state.home.x[idx(j)].raw() - state.home.x[idx(i)].raw();
    const std::int64_t home_y = state.home.y[idx(j)].raw() - state.home.y[idx(i)].raw();
    const std::int64_t dx = second.x.raw() - first.x.raw();
    const std::int64_t dy = second.y.raw() - first.y.raw();
    // Projection on the home direction, times pitch. Range: places seen are 2^19 apart at most, predicted ones at home
    // 2^21: `along` < 2^41, times 20 < 2^46; pitch <= 2^20.
    const std::int64_t along = dx * home_x + dy * home_y;
    if (along * 20 >= pitch * pitch * 7 && along * 4 <= pitch * pitch * 7) return;
    if (disagreement(state, a) > disagreement(state, b)) {
      first.valid = false;
    } else {
      second.valid = false;
    }
  };
  for (std::int32_t r = 0; r < grid.rows; ++r) {
    for (std::int32_t c = 0; c < grid.cols; ++c) {
      if (c + 1 < grid.cols) check({r, c}, {r, c + 1});
      if (r + 1 < grid.rows) check({r, c}, {r + 1, c});
    }
  }
}

// A swollen dot that has moved against its four neighbours by more than these differ among each other, and a twentieth
// of a pitch, is dragged by a shadow: lost. That takes 0.03 % of the markers of 200 recordings (6 of 765 450 on the 7x9
// gel). Not seen: a shadow that drags neighbours alike, as along a line of dots.
void lose_dragged(State& state, const Swollen& swollen) {
  const GridSize grid = state.field.grid;
  constexpr std::array<Cell, 4> kBeside{{{0, 1}, {0, -1}, {1, 0}, {-1, 0}}};
  for (std::int32_t i = 0; i < grid.count(); ++i) {
    Marker& marker = state.field.markers[idx(i)];
    if (!marker.valid || !swollen[idx(i)]) continue;
    std::array<std::int32_t, 4> xs{}, ys{};
    int n = 0;
    for (const Cell d : kBeside) {
      const std::int32_t row = i / grid.cols + d.row;
      const std::int32_t col = i % grid.cols + d.col;
      if (row < 0 || row >= grid.rows || col < 0 || col >= grid.cols) continue;
      const std::int32_t j = row * grid.cols + col;
      if (!state.field.markers[idx(j)].valid) continue;
      const Offset offset = offset_of(state, j);
      xs[idx(n)] = offset.x_px_q8;
      ys[idx(n++)] = offset.y_px_q8;
    }
    if (n < 3) continue;
    auto sorted_x = xs;
    auto sorted_y = ys;
    const Offset expected{median_of_few(sorted_x.data(), n), median_of_few(sorted_y.data(), n)};
    // Range: places are 2^19 apart at most, predicted ones 2^21; squares below 2^44.
    const auto away = [&](Offset is) {
      return static_cast<std::int64_t>(isqrt(
          static_cast<std::uint64_t>(square(is.x_px_q8 - expected.x_px_q8) + square(is.y_px_q8 - expected.y_px_q8))));
    };
    std::int64_t spread = 0;
    for (int k = 0; k < n; ++k) spread = std::max(spread, away({xs[idx(k)], ys[idx(k)]}));
    if (away(offset_of(state, i)) > spread + state.pitch.raw() / 20) marker.valid = false;
  }
}

// Looks again for each lost marker where its neighbours expect it. It counts only within half a pitch of there,
// so that it cannot come back as somebody else; a swollen dot within a twentieth.
void look_for_lost(State& state, const Config& config, const LumaView& luma, Swollen& swollen) {
  const GridSize grid = state.field.grid;
  for (std::int32_t r = 0; r < grid.rows; ++r) {
    for (std::int32_t c = 0; c < grid.cols; ++c) {
      const std::int32_t i = r * grid.cols + c;
      Marker& marker = state.field.markers[idx(i)];
      Offset expected{};
      if (marker.valid || !neighbours_say(state, {r, c}, 2, expected)) continue;
      Saturations ignored{};
      const Marker guess{PixelsQ8::saturate(state.home.x[idx(i)].raw() + expected.x_px_q8, ignored),
                         PixelsQ8::saturate(state.home.y[idx(i)].raw() + expected.y_px_q8, ignored), false};
      marker = guess;
      look(state, config, luma, i, swollen);
      if (!marker.valid) continue;
      const std::int64_t reach2 = square(state.pitch.raw() / (swollen[idx(i)] ? 20 : 2));
      const std::int64_t off = square(marker.x.raw() - guess.x.raw()) + square(marker.y.raw() - guess.y.raw());
      if (off > reach2) marker = guess;
    }
  }
}

int lost_count(const State& state) {
  return state.field.grid.count() - state.field.valid_count();
}

// The outermost lines tell a jump by a whole pitch: one of them then finds no dots. While most of such a line is
// hidden (dirt, edge of the picture), it cannot tell any more.
bool outer_line_lost(const State& state) {
  const GridSize grid = state.field.grid;
  const auto mostly_lost = [&](std::int32_t first, std::int32_t step, std::int32_t count) {
    std::int32_t lost = 0;
    for (std::int32_t k = 0; k < count; ++k) lost += state.field.markers[idx(first + k * step)].valid ? 0 : 1;
    return lost * 2 > count;
  };
  return mostly_lost(0, 1, grid.cols) || mostly_lost((grid.rows - 1) * grid.cols, 1, grid.cols) ||
         mostly_lost(0, grid.cols, grid.rows) || mostly_lost(grid.cols - 1, grid.cols, grid.rows);
}

// Finds dots in the whole picture and lays the lattice over them. Centres are then refined by the windows; a marker
// that no window confirms is not valid.
Status search(State& state, const Config& config, const LumaView& luma) {
  count_up(state.searches);
  Status status = dots::detect(state.dots_state, config.dots, luma, state.dots);
  if (!status.ok()) return status;
  status = grid::register_dots(state.grid_state, config.grid, state.dots, state.acquired ? &state.before : nullptr,
                               state.lattice);
  state.found = state.lattice.found;
  return status;
}

// Takes the lattice over and refines it. At first sight the dots define contrast and area, and if no window confirms
// any of them, nothing is acquired; later the models stand.
void take_lattice(State& state, const Config& config, const LumaView& luma, Swollen& swollen) {
  const bool first_sight = !state.acquired;
  state.field = state.lattice.field;
  if (first_sight) {
    state.cut = state.lattice.cut;
    state.pitch = state.lattice.pitch;
    state.window_size = std::min({window::size_for(state.pitch, config.window_pct), luma.width, luma.height});
  }
  std::array<std::int32_t, kMaxMarkers> areas{};
  int n = 0;
  for (std::int32_t i = 0; i < state.field.grid.count(); ++i) {
    Marker& marker = state.field.markers[idx(i)];
    Model& model = state.models[idx(i)];
    if (!marker.valid) continue;
    window::Dot dot{marker.x, marker.y, window::contrast_at(luma, state.window_size, marker.x, marker.y), 0};
    marker.valid = dot.contrast >= kLeastContrast && window::measure(luma, state.window_size, config.passes, dot) &&
                   (first_sight || looks_like_its_dot({0, model.area}, dot));
    if (!marker.valid) continue;
    marker.x = dot.x;
    marker.y = dot.y;
    model.contrast = dot.contrast;
    swollen[idx(i)] = !first_sight && is_swollen(model, dot);
    if (first_sight) {
      model.area = dot.area;
      areas[idx(n++)] = dot.area;
    }
  }
  if (!first_sight || n == 0) return;
  // Missing dots get the typical model, so that they can be found when the dirt is wiped off.
  const std::int32_t typical_area = median_of_few(areas.data(), n);
  for (std::int32_t i = 0; i < state.field.grid.count(); ++i) {
    state.home.x[idx(i)] = state.field.markers[idx(i)].x;
    state.home.y[idx(i)] = state.field.markers[idx(i)].y;
    if (!state.field.markers[idx(i)].valid) state.models[idx(i)] = {kLeastContrast * 3, typical_area};
  }
  state.acquired = true;
}

}  // namespace

void reset(State& state) {
  state.acquired = false;
  state.field = {};
  state.frames_to_search = 0;
  state.names_sure = true;
}

void set_home(State& state, const MarkerField& rest) {
  for (std::int32_t i = 0; i < rest.grid.count(); ++i) {
    if (!rest.markers[idx(i)].valid) continue;
    state.home.x[idx(i)] = rest.markers[idx(i)].x;
    state.home.y[idx(i)] = rest.markers[idx(i)].y;
  }
}

Status update(State& state, const Config& config, const LumaView& luma) {
  Swollen swollen{};
  if (!state.acquired) {
    const Status status = search(state, config, luma);
    if (!status.ok()) return status;
    take_lattice(state, config, luma, swollen);
    if (!state.acquired) return {Reason::kMarkersLost};
    look_for_lost(state, config, luma, swollen);  // dots too faint for the search, in dark corners for instance
    keep_order(state);
    return kOkStatus;
  }
  const int lost_before = lost_count(state);
  state.before = state.field;
  // A lost marker is only looked for where its neighbours say, or it might come back as somebody else.
  for (std::int32_t i = 0; i < state.field.grid.count(); ++i) {
    if (state.field.markers[idx(i)].valid) look(state, config, luma, i, swollen);
  }
  keep_order(state);
  int lost = lost_count(state);
  const bool jumped = !state.names_sure || lost - lost_before >= config.lost_to_search || outer_line_lost(state);
  if (!jumped && lost > 0) {
    look_for_lost(state, config, luma, swollen);
    keep_order(state);
    lost = lost_count(state);
  }

  if (!jumped && lost == 0) {
    state.frames_to_search = 0;
  } else if (jumped || --state.frames_to_search <= 0) {
    state.frames_to_search = config.search_every;
    const bool found = search(state, config, luma).ok();
    if (found) {
      take_lattice(state, config, luma, swollen);
      look_for_lost(state, config, luma, swollen);
      keep_order(state);
    } else if (jumped) {
      // The windows may all sit one dot further: better no marker than a wrong name.
      state.field = state.before;
      for (Marker& marker : state.field.markers) marker.valid = false;
    }
    state.names_sure = found || !jumped;
  }
  lose_dragged(state, swollen);
  return kOkStatus;
}

}  // namespace holdfast::tracker
