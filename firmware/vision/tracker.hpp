// SPDX-License-Identifier: Apache-2.0
// Follows every marker from frame to frame and never lets two of them swap names.
//
// 1. Each marker's window looks where the marker was (window.hpp).
// 2. A marker whose dot is too faint, too small or too large, or that breaks the order of its row or column, is
//    lost: its neighbours say where to look again.
// 3. If more are lost than a smear of dirt explains, or one stays lost, dots are found in the whole picture and the
//    lattice is laid over them anew (grid.hpp). That happens within the same frame.
// After a jump of half a pitch or more the windows sit on the wrong dots, all in the same way; then the outermost
// line finds no dot, which is what starts step 3. While most of an outermost line is hidden, every frame is searched.
// Limit: a jump of more than half a pitch while a whole line is out of sight has two explanations; the nearer is taken.
#pragma once

#include <array>
#include <cstdint>

#include "base/status.hpp"
#include "vision/dots.hpp"
#include "vision/grid.hpp"
#include "vision/luma.hpp"
#include "vision/markers.hpp"
#include "vision/window.hpp"

namespace holdfast::tracker {

struct Config {
  grid::Config grid;
  dots::Config dots;
  // Re-centrings per window. Price of each: about 500 aarch64 instructions for every marker that moved.
  int passes = 4;
  // Least side of a window in percent of the pitch; sides go in steps (window::size_for). Price of more: its pixels,
  // and a neighbour's rim inside; of less: the dot's own rim outside when it moves.
  std::int32_t window_pct = window::kSizePct;
  // Markers lost from one frame to the next that start a search of the whole picture. Price of less: 3 M instructions
  // each time.
  int lost_to_search = 3;
  // Frames between searches while any marker stays lost.
  int search_every = 12;
};

// Where each marker belongs on the unloaded gel, or at first sight: the shape that displacements refer to.
struct Home {
  std::array<PixelsQ8, kMaxMarkers> x{};
  std::array<PixelsQ8, kMaxMarkers> y{};
};

struct Model {
  std::int32_t contrast = 0;  // of the dot when last seen, grey levels
  std::int32_t area = 0;      // of the dot when registered, pixels
};

struct State {
  bool acquired = false;
  bool names_sure = true;  // false after a jump that no search has explained yet
  MarkerField field;
  MarkerField before;  // field of the frame before
  Home home;
  std::array<Model, kMaxMarkers> models{};
  PixelsQ8 pitch;
  std::int32_t window_size = window::kMinSize;
  int frames_to_search = 0;
  std::uint32_t searches = 0;  // whole-picture searches since start
  GridSize found;              // lattice seen by the last registration, also when it failed
  grid::Cut cut;               // what was left out of it at first sight
  dots::State dots_state;
  dots::Dots dots;
  grid::State grid_state;
  grid::Lattice lattice;
};

// Forgets the lattice; the next update() registers it anew.
void reset(State& state);

// The rest position was learned: displacements and predictions refer to it from now on.
void set_home(State& state, const MarkerField& rest);

// One frame. On failure the reasons of grid::register_dots, or kMarkersLost when no window confirms a dot of the
// lattice at first sight: no lattice is known, state.field means nothing. Success says only that the lattice is known;
// how many markers were found is in state.field.
[[nodiscard]] Status update(State& state, const Config& config, const LumaView& luma);

}  // namespace holdfast::tracker
